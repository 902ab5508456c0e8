"""Commissioning of the four-degree-of-freedom head: the detectors' curves from a reference
stage."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.solver.fourdof.detector import Curve, CurveKind, curve_variable

Vector = NDArray[np.float64]

MAX_GAIN_ERROR = 0.05
"""Ordinary focal lengths and amplifiers are within 2 per cent; beyond 5 per cent a curve, a focal
length or a distance is wrong.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveFit:
    """A detector's curve, its residuals in um at every row of the calibration run, and its standard
    uncertainty at these rows (with that of the reference).
    """

    curve: Curve
    residual_um: Vector
    u_um: Vector


def fit_curve(
    reading: ArrayLike,
    shift_um: ArrayLike,
    *,
    kind: CurveKind = "polynomial",
    degree: int = 5,
    u_reference_um: float = 0.0,
) -> CurveFit:
    """Return the curve of a detector axis from the two columns of a run: normalised reading and
    spot shift in um.

    The shift is twice the reference stage's displacement on the QD, and ``2 f tan(angle)`` on PSD2.
    The fit is least squares in powers of the reading, or of the reading's inverse error function.
    Raises DataError unless the rows outnumber the coefficients by two, and where a reading does not
    determine its shift.
    """
    readings, shifts = (
        np.asarray(reading, dtype=np.float64),
        np.asarray(shift_um, dtype=np.float64),
    )
    variable = curve_variable(kind, readings)
    freedom = len(readings) - degree - 1
    if freedom < 2 or not np.isfinite(variable).all() or not np.isfinite(shifts).all():
        expected = message("at-least-rows-with", value=degree + 3)
        raise DataError(
            "calibration",
            expected=expected,
            found=message("such-rows", value=int(np.isfinite(variable).sum())),
        )
    design = np.vander(variable, degree + 1, increasing=True)
    # the columns are powers of a number below one: without scaling, the normal equations lose half
    # of their digits
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
