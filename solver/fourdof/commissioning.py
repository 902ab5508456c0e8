"""Calibration curves of the 4-DOF head's detectors from a reference stage."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.solver.fourdof.detector import Curve, CurveKind, curve_variable

Vector = NDArray[np.float64]

MAX_GAIN_ERROR = 0.05
"""Largest accepted gain error; usual focal lengths and amplifiers are within 2 %. The cause of a
larger error is a wrong curve, focal length or distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveFit:
    """A detector's curve, and at every row of the calibration run the residual in um and the
    standard uncertainty including that of the reference."""

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
    """Return the curve of a detector axis from a normalised reading and the shift of the spot in um
    at each row.

    The shift is twice the displacement of the reference stage for the QD, and ``2 f tan(angle)``
    for PSD2. The curve is a least-squares polynomial of the reading or of its inverse error
    function. Raises DataError unless there are two more rows than coefficients, and if the curve is
    not monotonic.
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
