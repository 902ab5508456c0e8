"""An optical model of the four-degree-of-freedom head (Feng, Zhang, Kuang 2008, Figs 1 to 4),
traced ray by ray.

A collimated beam leaves the source. On the moving unit a half mirror reflects a part of the beam to
lens 2 and PSD2. The transmitted part goes to a corner cube, comes back displaced, and is split
between the quadrant detector and lens 1 with PSD1. This module uses no equation of the paper: signs
and levers follow from the geometry.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stepdiag.virtual.physics.error_functions import Array
from stepdiag.virtual.physics.kinematics import Pose

Counts = NDArray[np.int64]
Pair = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wander:
    """A slow random motion in two lateral directions: four oscillations of random phase, together
    at most ``amplitude`` in each direction."""

    amplitude: float = 0.0
    period_s: float = 300.0
    seed: int = 0

    def at(self, time_s: Array) -> Array:
        """Return the motion at each time, shape (N, 2)."""
        rng = np.random.default_rng(self.seed)
        times = np.asarray(time_s, dtype=np.float64)
        motion = np.zeros((len(times), 2))
        for swing in range(1, 5):
            phase = rng.uniform(0.0, 2 * np.pi, size=2)
            motion += np.sin(
                2 * np.pi * swing * rng.uniform(0.8, 1.2) / self.period_s * times[:, None]
                + phase
            )
        return motion * (self.amplitude / 4.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotDetector:
    """Mounting and scale of a detector.

    ``sign`` is -1 for each detector axis that fold mirrors and splitters invert, otherwise 1.
    ``rotation_mrad`` is the roll of the detector, x towards y; ``gain`` is the gain of its
    differences. As shares of the full sum: ``noise`` is the noise of differences and sum, ``dark``
    their values without light, ``ceiling`` the largest sum of the electronics.
    """

    sign: Pair = (1.0, 1.0)
    rotation_mrad: float = 0.0
    gain: Pair = (1.0, 1.0)
    full_sum: float = 1_000_000.0
    noise: float = 2e-6
    dark: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ceiling: float = math.inf

    def face_mm(self, spot_mm: Array) -> Array:
        """Return the positions of a spot (N, 2) in the detector's own axes, shape (N, 2)."""
        cosine, sine = (
            math.cos(self.rotation_mrad * 1e-3),
            math.sin(self.rotation_mrad * 1e-3),
        )
        x, y = spot_mm[:, 0], spot_mm[:, 1]
        own = np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=1)
        faced: Array = own * np.array(self.sign)
        return faced

    def counts(self, response: Array, light: Array, rng: np.random.Generator) -> Counts:
        """Return difference x, difference y and sum of a detector, shape (N, 3), for normalised
        differences (N, 2) in -1 .. 1 and light (N,) in 0 .. 1."""
        ideal = np.column_stack(
            [response * np.array(self.gain) * light[:, None], light]
        ) + np.array(self.dark)
        noisy = ideal + rng.normal(scale=self.noise, size=ideal.shape)
        noisy[:, 2] = np.minimum(noisy[:, 2], self.ceiling)
        counted: Counts = np.round(noisy * self.full_sum).astype(np.int64)
        return counted


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadOptics:
    """The optics of the fixed unit. Radii are those of the Gaussian beam at 1/e2; the waist is at
    the source.

    ``spot_growth_per_m`` is a further relative growth of the radius per metre of distance, as with
    a poor collimator. ``qd_path_mm`` is the path from the source's plane back to the QD. A PSD is
    linear over ``psd_half_mm`` in each direction. ``psd*_defocus_mm`` is the distance of the PSD
    behind the focus of its lens, which is in the source's plane.
    """

    wavelength_nm: float = 635.0
    waist_mm: float = 2.0
    spot_growth_per_m: float = 0.0
    qd_path_mm: float = 60.0
    psd1_focal_mm: float = 150.0
    psd2_focal_mm: float = 150.0
    psd1_defocus_mm: float = 0.0
    psd2_defocus_mm: float = 0.0
    psd_half_mm: float = 2.0
    qd: SpotDetector = field(default_factory=SpotDetector)
    psd1: SpotDetector = field(default_factory=SpotDetector)
    psd2: SpotDetector = field(default_factory=SpotDetector)

    def spot_radius_mm(self, path_mm: Array) -> Array:
        rayleigh_mm = math.pi * self.waist_mm**2 / (self.wavelength_nm * 1e-6)
        poor = 1.0 + 0.5e-3 * self.spot_growth_per_m * path_mm
        radius: Array = self.waist_mm * poor * np.sqrt(1.0 + (path_mm / rayleigh_mm) ** 2)
        return radius


@dataclass(frozen=True, slots=True)
class HeadStand:
    """The mounting of the fixed unit: its position ``source_mm`` and three unit vectors, all (3,).
    The vectors are the direction ``beam``, and the directions ``right`` and ``up`` of the
    detectors."""

    source_mm: Array
    beam: Array
    right: Array
    up: Array

    def lateral(self, vectors: Array) -> Array:
        """Return the lateral components of vectors (N, 3), shape (N, 2)."""
        return np.stack([vectors @ self.right, vectors @ self.up], axis=1)

    def across(self, lateral: Array) -> Array:
        """Return lateral components (N, 2) as vectors, shape (N, 3)."""
        vectors: Array = lateral[:, :1] * self.right + lateral[:, 1:] * self.up
        return vectors


@dataclass(frozen=True, slots=True)
class Spots:
    """The spots of the light in mm, (N, 2) each: on the plane of the QD and in the focal planes of
    the PSDs; ``path_mm`` (N,) is the path to the QD."""

    qd_mm: Array
    psd1_mm: Array
    psd2_mm: Array
    path_mm: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """Disturbances of the beam: the pointing of the source (urad), and the bending by the air on
    the way out and back (urad per metre).

    ``wobble_urad`` is the change of the pointing by hand during the commissioning of the head.
    """

    pointing_urad: Wander = field(default_factory=Wander)
    wobble_urad: Wander = field(default_factory=Wander)
    bending_urad_m: Wander = field(default_factory=Wander)


class VirtualHead:
    """The head with fixed unit and moving unit. At the pose ``aligned`` and without disturbance,
    all spots are centred.

    ``vertex_mm`` is the corner cube's vertex in the coordinates of the moving unit. The half mirror
    is perpendicular to the beam at the aligned pose.
    """

    def __init__(
        self,
        optics: HeadOptics,
        stand: HeadStand,
        aligned: Pose,
        *,
        vertex_mm: Array | None = None,
        disturbance: Disturbance | None = None,
        seed: int = 0,
    ) -> None:
        self._optics = optics
        self._stand = stand
        self._vertex_mm = np.zeros(3) if vertex_mm is None else vertex_mm
        self._normal = aligned.local(-stand.beam)[0]
        self._disturbance = disturbance or Disturbance()
        self._rng = np.random.default_rng(seed)
        still = np.zeros((1, 2))
        self._centre = self._trace(aligned, still, still)

    def spots(self, pose: Pose, time_s: Array, wobbled: Array | None = None) -> Spots:
        """Return the spots, relative to their centred positions, for poses of the moving unit at
        these times."""
        pointing = self._disturbance.pointing_urad.at(time_s) * 1e-6
        if wobbled is not None:
            pointing = (
                pointing + wobbled[:, None] * self._disturbance.wobble_urad.at(time_s) * 1e-6
            )
        bending = self._disturbance.bending_urad_m.at(time_s) * 1e-9
        traced, centre = self._trace(pose, pointing, bending), self._centre
        return Spots(
            traced.qd_mm - centre.qd_mm,
            traced.psd1_mm - centre.psd1_mm,
            traced.psd2_mm - centre.psd2_mm,
            traced.path_mm,
        )

    def channels(
        self,
        pose: Pose,
        time_s: Array,
        light: Array | None = None,
        wobbled: Array | None = None,
    ) -> Counts:
        """Return x, y and sum of QD, PSD1 and PSD2 in counts, shape (N, 9).

        ``light`` (N,) is 1 for a free beam, ``wobbled`` (N,) 1 for a wobbled pointing.
        """
        optics = self._optics
        spots = self.spots(pose, time_s, wobbled)
        light = np.ones(len(spots.path_mm)) if light is None else light
        radius_mm = optics.spot_radius_mm(spots.path_mm)[:, None]
        readings = [
            optics.qd.counts(
                quadrant_response(optics.qd.face_mm(spots.qd_mm), radius_mm), light, self._rng
            ),
            optics.psd1.counts(
                optics.psd1.face_mm(spots.psd1_mm) / optics.psd_half_mm, light, self._rng
            ),
            optics.psd2.counts(
                optics.psd2.face_mm(spots.psd2_mm) / optics.psd_half_mm, light, self._rng
            ),
        ]
        return np.concatenate(readings, axis=1)

    def _trace(self, pose: Pose, pointing: Array, bending_per_mm: Array) -> Spots:
        """Return the spots of the ray that goes out and comes back from cube and mirror.
        ``bending_per_mm`` is the change of the ray's slope per mm, equal out and back."""
        stand, optics = self._stand, self._optics
        vertex = pose.point_mm(self._vertex_mm)
        out = stand.beam + stand.across(pointing)
        distance = ((vertex - stand.source_mm) @ stand.beam)[:, None]
        bow = stand.across(0.5 * bending_per_mm * distance**2)
        bend = stand.across(bending_per_mm * distance)
        met = stand.source_mm + out * distance + bow
        arriving = out + bend
        from_cube = -arriving + bend
        at_source = 2.0 * vertex - met - arriving * distance + bow
        mirrored = self._mirrored(pose, arriving)
        back = -(mirrored @ stand.beam)[:, None]
        from_mirror = mirrored / back + bend
        mirror_at_source = met + mirrored / back * distance + bow
        return Spots(
            qd_mm=stand.lateral(at_source - stand.source_mm + from_cube * optics.qd_path_mm),
            psd1_mm=_focused(
                stand, at_source, from_cube, optics.psd1_focal_mm, optics.psd1_defocus_mm
            ),
            psd2_mm=_focused(
                stand,
                mirror_at_source,
                from_mirror,
                optics.psd2_focal_mm,
                optics.psd2_defocus_mm,
            ),
            path_mm=2.0 * distance[:, 0] + optics.qd_path_mm,
        )

    def _mirrored(self, pose: Pose, arriving: Array) -> Array:
        normal = pose.vector(self._normal)
        reflected: Array = (
            arriving - 2.0 * np.einsum("ni,ni->n", arriving, normal)[:, None] * normal
        )
        return reflected


def _focused(
    stand: HeadStand, at_lens: Array, direction: Array, focal_mm: float, defocus_mm: float
) -> Array:
    """Return the position of a spot behind a thin lens in the source's plane: height x and slope s
    give x + (f + d)(s - x / f)."""
    height = stand.lateral(at_lens - stand.source_mm)
    slope = stand.lateral(direction)
    spot: Array = height + (focal_mm + defocus_mm) * (slope - height / focal_mm)
    return spot


def dark_channels(optics: HeadOptics, count: int, rng: np.random.Generator) -> Counts:
    """Return the values of the detectors in counts without light, shape (count, 9)."""
    nothing, light = np.zeros((count, 2)), np.zeros(count)
    detectors = (optics.qd, optics.psd1, optics.psd2)
    return np.concatenate(
        [detector.counts(nothing, light, rng) for detector in detectors], axis=1
    )


_erf = np.vectorize(math.erf, otypes=[np.float64])


def quadrant_response(shift_mm: Array, radius_mm: Array) -> Array:
    """Return (right - left) / sum of an ideal quadrant cell for a Gaussian spot: erf(sqrt(2) shift
    / radius), shape like ``shift_mm``."""
    response: Array = _erf(math.sqrt(2.0) * shift_mm / radius_mm)
    return response
