"""One table with all that acts together with it: what they move, along an axis and over the volume."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.messages import Message, message
from stepdiag.base.names import AXES
from stepdiag.base.volume import Vector, Volume
from stepdiag.exporters.safety.verdicts.measures import NODES, POINTS, centred, grid_mm
from stepdiag.exporters.safety.verdicts.verdict import Code, Judgement
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.tables import Table, correction_um, joined, mean_correction_um


@dataclass(frozen=True, slots=True)
class TableCase:
    """One table, all that act ``together`` with it, what acted ``before``, and the measured volume."""

    table: Table
    together: Sequence[Table]
    before: Sequence[Table]
    volume: Volume
    turn_um_mm: float = 0.0
    """What a turn of the workpiece adds to the slope of the curve: nobody's error."""

    @property
    def is_slope(self) -> bool:
        """Return whether the table is one number, the slope of a straight line."""
        return len(self.table.position_mm) == 2 and self.table.law.ends == "extended"

    def moved_um(self, position_mm: Vector) -> Vector:
        """Return what the tables add to what was active, mean of both directions, steps joined by straight lines, in um.

        Of a product that counts which is the same everywhere in the volume: its mean over the other axis.
        """
        return self.sum_um(self.together, position_mm) - self.sum_um(self.before, position_mm)

    def sum_um(self, tables: Sequence[Table], position_mm: Vector) -> Vector:
        """Return what some of these tables do at positions, mean of both directions, steps joined by straight lines, in um."""
        ways = [self._along(joined(each), position_mm, way) for each in tables for way in (1, -1)]
        return np.asarray(sum(ways, np.zeros(position_mm.shape)) / 2.0)

    def unstepped(self, curve: Curve) -> Curve:
        """Return a residual without the steps of what acted while it was measured: no table asks for them (`tables.merge`)."""
        stepped = [each for each in self.before if each.law.between == "stepped" and each.multiplier is None]
        if not stepped:
            return curve
        at = curve.position_mm
        steps = sum(
            ((correction_um(each, at, way) - correction_um(joined(each), at, way)) / 2.0 for each in stepped for way in (1, -1)), 0.0 * at
        )
        return replace(curve, forward_um=curve.at(at) - steps, reverse_um=None)

    def at_own_points_um(self, curve: Curve, at: Vector, shift_mm: float) -> tuple[Vector, Vector]:
        """Return what the tables add, and what the curve asks for, both as a table with the points of this one holds them.

        A table holds, at its own points, all that acted before and what the curve asks for, and straight lines between.
        """
        own = self.table.position_mm + shift_mm
        before = np.interp(at, own, self.sum_um(self.before, own - shift_mm))
        added = self.sum_um(self.together, at - shift_mm) - self.turn_um_mm * at - before
        return centred(added), centred(-np.interp(at, own, curve.at(own)))

    def _along(self, table: Table, position_mm: Vector, way: int) -> Vector:
        """Return what a table moves along the input axis of the judged one."""
        if table.multiplier is None:
            return correction_um(table, position_mm, way)
        own, by = self.table.input_axis, table.multiplier.axis
        moved = correction_um(table, position_mm if table.input_axis == own else self._travel_mm(table.input_axis), way)
        times = table.multiplier.at(position_mm if by == own else self._travel_mm(by))
        if table.input_axis != own:
            moved = np.full(position_mm.shape, np.mean(moved))
        return np.asarray(moved * (times if by == own else np.mean(times)))

    def _travel_mm(self, letter: str) -> Vector:
        axis = AXES.index(letter.lower())
        return self.volume.origin_mm[axis] + self.volume.size_mm[axis] * np.linspace(0.0, 1.0, POINTS)

    def moved_field_um(self) -> Vector:
        """Return what the tables add to what was active on the grid of `grid_mm`, along the output axis."""
        points, axis = grid_mm(self.volume), AXES.index(self.table.output_axis.lower())
        moved = mean_correction_um(self.together, points) - mean_correction_um(self.before, points)
        return np.asarray(moved[:, axis].reshape(NODES, NODES, NODES))

    def says(self, code: Code, words: Message, factor: float | None = None) -> Judgement:
        return Judgement(
            function=self.table.name,
            table=self.table,
            code=code,
            words=message("of-table", label=self.table.label, what=words),
            factor=factor,
        )
