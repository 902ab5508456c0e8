"""The 4-DOF head: straightness, pitch and yaw with common-path compensation of the beam's drift.

Feng, Zhang, Kuang 2008, Eqs 1 to 5, with the signs and the lever of theory.md 9. In one lateral
axis, a pointing drift ``a`` of the source moves the spot on the quadrant detector (QD) by ``-2 L
a``, on the drift detector (PSD1) by the angle ``-a`` and on the angle detector (PSD2) by ``+a``.
The compensated values are

    straightness = QD / 2 - L * psd1        angle = (PSD2 + psd1) / 2

so the signs of psd1 in Feng's Eqs 2 and 4 are opposite to each other. Only the pointing of the
source is corrected. Two errors remain in the straightness: bending of the beam by the air, and half
of a parallel shift of the beam.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepdiag.base.findings import Finding, warning
from stepdiag.solver.fourdof.detector import Detector, Mask, Spots, spots
from stepdiag.solver.fourdof.drift import slow_drift

Vector = NDArray[np.float64]

URAD_PER_ARCSEC = np.pi / 648000 * 1e6
STRAIGHTNESS_RANGE_UM = 650.0
"""Calibrated range of the published head (Feng 2008, abstract)."""
ANGLE_RANGE_ARCSEC = 600.0
"""Range of the angle detector of the published head (Feng 2008, abstract); a larger angle gives
a finding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crosstalk:
    """Calibrated corrections (theory.md 9, a to d); zero means no correction. The pairs of values
    are those of the detectors' x and y.

    ``vertex_mm`` is the position of the corner cube's vertex relative to the point whose
    straightness is measured: lateral x, lateral y, and along the beam (positive towards the head).
    ``psd1_leak`` and ``psd2_leak`` are the false angles in urad for 1 um of lateral shift of the
    beam, if a detector is out of focus. ``qd_gain_per_m`` is the relative increase of the QD's gain
    per metre beyond ``qd_calibrated_at_mm``, because the spot grows.
    """

    vertex_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    psd1_leak: tuple[float, float] = (0.0, 0.0)
    psd2_leak: tuple[float, float] = (0.0, 0.0)
    qd_gain_per_m: tuple[float, float] = (0.0, 0.0)
    qd_calibrated_at_mm: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """The sum signals of QD, PSD1 and PSD2 in normal light, and the largest accepted relative
    difference between these signals (``within``). A clipped spot reduces one sum; a change of
    the laser's power changes all three."""

    sums: tuple[float, float, float]
    within: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Head:
    """The configuration and the calibration of a head.

    The lever at the travel ``d`` away from the head is ``dead_path_mm + lever_scale * d +
    extra_path_mm / 2``: the whole path from the source's pivot to the cube, and half of the extra
    path back to the QD. A lever from `fourdof commission` includes the extra path. ``lever_scale``
    is the gain error of PSD1.
    """

    qd: Detector = field(default_factory=Detector)
    psd1: Detector = field(default_factory=Detector)
    psd2: Detector = field(default_factory=Detector)
    psd1_focal_length_mm: float
    psd2_focal_length_mm: float
    dead_path_mm: float
    extra_path_mm: float = 0.0
    lever_scale: float = 1.0
    light: Light | None = None
    crosstalk: Crosstalk = field(default_factory=Crosstalk)

    def lever_mm(self, travel_mm: ArrayLike) -> Vector:
        """Return the lever at each travel away from the head, shape like ``travel_mm``."""
        lever: Vector = (
            self.dead_path_mm
            + 0.5 * self.extra_path_mm
            + self.lever_scale * np.asarray(travel_mm, dtype=np.float64)
        )
        return lever


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """The motion of the target for each sample in the detectors' x and y, shape (N, 2), NaN without
    usable light.

    ``raw_*`` is the motion without drift compensation. ``drift_urad`` is the angle of PSD1. If
    times are known, the noise of PSD1 is removed from ``drift_urad``. ``u_drift_urad`` is then the
    remaining uncertainty; without times it is zero. ``u_*`` is the uncertainty by the calibration.
    ``usable`` is False for a sample that is blocked, saturated or outside the calibrated range.
    """

    straightness_um: Vector
    angle_urad: Vector
    raw_straightness_um: Vector
    raw_angle_urad: Vector
    drift_urad: Vector
    u_drift_urad: Vector
    u_straightness_um: Vector
    u_angle_urad: Vector
    usable: Mask
    findings: tuple[Finding, ...]


def beam_angle_urad(shift_um: ArrayLike, focal_length_mm: float) -> Vector:
    """Return the beam's angle in urad from the shift of the spot in the focal plane (Feng Eq. 1
    with arctangent)."""
    angle: Vector = 1e6 * np.arctan(
        np.asarray(shift_um, dtype=np.float64) * 1e-3 / focal_length_mm
    )
    return angle


def motion(
    channels: Vector,
    travel_mm: ArrayLike,
    head: Head,
    roll_urad: ArrayLike = 0.0,
    *,
    time_s: Vector | None = None,
    u_psd1_urad: Vector | None = None,
) -> Motion:
    """Return the motion of the target from the head's nine channels (N, 9): x, y, sum of QD, PSD1,
    PSD2.

    ``travel_mm`` (N,) is the travel away from the head since the position of ``dead_path_mm``.
    ``roll_urad`` (scalar or (N,)) corrects the lateral offset of the cube. With ``time_s`` (N,),
    the noise of PSD1 is removed from the drift (`solver.fourdof.drift`). ``u_psd1_urad`` (N, 2) is
    the noise of PSD1 by the scatter within each dwell.
    """
    lever_mm = head.lever_mm(np.broadcast_to(travel_mm, len(channels)))
    lever = lever_mm[:, None]
    seen = {
        name: spots(detector, channels[:, 3 * i : 3 * i + 2], channels[:, 3 * i + 2])
        for i, (name, detector) in enumerate(
            (("QD", head.qd), ("PSD1", head.psd1), ("PSD2", head.psd2))
        )
    }
    qd_um = _qd_at_distance(seen["QD"].shift_um, lever, head.crosstalk)
    psd1 = (
        beam_angle_urad(seen["PSD1"].shift_um, head.psd1_focal_length_mm)
        - np.array(head.crosstalk.psd1_leak) * qd_um
    )
    u_drift = np.zeros_like(psd1)
    if time_s is not None:
        psd1, u_drift = _freed_of_noise(
            psd1, qd_um / 2, lever_mm, time_s, u_drift if u_psd1_urad is None else u_psd1_urad
        )
    psd2 = beam_angle_urad(seen["PSD2"].shift_um, head.psd2_focal_length_mm)
    # the beam on PSD2 is shifted by the drift on the way out and by its angle on the way back, both
    # multiplied by the distance
    walked = np.array(head.crosstalk.psd2_leak) * lever * 1e-3
    psd2 = (psd2 + walked * psd1) / (1 + walked)
    angle = (psd2 + psd1) / 2
    straightness = _at_reference(
        qd_um / 2 - 1e-3 * lever * psd1,
        angle,
        np.broadcast_to(roll_urad, len(channels)),
        head.crosstalk,
    )
    u_psd1 = 1e3 * np.array(seen["PSD1"].u_um) / head.psd1_focal_length_mm
    u_psd2 = 1e3 * np.array(seen["PSD2"].u_um) / head.psd2_focal_length_mm
    usable, findings = _quality(seen, straightness, angle, _clipped(head, channels))
    return Motion(
        straightness_um=straightness,
        angle_urad=angle,
        raw_straightness_um=qd_um / 2,
        raw_angle_urad=psd2 / 2,
        drift_urad=psd1,
        u_drift_urad=u_drift,
        u_straightness_um=np.hypot(np.array(seen["QD"].u_um) / 2, 1e-3 * lever * u_psd1),
        u_angle_urad=np.broadcast_to(np.hypot(u_psd1, u_psd2) / 2, angle.shape).copy(),
        usable=usable,
        findings=findings,
    )


def _freed_of_noise(
    psd1_urad: Vector, spot_um: Vector, lever_mm: Vector, time_s: Vector, u_urad: Vector
) -> tuple[Vector, Vector]:
    # a stop that was driven again has a later time than its neighbours in the run
    in_time = np.argsort(time_s, kind="stable")
    lit = in_time[np.all(np.isfinite(psd1_urad[in_time] + spot_um[in_time]), axis=1)]
    drift, u = psd1_urad.copy(), u_urad.copy()
    for column in range(2):
        found = slow_drift(
            time_s[lit],
            psd1_urad[lit, column],
            u_urad[lit, column],
            spot_um[lit, column],
            lever_mm[lit],
        )
        drift[lit, column], u[lit, column] = found.angle_urad, found.u_urad
    return drift, u


def _qd_at_distance(qd_um: Vector, lever: Vector, crosstalk: Crosstalk) -> Vector:
    beyond_m = 1e-3 * (lever - crosstalk.qd_calibrated_at_mm)
    corrected: Vector = qd_um / (1 + np.array(crosstalk.qd_gain_per_m) * beyond_m)
    return corrected


def _at_reference(
    vertex_um: Vector, angle: Vector, roll_urad: Vector, crosstalk: Crosstalk
) -> Vector:
    """Return the straightness at the reference point from the straightness at the cube's vertex
    (theory.md 9, crosstalk a and b)."""
    x, y, along = crosstalk.vertex_mm
    arm_um = 1e-3 * np.column_stack([-roll_urad * y, roll_urad * x])
    moved: Vector = vertex_um - arm_um - 1e-3 * along * angle
    return moved


def _clipped(head: Head, channels: Vector) -> Mask:
    """Return the samples (N,) in which the sum signal of one detector differs from the other
    two, because its spot is clipped."""
    if head.light is None:
        return np.zeros(len(channels), dtype=bool)
    dark = np.array([detector.dark[2] for detector in (head.qd, head.psd1, head.psd2)])
    share = (channels[:, 2::3] - dark) / np.array(head.light.sums)
    usual = np.median(share, axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        clipped: Mask = np.abs(share - usual).max(axis=1) > head.light.within * np.abs(
            usual[:, 0]
        )
    return clipped


_Fault = Literal[
    "fourdof-beam-blocked",
    "fourdof-out-of-range.saturated",
    "fourdof-out-of-range.clipped",
    "fourdof-out-of-range.uncalibrated",
    "fourdof-out-of-range.straightness",
    "fourdof-out-of-range.angle",
]


def _quality(
    seen: dict[str, Spots], straightness: Vector, angle: Vector, clipped: Mask
) -> tuple[Mask, tuple[Finding, ...]]:
    clipped = clipped & ~np.any([spot.blocked for spot in seen.values()], axis=0)
    findings = _remark("fourdof-out-of-range.clipped", clipped)
    usable = np.ones(len(straightness), dtype=bool)
    for name, spot in seen.items():
        usable &= ~(spot.blocked | spot.saturated | spot.outside)
        findings += _remark("fourdof-beam-blocked", spot.blocked, name=name)
        findings += _remark("fourdof-out-of-range.saturated", spot.saturated, name=name)
        findings += _remark("fourdof-out-of-range.uncalibrated", spot.outside, name=name)
    with np.errstate(invalid="ignore"):
        far: Mask = np.abs(straightness).max(axis=1) > STRAIGHTNESS_RANGE_UM
        tilted: Mask = np.abs(angle).max(axis=1) > ANGLE_RANGE_ARCSEC * URAD_PER_ARCSEC
    findings += _remark(
        "fourdof-out-of-range.straightness", far, limit_um=STRAIGHTNESS_RANGE_UM
    )
    findings += _remark("fourdof-out-of-range.angle", tilted, limit_arcsec=ANGLE_RANGE_ARCSEC)
    return usable & ~far & ~tilted & ~clipped, tuple(findings)


def _remark(key: _Fault, mask: Mask, **about: str | float) -> list[Finding]:
    if not mask.any():
        return []
    return [
        warning(
            key, count=int(mask.sum()), samples=len(mask), first=int(np.argmax(mask)), **about
        )
    ]
