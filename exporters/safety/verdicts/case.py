"""A table with all tables that act together with it: their movement along an axis and over the
volume, and its regression on the requested movement.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.names import AXES
from stepdiag.base.volume import ROUNDING_MM, Vector, Volume, rms
from stepdiag.exporters.safety.verdicts.regression import SIZED, SPIKE, SURE_UM, Fit, regress
from stepdiag.exporters.safety.verdicts.wanted import centred
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.tables import (
    Table,
    correction_um,
    joined,
    steps_um,
)

POINTS = 61
"""Points along an axis at which two movements are compared."""
COVERED = 0.5
"""Least share of the measured travel that a table must cover."""
_SHIFTED = 3
"""Number of points at either end of a table that the search for a shift uses: a wrong point number
or reference shifts a table by few points.
"""
_EXCUSED = 0.25
"""Largest share of a correction that its uncertainty may explain."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableCase:
    table: Table
    together: Sequence[Table]
    before: Sequence[Table]
    volume: Volume

    @property
    def is_slope(self) -> bool:
        straight = len(self.table.position_mm) == 2 and self.table.law.ends == "extended"
        return straight and self.table.multiplier is None

    def fit(self, curve: Curve, shift_mm: float = 0.0, turn_um_mm: float = 0.0) -> Fit | None:
        """Return the regression of the table's correction on the correction that ``curve``
        requests; None if the table covers less than half of the measured travel.

        At its own points, a right table contains the sum of all earlier tables and of the requested
        curve. Between its points, straight lines are accepted. ``turn_um_mm`` is a slope that only
        rotates the workpiece, which is no error.
        """
        own = (
            curve.position_mm[[0, -1]] if self.is_slope else self.table.position_mm + shift_mm
        )
        at = _common_mm(curve, own)
        if at[-1] - at[0] < COVERED * np.ptp(curve.position_mm):
            return None
        before, error = self.sum_um(self.before, at - shift_mm), curve.at(at)
        held = np.interp(at, own, self.sum_um(self.before, own - shift_mm) - curve.at(own))
        asked = centred(held - before)
        moved = centred(self.sum_um(self.together, at - shift_mm) - before - turn_um_mm * at)
        size, unheld = rms(centred(error)), rms(centred(held - before + error))
        # The table is compared with this result, not with the machine.
        # So the uncertainty of the survey allows only a small difference.
        sure = max(
            SURE_UM, self.table.quantum_um, min(2.0 * typical_u(curve), _EXCUSED * size)
        )
        bent = asked - np.polyval(np.polyfit(at, asked, 1), at)
        spike = SPIKE * max(sure, 2.0 * typical_u(curve), SIZED * rms(bent), unheld)
        return replace(
            regress(moved, asked),
            size_um=size,
            sure_um=sure,
            unheld_um=unheld,
            spike_um=spike,
        )

    def place_mm(self, curve: Curve, fit: Fit) -> float:
        own = self.table.position_mm
        at = _common_mm(curve, own)[fit.largest_index]
        return float(own[np.argmin(np.abs(own - at))])

    def shifts_mm(self) -> list[float]:
        """Return the shifts that move one of the first points of the table to the low end of the
        travel, or one of its last points to the high end.
        """
        low, high = self.travel_mm(self.table.input_axis)[[0, -1]]
        own = self.table.position_mm[: 0 if self.table.law.ends == "extended" else None]
        shifts = np.concatenate([low - own[:_SHIFTED], high - own[-_SHIFTED:]])
        return [float(shift) for shift in shifts if abs(shift) > ROUNDING_MM]

    def slope_left_um_mm(self, curve: Curve) -> float:
        at = _common_mm(curve, curve.position_mm)
        left = self.sum_um(self.together, at) - self.sum_um(self.before, at) + curve.at(at)
        return float(np.polyfit(at, left, 1)[0])

    def unstepped(self, curve: Curve) -> Curve:
        """Return a residual without the steps of the tables that were active during the
        measurement, because no table needs these steps (`tables.merge`).
        """
        curves = [each for each in self.before if each.multiplier is None]
        steps = sum(steps_um(curves, curve.position_mm, way) / 2.0 for way in (1, -1))
        return replace(curve, forward_um=curve.mean_um - steps, reverse_um=None)

    def sum_um(self, tables: Sequence[Table], position_mm: Vector) -> Vector:
        """Return the movement by tables at positions, in um: the mean of both directions, with
        straight lines in place of steps.

        If the judged table is a curve, the movement by a product is its mean over the other axis.
        If the judged table is a product, the movement is the increase from the middle of the volume
        to the end of the lever.
        """
        return sum(
            (
                self._along(joined(each), position_mm, way) / 2.0
                for each in tables
                for way in (1, -1)
            ),
            np.zeros(position_mm.shape),
        )

    def _along(self, table: Table, position_mm: Vector, way: int) -> Vector:
        lever = table.multiplier
        if lever is None:
            return correction_um(table, position_mm, way)
        if lever.axis == table.input_axis:
            return correction_um(table, position_mm, way) * lever.at(position_mm)
        if table.input_axis == self.table.input_axis:
            along = correction_um(table, position_mm, way)
            across = lever.at(self.travel_mm(lever.axis))
        else:
            along = lever.at(position_mm)
            across = correction_um(table, self.travel_mm(table.input_axis), way)
        own = self.table.multiplier
        if own is None or own.axis == self.table.input_axis:
            return along * float(np.mean(across))
        even = np.linspace(-1.0, 1.0, POINTS)
        return along * float(np.mean(even * across)) / rms(even) ** 2

    def travel_mm(self, letter: str) -> Vector:
        return self.volume.even_mm(AXES.index(letter.lower()), POINTS)


def _common_mm(curve: Curve, own_mm: Vector) -> Vector:
    first, last = curve.position_mm[[0, -1]]
    return np.linspace(max(first, own_mm[0]), min(last, own_mm[-1]), POINTS)


def typical_u(curve: Curve) -> float:
    """Return the standard uncertainty of a curve in um (rms over its nodes), 0 if it is unknown."""
    return rms(curve.u_um[np.isfinite(curve.u_um)])
