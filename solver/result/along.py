"""The displacement error along a straight body diagonal (ISO 230-6) that a result predicts: it did not use it, so it is a check."""

import numpy as np

from stepdiag.solver.errors import UsageError
from stepdiag.solver.geometry.volume import BODY_DIAGONALS, Vector, diagonal_direction, travel_signs
from stepdiag.solver.result.field import error_field_um
from stepdiag.solver.result.result import Result

BEYOND_MM = 1.0
"""So far may a target lie outside of the measured volume: functions are held there."""


def along_diagonal_um(result: Result, diagonal: str, distance_mm: Vector) -> Vector:
    """Return the error along a diagonal at distances (N,) from the corner where it starts, less that of the first, in um, shape (N,).

    Raises UsageError for a name that is no diagonal, or distances that leave the measured volume.
    """
    if diagonal not in BODY_DIAGONALS:
        raise UsageError("diagonal", expected=f"one of {', '.join(BODY_DIAGONALS)}", found=repr(diagonal))
    size, origin = np.asarray(result.volume.size_mm), np.asarray(result.volume.origin_mm)
    length = float(np.linalg.norm(size))
    if distance_mm.min() < -BEYOND_MM or distance_mm.max() > length + BEYOND_MM:
        found = f"{distance_mm.min():g} to {distance_mm.max():g} mm"
        remedy = "targets of a straight body diagonal count from the corner where it starts"
        raise UsageError(diagonal, expected=f"targets from 0 to {length:.3f} mm", found=found, remedy=remedy)
    along = diagonal_direction(result.volume, diagonal)
    corner = np.where(travel_signs(diagonal) > 0, origin, origin + size)
    points = corner + distance_mm[:, None] * along
    predicted: Vector = error_field_um(result, points) @ along
    relative: Vector = predicted - predicted[0]
    return relative
