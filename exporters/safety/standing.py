"""The contents of the control after loading files over its old contents, and their unexpected
parts.

A control discards nothing but overwritten tables. So the effect of an export is that of all tables
that act afterwards, new and old; an old table that stays active beside a new table of its function,
or whose correction is lost without a request, stops the export.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag.base.findings import Finding, error, warning
from stepdiag.base.result.result import POSITIONING, Result
from stepdiag.exporters.safety.verdicts.wanted import angle_of, is_known
from stepdiag.exporters.tables.curves import FOLD_DEFAULT, FOLD_OTHER
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, correction_um, same_lever, summed_um

NOTHING_UM = 1.0
"""The loss of a slope or of an end causes a warning if it exceeds this value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """The active tables of a control before and after loading, and the ``new`` tables among the
    latter.
    """

    before: tuple[Table, ...] = ()
    after: tuple[Table, ...] = ()
    new: tuple[Table, ...] = ()

    @property
    def staying(self) -> tuple[Table, ...]:
        """Return the active tables after loading that the new files did not write."""
        written = {table.identity for table in self.new}
        return tuple(
            table
            for table in self.after
            if table.identity not in written and table.value_um.any()
        )

    def lost(self) -> tuple[Table, ...]:
        """Return the earlier tables whose function no table corrects any more, or corrects in
        another way although the new files do not name it.
        """
        named, held = {table.name for table in self.new if table.value_um.any()}, self.staying
        return tuple(
            old
            for old in self.before
            if old.name not in named and old.value_um.any() and not _stands(old, held)
        )

    def acting(
        self, result: Result, profile: Profile
    ) -> tuple[tuple[Table, ...], tuple[Table, ...]]:
        """Return the tables whose effect on the error of a result must be predicted, and the tables
        active during its measurement.

        An old table that stays on a machine measured without it counts if the result identifies its
        function.
        """
        if profile.machine.measured_with == "on":
            return self.after, self.before
        unseen = {table.identity for table in self.staying if not identifies(result, table)}
        return tuple(table for table in self.after if table.identity not in unseen), ()


def identifies(result: Result, table: Table) -> bool:
    """Return whether a result identifies every part of a table: its function, the slope in the
    function, and the angle of a product.
    """
    if table.multiplier is not None:
        return result.knows(angle_of(table.name))
    fold = FOLD_OTHER if table.name in FOLD_OTHER.values() else FOLD_DEFAULT
    return is_known(result, table.name, fold) and (
        table.name not in POSITIONING or result.errors[table.name].slope_identified
    )


def acts_with(one: Table, other: Table) -> bool:
    """Return whether ``one`` acts together with ``other``: on the same output axis, and for each
    position of the axes by which ``other`` moves.

    A product acts together with the curves of both of its axes, and products of the same two axes
    count together, in any place: a new product may do the work of an old product.
    """
    return one.output_axis == other.output_axis and _axes(other) <= _axes(one)


def _axes(table: Table) -> set[str]:
    """Return the axes whose positions set the movement by a table: one, or two for a product."""
    lever = table.multiplier
    return {table.input_axis} if lever is None else {table.input_axis, lever.axis}


def standing_findings(
    standing: Standing, result: Result, profile: Profile
) -> Iterator[Finding]:
    """Yield an error for every old table that would act unexpectedly, or would unexpectedly stop
    acting.

    A warning for a new table without a slope, or with less reach, that replaces an old table with
    more.
    """
    asked, off = set(profile.machine.functions), profile.machine.measured_with == "off"
    named = {
        table.name: table
        for table in standing.new
        if table.value_um.any() or table.name in asked
    }
    for table in standing.staying:
        if not _stands(table, standing.before):
            # before, the old table multiplied another table, or had other numbers
            yield error("old-table-left-active.part-left", label=table.label)
        elif table.name in named:
            yield error(
                "old-table-left-active", label=table.label, other=named[table.name].label
            )
        elif table.multiplier is not None and off and not identifies(result, table):
            yield from _twice(table, standing.new)
    for table in standing.lost():
        # a lost product that the result identifies was compared with other products: the prediction
        # judges the effect of its loss
        unseen = table.multiplier is None or (off and not identifies(result, table))
        if table.name not in asked and unseen:
            yield error("old-table-lost", label=table.label)
    for table in standing.new:
        old = [
            each
            for each in standing.before
            if each.name == table.name and each.value_um.any()
        ]
        if old and table.multiplier is None and table.value_um.any():
            yield from (
                () if table.law.ends == "extended" else _shrunk(table, old, standing.new)
            )
            if off and not identifies(result, table):
                yield from slope_lost(table, old)


def _twice(product: Table, new: Sequence[Table]) -> Iterator[Finding]:
    """Yield an error where an old product that was off during the measurement stays active beside a
    new curve: the curve also contains its part.
    """
    for table in new:
        if table.multiplier is None and acts_with(product, table) and table.value_um.any():
            yield error(
                "old-table-left-active.beside-new", label=product.label, other=table.label
            )
            return


def _shrunk(table: Table, old: Sequence[Table], new: Sequence[Table]) -> Iterator[Finding]:
    """Yield a warning where old tables reach further than the new ones of the same function and are
    not flat there."""
    first = min(float(each.position_mm[0]) for each in new if each.name == table.name)
    last = max(float(each.position_mm[-1]) for each in new if each.name == table.name)
    for each in old:
        at, way = each.position_mm, each.direction or 1
        held_um = correction_um(each, np.clip(at, first, last), way)
        lost_um = float(np.max(np.abs(correction_um(each, at, way) - held_um)))
        if lost_um > NOTHING_UM:
            yield warning(
                "old-table-lost.ends",
                label=table.label,
                first_mm=table.position_mm[0],
                last_mm=table.position_mm[-1],
                low_mm=at[0],
                high_mm=at[-1],
                lost_um=lost_um,
            )
            return


def slope_lost(table: Table, old: Sequence[Table]) -> Iterator[Finding]:
    """Yield a warning where old tables contain a slope along the positions of a table, which the
    result does not identify.
    """
    ends = table.position_mm[[0, -1]]
    rise_um = sum(
        float(np.diff(correction_um(each, ends, each.direction))[0]) for each in old
    ) / len({each.direction for each in old})
    if abs(rise_um) > NOTHING_UM:
        yield warning("old-table-lost.slope-of-table", label=table.label, rise_um=rise_um)


def _stands(table: Table, among: Iterable[Table]) -> bool:
    """Return whether a table stands among others, in its place and with its numbers."""
    return any(
        each.identity == table.identity
        and np.array_equal(each.position_mm, table.position_mm)
        and np.array_equal(each.value_um, table.value_um)
        and same_lever(each, table)
        for each in among
    )


def unchanged(now: Iterable[Table], then: Iterable[Table]) -> bool:
    """Return whether tables move an axis like other tables, within one unit and except for an
    origin, at the points of the present tables.
    """
    every, rest = list(now), list(then)
    at = np.unique(np.concatenate([table.position_mm for table in every]))
    unit = max(table.quantum_um for table in (*every, *rest))
    moved = [summed_um(every, at, way) - summed_um(rest, at, way) for way in (1, -1)]
    return all(float(np.max(np.abs(each - moved[0][0]))) <= 2.0 * unit for each in moved)
