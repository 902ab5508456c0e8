"""The values of a table from a curve: sampled on the profile's grid, zero at the reference, rounded
once.
"""

import numpy as np

from stepdiag.base.volume import Vector
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Law, Table


def sampled_um(curve: Curve, profile: Profile) -> tuple[Vector, Vector, Vector]:
    """Return the grid in mm, and the errors for travel in + and in - in um. The error in + is zero
    at the reference position of the axis.

    With ``machine.direction = "mean"`` both errors are the mean. With tables for both directions,
    the error in - at the reference position is the reversal. The interpolated table, and not the
    curve, is zero at the reference, because the reference need not be a point of the grid.
    """
    grid = profile.grid_mm(curve.input_axis)
    if profile.machine.direction == "mean":
        forward = reverse = curve.at(grid)
    else:
        forward, reverse = curve.at(grid, +1), curve.at(grid, -1)
    at_reference = np.interp(profile.axis(curve.input_axis).reference_mm, grid, forward)
    return grid, forward - at_reference, reverse - at_reference


def is_directional(curve: Curve, profile: Profile) -> bool:
    return profile.machine.direction == "both" and curve.reverse_um is not None


def quantised(value_um: Vector, quantum_um: float) -> Vector:
    """Return the values rounded to whole units of ``quantum_um``, without negative zeros."""
    return np.asarray(np.round(np.asarray(value_um) / quantum_um) * quantum_um + 0.0)


def absolute_tables(
    curve: Curve,
    profile: Profile,
    *,
    kind: str,
    law: Law,
    quantum_um: float,
    place: dict[str, int | str],
) -> tuple[Table, ...]:
    """Return the table of a curve, or two tables for two directions (+ first), for controls with
    absolute values.
    """
    grid, forward, reverse = sampled_um(curve, profile)
    ways = (
        ((1, forward), (-1, reverse)) if is_directional(curve, profile) else ((0, forward),)
    )
    return tuple(
        Table(
            kind=kind,
            input_axis=curve.input_axis,
            output_axis=curve.output_axis,
            position_mm=grid,
            value_um=quantised(-law.factor * error, quantum_um),
            quantum_um=quantum_um,
            law=law,
            reference_mm=profile.axis(curve.input_axis).reference_mm,
            direction=direction,
            place=place,
        )
        for direction, error in ways
    )
