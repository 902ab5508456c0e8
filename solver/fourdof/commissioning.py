"""Commissioning of the four-degree-of-freedom head: signs and lever at standstill, and the detectors' curves.

At standstill only the laser's pointing moves, so ``QD / 2 = L * psd1`` and ``PSD2 / 2 = -psd1 / 2`` (theory.md 9): the
slopes of two regressions give the signs and the lever, and two distances give the dead path.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.messages import Message, message
from stepdiag.solver.fourdof.detector import Curve, CurveKind, curve_variable

Vector = NDArray[np.float64]

MIN_CORRELATION = 0.9
"""Below it the wobble of the laser drowns in other motion and a sign would be a guess."""
MAX_GAIN_ERROR = 0.05
"""Ordinary focal lengths and amplifiers are within 2 per cent; beyond 5 a curve, a focal length or a distance is wrong."""
U_SCALE_ASSUMED = MAX_GAIN_ERROR / np.sqrt(3.0)
"""Of a lever seen at one distance only: that it grows with the travel is then taken for granted, within what would be named."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Standstill:
    """One lateral axis at standstill while the pointing is wobbled: QD shift in um, PSD1 and PSD2 in urad, shape (N,).

    The QD's own sign must be right already: moving the target by hand towards + must read +.
    """

    travel_mm: float
    qd_um: Vector
    psd1_urad: Vector
    psd2_urad: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class SignsAndLever:
    """What the wobble tells about one lateral axis.

    ``psd1_sign`` and ``psd2_sign`` are the factors to put on these detectors' present signs. ``lever_mm`` and its
    ``u_lever_mm`` belong to the distances ``travel_mm``; ``dead_path_mm`` and ``lever_scale`` are the line through them (scale 1 assumed
    for a single distance). ``angle_gain`` is PSD2's gain over PSD1's, 1 when both focal lengths are right.
    """

    psd1_sign: Literal[1, -1]
    psd2_sign: Literal[1, -1]
    travel_mm: Vector
    lever_mm: Vector
    u_lever_mm: Vector
    dead_path_mm: float
    u_dead_path_mm: float
    lever_scale: float
    u_lever_scale: float | None
    angle_gain: float


def signs_and_lever(wobbles: Sequence[Standstill]) -> SignsAndLever:
    """Return signs, lever and gain of one lateral axis from standstills at one distance or more.

    Refused (DataError) where the wobble is too small to tell a sign, the distances contradict each other, or a gain is off by more than
    `MAX_GAIN_ERROR`.
    """
    lines = [_regression(wobble.psd1_urad, wobble.qd_um / 2, wobble.psd2_urad, wobble.travel_mm, "QD") for wobble in wobbles]
    angles = [_regression(wobble.psd1_urad, wobble.psd2_urad, wobble.qd_um, wobble.travel_mm, "PSD2") for wobble in wobbles]
    slope, u_slope = np.array(lines).T
    angle_slope, u_angle_slope = np.array(angles).T
    psd1_sign, relative = _common_sign(slope, "QD"), _common_sign(angle_slope, "PSD2")
    lever, u_lever = 1e3 * np.abs(slope), 1e3 * u_slope
    travel = np.array([wobble.travel_mm for wobble in wobbles])
    line = lever_line(travel, lever, u_lever)
    gain = float(np.mean(np.abs(angle_slope)))
    require_gain(line.scale, line.u_scale or 0.0, message("lever-growth", growth=line.scale))
    require_gain(gain, float(np.linalg.norm(u_angle_slope)) / len(u_angle_slope), message("gain-of-psd2", ratio=gain))
    return SignsAndLever(
        psd1_sign=psd1_sign,
        psd2_sign=1 if psd1_sign != relative else -1,
        travel_mm=travel,
        lever_mm=lever,
        u_lever_mm=u_lever,
        dead_path_mm=line.dead_path_mm,
        u_dead_path_mm=float(line.u_at(0.0)),
        lever_scale=line.scale,
        u_lever_scale=line.u_scale,
        angle_gain=gain,
    )


def _regression(x: Vector, y: Vector, third: Vector, travel_mm: float, name: str) -> tuple[float, float]:
    """Return the slope of y over x and its standard uncertainty; the slow drift of either has no say in the sign.

    PSD1's own noise would flatten a least-squares slope. The third detector saw the same wobble with a noise of its own: the slope is
    the quotient of what each has in common with it (instrumental variable; Fuller 1987, 1.4).
    """
    correlation, power = 0.0, 0.0
    if len(x) >= 3:
        x, y, third = x - x.mean(), y - y.mean(), third - third.mean()
        power = float(third @ x)
        both = np.sqrt(float(x @ x) * float(y @ y))
        correlation = abs(float(x @ y)) / both if both > 0 and power != 0.0 else 0.0
    if correlation < MIN_CORRELATION:
        raise DataError(
            message("signs-at-travel", name=name, travel_mm=travel_mm),
            expected=message("correlation-with-psd1-at", min_correlation=MIN_CORRELATION),
            found=message("correlation-over-samples", correlation=correlation, x=len(x)),
            remedy=message("wobble-laser-s-pointing"),
        )
    slope = float(third @ y) / power
    residual = y - slope * x
    return slope, float(np.sqrt(residual @ residual / (len(x) - 2) * (third @ third))) / abs(power)


def _common_sign(slopes: Vector, name: str) -> Literal[1, -1]:
    if (np.sign(slopes) != np.sign(slopes[0])).any():
        raise DataError(
            f"signs: {name}", expected=message("one-sign-at-every"), found=message("both-signs"), remedy=message("repeat-wobble")
        )
    return 1 if slopes[0] > 0 else -1


@dataclass(frozen=True, slots=True, kw_only=True)
class LeverLine:
    """The lever ``dead_path_mm + scale * distance``: ``u_mm`` is its standard uncertainty at ``u_at_mm``, the middle of the distances seen.

    There dead path and scale have independent errors; ``u_scale`` is None where one distance was seen and 1 taken for granted.
    """

    dead_path_mm: float
    scale: float
    u_mm: float
    u_at_mm: float
    u_scale: float | None

    def at(self, distance_mm: float) -> float:
        """Return the lever at a distance."""
        return self.dead_path_mm + self.scale * distance_mm

    def u_at(self, distance_mm: float) -> float:
        """Return the lever's standard uncertainty at a distance, by the distances that were seen."""
        return float(np.hypot(self.u_mm, (self.u_scale or 0.0) * (distance_mm - self.u_at_mm)))


def lever_line(travel_mm: Vector, lever_mm: Vector, u_lever_mm: Vector) -> LeverLine:
    """Return the weighted line of levers over the travel."""
    # a noiseless wobble must not divide by zero; a nanometre of lever is far below anything real
    weight = 1 / np.maximum(u_lever_mm, 1e-6) ** 2
    middle = float(np.average(travel_mm, weights=weight))
    there, u_there = float(np.average(lever_mm, weights=weight)), float(weight.sum() ** -0.5)
    if np.ptp(travel_mm) == 0.0:
        return LeverLine(dead_path_mm=there - middle, scale=1.0, u_mm=u_there, u_at_mm=middle, u_scale=None)
    power = float(np.sum(weight * (travel_mm - middle) ** 2))
    scale = float(np.sum(weight * (travel_mm - middle) * lever_mm)) / power
    return LeverLine(dead_path_mm=there - scale * middle, scale=scale, u_mm=u_there, u_at_mm=middle, u_scale=power**-0.5)


def require_gain(gain: float, u_gain: float, found: Message) -> None:
    """Raise DataError for a gain, a part of the right one, that is off by more than `MAX_GAIN_ERROR` and 2 u."""
    if not abs(gain - 1.0) <= MAX_GAIN_ERROR + 2.0 * u_gain:
        expected = message("gain-within", low=1.0 - MAX_GAIN_ERROR, high=1.0 + MAX_GAIN_ERROR)
        remedy = message("distances-swapped" if gain < 0.0 else "check-gains")
        raise DataError("gains", expected=expected, found=found, remedy=remedy)


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveFit:
    """A detector's curve, its residuals in um at every row and its standard uncertainty there (reference included)."""

    curve: Curve
    residual_um: Vector
    u_um: Vector


def fit_curve(
    reading: ArrayLike, shift_um: ArrayLike, *, kind: CurveKind = "polynomial", degree: int = 5, u_reference_um: float = 0.0
) -> CurveFit:
    """Return the curve of a detector axis from a two-column run: normalised reading and the spot shift it stands for.

    The shift is twice the reference stage's displacement on the QD, and ``2 f tan(angle)`` on PSD2. The fit is least
    squares in powers of the reading, or of its inverse error function. Refused (DataError) with fewer than two rows
    more than coefficients, or where a reading does not decide its shift.
    """
    readings, shifts = np.asarray(reading, dtype=np.float64), np.asarray(shift_um, dtype=np.float64)
    variable = curve_variable(kind, readings)
    freedom = len(readings) - degree - 1
    if freedom < 2 or not np.isfinite(variable).all() or not np.isfinite(shifts).all():
        expected = message("at-least-rows-with", value=degree + 3)
        raise DataError("calibration", expected=expected, found=message("such-rows", value=int(np.isfinite(variable).sum())))
    design = np.vander(variable, degree + 1, increasing=True)
    # powers up to the fifth of a number below one: scale the columns or the normal equations lose half their digits
    column = np.linalg.norm(design, axis=0)
    gain = np.linalg.pinv(design / column)
    coefficients = gain @ shifts / column
    residual = shifts - design @ coefficients
    scatter = float(np.sqrt(residual @ residual / freedom))
    leverage = np.einsum("ij,ji->i", design / column, gain)
    u = np.sqrt(scatter**2 * leverage + u_reference_um**2)
    curve = Curve(
        kind=kind,
        coefficients_um=tuple(coefficients.tolist()),
        low=float(readings.min()),
        high=float(readings.max()),
        u_um=float(np.sqrt(np.mean(u**2) + scatter**2)),
    )
    _require_monotonic(curve)
    return CurveFit(curve=curve, residual_um=residual, u_um=u)


def _require_monotonic(curve: Curve) -> None:
    grid = np.linspace(curve.low, curve.high, 501)
    steps = np.diff(curve.shift_um(grid))
    if not ((steps > 0).all() or (steps < 0).all()):
        raise DataError(
            "calibration",
            expected=message("shift-grows-with-reading"),
            found=message("curve-turns-back"),
            remedy=message("use-lower-degree-shorter"),
        )
