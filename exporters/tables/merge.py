"""Adds the table that was active during a measurement to the measured error (controllers.md 9).

The residual r was measured WITH the old correction A_old; without A_old the error would have been e
= r - A_old. A new table for e replaces the old table. The formula is valid for every sense and for
incremental data, because A_old is the movement by the control's law. Old and new error are
evaluated on the new grid. The planning then shifts the sum to zero at the reference and rounds it
once.
"""

from collections.abc import Sequence

import numpy as np

from stepdiag.base.errors import SafetyError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, joined, steps_um, summed_um


def merged(
    curves: Sequence[Curve], active: Sequence[Table], profile: Profile
) -> tuple[Curve, ...]:
    """Return the curves that the machine would have without the ``active`` tables.

    Raises ``SafetyError`` (``direction-unfit.active``) if an active table acts in a single
    direction and the new table would act in both.
    """
    return tuple(
        _merged(curve, [table for table in active if table.name == curve.name], profile)
        for curve in curves
    )


def _merged(curve: Curve, active: Sequence[Table], profile: Profile) -> Curve:
    if not active:
        return curve
    directional = any(table.direction for table in active)
    if directional and profile.machine.direction == "mean":
        raise SafetyError(
            f"{profile.source}: machine.direction",
            code="direction-unfit.active",
            expected=message("both-active", name=curve.name),
            found='"mean"',
            remedy=message("loses-reversal"),
        )
    grid = profile.grid_mm(curve.input_axis)
    forward, reverse = (_without(curve, active, grid, direction) for direction in (+1, -1))
    return Curve(
        name=curve.name,
        position_mm=grid,
        forward_um=forward,
        reverse_um=reverse if directional or curve.reverse_um is not None else None,
        u_um=np.interp(grid, curve.position_mm, curve.u_um),
        parts=(*curve.parts, "active table"),
        slope_known=curve.slope_known,
    )


def _without(
    curve: Curve, active: Sequence[Table], grid_mm: Vector, direction: int
) -> Vector:
    """Return the error of the machine without its tables, on a grid.

    The residual is known at the measured positions. If the table acts in steps, the residual
    contains these steps. So the steps are subtracted at the measured positions, and straight lines
    join the results. Then the old table without steps, its points joined by straight lines, is
    subtracted on the whole grid.
    """
    measured = curve.position_mm
    smooth = curve.toward(direction) - steps_um(active, measured, direction)
    straight = summed_um(map(joined, active), grid_mm, direction)
    return np.asarray(np.interp(grid_mm, measured, smooth) - straight)
