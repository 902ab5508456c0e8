"""The shift of the spot from the raw sums and differences of a position-sensitive detector.

The curve of a quadrant detector with a Gaussian spot is an error function; that of a lateral-effect
detector is nearly linear. Both curves are polynomials of the normalised reading or of its inverse
error function (instruments.md section 2).
"""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

CurveKind = Literal["polynomial", "erf"]

_erf = np.vectorize(math.erf, otypes=[np.float64])


def inverse_erf(value: ArrayLike) -> Vector:
    """Return the inverse error function, NaN outside (-1, 1), shape like ``value``."""
    y = np.atleast_1d(np.asarray(value, dtype=np.float64))
    inside = np.abs(y) < 1
    safe = np.where(inside, y, 0.0)
    # Winitzki's closed form is exact to 4e-3; each Newton step squares the error.
    logarithm = np.log1p(-(safe**2))
    half = 2 / (math.pi * 0.147) + logarithm / 2
    x = np.sign(safe) * np.sqrt(np.sqrt(half**2 - logarithm / 0.147) - half)
    for _ in range(4):
        x = x - (_erf(x) - safe) * (math.sqrt(math.pi) / 2) * np.exp(x**2)
    result: Vector = np.where(inside, x, np.nan).reshape(np.shape(value))
    return result


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """The shift of the spot in um as a polynomial: coefficients in ascending powers of the
    normalised reading q (or of erf^-1(q)).

    ``low`` and ``high`` are the limits of the calibrated readings; ``u_um`` is the standard
    uncertainty of the curve.
    """

    kind: CurveKind = "polynomial"
    coefficients_um: tuple[float, ...] = (0.0, 1000.0)
    low: float = -1.0
    high: float = 1.0
    u_um: float = 0.0

    def shift_um(self, reading: ArrayLike) -> Vector:
        shift: Vector = np.polynomial.polynomial.polyval(
            curve_variable(self.kind, reading), np.array(self.coefficients_um)
        )
        return shift

    def covers(self, reading: Vector) -> Mask:
        """Return whether each reading is within the calibrated range."""
        inside: Mask = (reading >= self.low) & (reading <= self.high)
        return inside


def curve_variable(kind: CurveKind, reading: ArrayLike) -> Vector:
    """Return the variable of the polynomial, shape like ``reading``."""
    return inverse_erf(reading) if kind == "erf" else np.asarray(reading, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorAxis:
    """One axis of a detector. ``sign`` is -1 if fold mirrors and splitters reverse this axis
    (theory.md 9)."""

    sign: Literal[1, -1] = 1
    curve: Curve = field(default_factory=Curve)


@dataclass(frozen=True, slots=True, kw_only=True)
class Detector:
    """A detector with two axes and its limits of the sum signal; ``rotation_mrad`` is its roll
    about the beam, from x to y.

    ``dark`` contains the signals without light: difference x, difference y and sum.
    """

    x: DetectorAxis = field(default_factory=DetectorAxis)
    y: DetectorAxis = field(default_factory=DetectorAxis)
    sum_min: float = 0.0
    sum_max: float = math.inf
    rotation_mrad: float = 0.0
    dark: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spots:
    """Spot shifts in um, shape (N, 2), NaN without usable light, and the faults of each sample."""

    shift_um: Vector
    u_um: tuple[float, float]
    blocked: Mask
    saturated: Mask
    outside: Mask


def spots(detector: Detector, difference: Vector, total: Vector) -> Spots:
    """Return the spot of every sample from the detector's differences (N, 2) and sums (N,).

    The difference is divided by the sum, so that the laser's power has no effect. A sample with a
    difference larger than the sum is marked as saturated, because light cannot cause it.
    """
    blocked = ~(total > detector.sum_min)
    reading = (difference - np.array(detector.dark[:2])) / np.where(
        blocked, np.nan, total - detector.dark[2]
    )[:, None]
    with np.errstate(invalid="ignore"):
        saturated = (total > detector.sum_max) | (np.abs(reading) > 1).any(axis=1)
    reading = np.where((blocked | saturated)[:, None], np.nan, reading)
    axes = (detector.x, detector.y)
    shift = np.column_stack(
        [axis.sign * axis.curve.shift_um(reading[:, i]) for i, axis in enumerate(axes)]
    )
    outside = ~(blocked | saturated) & ~(
        detector.x.curve.covers(reading[:, 0]) & detector.y.curve.covers(reading[:, 1])
    )
    angle = 1e-3 * detector.rotation_mrad
    unroll = np.array(
        [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
    )
    return Spots(
        shift_um=shift @ unroll,
        u_um=(detector.x.curve.u_um, detector.y.curve.u_um),
        blocked=blocked,
        saturated=saturated,
        outside=outside,
    )
