"""A 4-DOF head fresh from the box: detectors out of focus and turned, a spot that grows, gains,
signs and dark values of its own.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag.virtual.instruments.head import HeadOptics, HeadStand, SpotDetector
from stepdiag.virtual.physics.error_functions import Array
from stepdiag.virtual.physics.kinematics import Pose, rotation_matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class Imperfections:
    """Standard deviations of the drawn values: distance of a PSD behind its focus, rolls, growth of
    the spot's radius a metre of distance, gains, dark values as parts of the full sum. ``signs``:
    fold mirrors turn axes over, each with a probability of one half.
    """

    defocus_mm: float = 0.3
    roll_mrad: float = 20.0
    growth_per_m: float = 0.015
    gain: float = 0.02
    dark: float = 3e-3
    noise: float = 2e-5
    signs: bool = True


def ordinary_head(seed: int, size: Imperfections | None = None) -> HeadOptics:
    """Return the optics of a head with every imperfection drawn."""
    size = size or Imperfections()
    rng = np.random.default_rng([seed, 43])

    def detector(gain: float) -> SpotDetector:
        sign = rng.choice([-1.0, 1.0], size=2) if size.signs else np.ones(2)
        x, y, total = rng.normal(0.0, size.dark, size=3)
        return SpotDetector(
            sign=(float(sign[0]), float(sign[1])),
            rotation_mrad=float(rng.normal(0.0, size.roll_mrad)),
            gain=(float(1.0 + rng.normal(0.0, gain)), float(1.0 + rng.normal(0.0, gain))),
            dark=(float(x), float(y), float(total)),
            noise=size.noise,
        )

    return HeadOptics(
        waist_mm=float(2.0 * (1.0 + rng.normal(0.0, 5.0 * size.gain))),
        spot_growth_per_m=float(abs(rng.normal(0.0, size.growth_per_m))),
        qd_path_mm=float(rng.uniform(30.0, 120.0)),
        psd1_defocus_mm=float(rng.normal(0.0, size.defocus_mm)),
        psd2_defocus_mm=float(rng.normal(0.0, size.defocus_mm)),
        qd=detector(0.0),
        psd1=detector(size.gain),
        psd2=detector(size.gain),
    )


def stage_pose(
    distance_mm: float, shift_mm: Array, turn_urad: Array, stand: HeadStand
) -> Pose:
    """Return poses of a calibration stage on the beam: shifted (N, 2) and turned (N, 2) laterally,
    as a reference stage does it.

    A turn of ``(p, q)`` tips the mirror so that its reflection goes right by 2p and up by 2q.
    """
    places = stand.source_mm + distance_mm * stand.beam + stand.across(shift_mm)
    turn = stand.across(np.stack([turn_urad[:, 1], -turn_urad[:, 0]], axis=1)) * 1e-6
    return Pose(places, rotation_matrix(turn))
