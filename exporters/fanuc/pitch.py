"""FANUC stored pitch error compensation: increments between numbered points.

B-64303CM-1/01 1.3.1 and B-63980EN/01 p. 100: point N covers the section from N - 1 to N. The
control adds the increment of a point when the axis passes the point in +, also to the left of the
reference, and does not interpolate. The sum is added to the command, so A = -e. The absolute curve
is rounded to whole units before its increments are formed: increments that are rounded one by one
would accumulate their rounding errors.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import SafetyError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.exporters.fanuc.options import AxisPoints, FanucOptions
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import is_directional, sampled_um
from stepdiag.exporters.tables.tables import Law, Table

KIND = "pitch"
LAW = Law(sense="as-compensation", data="incremental", between="stepped")
LARGEST_MAGNIFICATION = 100
"""Largest value of parameter 3623 (magnification)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """Point numbers of an axis: reference (3620), lowest section (3621) and highest section
    (3622).
    """

    reference: int
    lowest: int
    highest: int

    @property
    def start(self) -> int:
        """Return the point number of the low end of the table. This point has no data; ``lowest``
        is the section above the low end.
        """
        return self.lowest - 1


def points_of(axis: AxisPoints, grid_mm: Vector, reference_mm: float, where: str) -> Points:
    """Return the point numbers of a grid. Raises ``SafetyError`` if the reference is not a point of
    the grid.
    """
    step = float(grid_mm[1] - grid_mm[0])
    below = (reference_mm - float(grid_mm[0])) / step
    if abs(below - round(below)) > 1e-6 or not 0 <= round(below) < len(grid_mm):
        raise SafetyError(
            where,
            code="reference-unfit.between",
            expected=message("on-grid", first=grid_mm[0], last_mm=grid_mm[-1], step=step),
            found=f"{reference_mm:g} mm",
            remedy=message("shift-to-reference"),
        )
    start = axis.reference_point - round(below)
    if start < 0:
        found = message("sections-below", point=axis.reference_point, count=round(below))
        raise SafetyError(
            where, code="reference-unfit.number", expected=message("room-below"), found=found
        )
    return Points(
        reference=axis.reference_point, lowest=start + 1, highest=start + len(grid_mm) - 1
    )


def pitch_tables(
    curve: Curve, profile: Profile, options: FanucOptions, already_um: Vector
) -> tuple[Table, ...]:
    """Return the pitch table of an axis, or one table per direction in the bidirectional form.

    ``already_um`` is the inclination compensation at the points of the grid. Raises ``SafetyError``
    if no magnification keeps every increment within the limit.
    """
    grid, forward, reverse = sampled_um(curve, profile)
    directional = is_directional(curve, profile)
    wanted = (
        [-forward - already_um, -reverse - already_um]
        if directional
        else [-forward - already_um]
    )
    unit = options.detection_unit_um
    at_reference = int(np.argmin(np.abs(grid - profile.axis(curve.input_axis).reference_mm)))
    offsets = [0.0, *(round(float(way[at_reference]) / unit) * unit for way in wanted[1:])]
    axis = options.axis(curve.input_axis, profile.source)
    counts, magnification = _units(wanted, offsets, axis, options, profile.source)
    points = points_of(
        axis,
        grid,
        profile.axis(curve.input_axis).reference_mm,
        f"{profile.source}: axes.{curve.input_axis}.reference_mm",
    )
    quantum = magnification * unit
    single = Table(
        kind=KIND,
        input_axis=curve.input_axis,
        output_axis=curve.output_axis,
        position_mm=grid,
        value_um=np.concatenate(([0.0], np.diff(counts[0]))) * quantum,
        quantum_um=quantum,
        law=LAW,
        reference_mm=profile.axis(curve.input_axis).reference_mm,
        place={"axis": axis.number, "first point": points.lowest},
    )
    if not directional:
        return (single,)
    opposite = replace(
        single,
        direction=-1,
        value_um=np.concatenate(([0.0], np.diff(counts[1]))) * quantum,
        offset_um=offsets[1],
        place={"axis": axis.number, "first point": axis.reverse_first_point},
    )
    return (replace(single, direction=1), opposite)


def _units(
    wanted: list[Vector],
    offsets: list[float],
    axis: AxisPoints,
    options: FanucOptions,
    source: str,
) -> tuple[list[NDArray[np.float64]], int]:
    tried = (
        [axis.magnification]
        if axis.magnification is not None
        else range(1, LARGEST_MAGNIFICATION + 1)
    )
    largest = 0
    for magnification in tried:
        quantum = magnification * options.detection_unit_um
        counts = [
            np.round((way - offset) / quantum)
            for way, offset in zip(wanted, offsets, strict=True)
        ]
        largest = max(int(np.max(np.abs(np.diff(way)))) for way in counts)
        if largest <= options.increment_limit:
            return counts, magnification
    raise SafetyError(
        f"{source}: fanuc",
        code="field-too-narrow.step",
        expected=message("increments-at-most", most=options.increment_limit),
        found=message("value-at-magnification", value=largest, factor=tried[-1]),
        remedy=message("larger-mag"),
    )
