"""The tables of a control after new files are loaded over its old contents. Old tables must not
act, or stop acting, unexpectedly.

Loading overwrites only the tables in the new files. So the effect of an export is the effect of all
new and old tables that act afterwards. Two cases stop the export: an old table stays active beside
a new table of its function, or the correction of an old table is lost without a request.
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
"""Loss of a slope or of an end, in um, above which a warning is given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """The active tables of a control before and after loading. ``new`` contains the tables of the
    loaded files.
    """

    before: tuple[Table, ...] = ()
    after: tuple[Table, ...] = ()
    new: tuple[Table, ...] = ()

    @property
    def staying(self) -> tuple[Table, ...]:
        written = {table.identity for table in self.new}
        return tuple(
            table
            for table in self.after
            if table.identity not in written and table.value_um.any()
        )

    def lost(self) -> tuple[Table, ...]:
        """Return the earlier tables that loading removes or changes and whose function has no table
        in the new files.
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
        that were active during the measurement.

        If the machine was measured without compensation, an old table that stays is included if the
        result identifies its function.
        """
        if profile.machine.measured_with == "on":
            return self.after, self.before
        unseen = {table.identity for table in self.staying if not identifies(result, table)}
        return tuple(table for table in self.after if table.identity not in unseen), ()


def identifies(result: Result, table: Table) -> bool:
    """Return whether a result identifies every part of a table: its function, the slope of its
    function, and the angle of a product.
    """
    if table.multiplier is not None:
        return result.knows(angle_of(table.name))
    fold = FOLD_OTHER if table.name in FOLD_OTHER.values() else FOLD_DEFAULT
    return is_known(result, table.name, fold) and (
        table.name not in POSITIONING or result.errors[table.name].slope_identified
    )


def acts_with(one: Table, other: Table) -> bool:
    """Return whether ``one`` and ``other`` move the same output axis, and the movement by ``one``
    depends on every axis on which the movement by ``other`` depends.

    So a product acts together with the curves of both of its axes. Two products of the same axes
    also act together, because a new product may replace the correction of an old product in another
    place.
    """
    return one.output_axis == other.output_axis and _axes(other) <= _axes(one)


def _axes(table: Table) -> set[str]:
    lever = table.multiplier
    return {table.input_axis} if lever is None else {table.input_axis, lever.axis}


def standing_findings(
    standing: Standing, result: Result, profile: Profile
) -> Iterator[Finding]:
    """Yield an error for every old table that would act, or stop acting, unexpectedly.

    Yield a warning if a new table has no slope, or covers less travel than the old table that it
    replaces.
    """
    asked, off = set(profile.machine.functions), profile.machine.measured_with == "off"
    named = {
        table.name: table
        for table in standing.new
        if table.value_um.any() or table.name in asked
    }
    for table in standing.staying:
        if not _stands(table, standing.before):
            # Before loading, this old table was a part of another product, or had other numbers.
            yield error("old-table-left-active.part-left", label=table.label)
        elif table.name in named:
            yield error(
                "old-table-left-active", label=table.label, other=named[table.name].label
            )
        elif table.multiplier is not None and off and not identifies(result, table):
            yield from _twice(table, standing.new)
    for table in standing.lost():
        # The prediction contains the effect of a lost product that the result identifies.
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
    """Yield an error if an old product would act together with a new curve. The product was off
    during the measurement, so the curve contains a part of the product's correction.
    """
    for table in new:
        if table.multiplier is None and acts_with(product, table) and table.value_um.any():
            yield error(
                "old-table-left-active.beside-new", label=product.label, other=table.label
            )
            return


def _shrunk(table: Table, old: Sequence[Table], new: Sequence[Table]) -> Iterator[Finding]:
    """Yield a warning if old tables cover more travel than the new tables of the same function, and
    change their correction in the additional travel.
    """
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
    """Yield a warning if old tables correct a slope over the travel of ``table``. The caller has
    checked that the result does not identify this slope.
    """
    ends = table.position_mm[[0, -1]]
    rise_um = sum(
        float(np.diff(correction_um(each, ends, each.direction))[0]) for each in old
    ) / len({each.direction for each in old})
    if abs(rise_um) > NOTHING_UM:
        yield warning("old-table-lost.slope-of-table", label=table.label, rise_um=rise_um)


def _stands(table: Table, among: Iterable[Table]) -> bool:
    return any(
        each.identity == table.identity
        and np.array_equal(each.position_mm, table.position_mm)
        and np.array_equal(each.value_um, table.value_um)
        and same_lever(each, table)
        for each in among
    )


def unchanged(now: Iterable[Table], then: Iterable[Table]) -> bool:
    """Return whether the present tables move an axis as the earlier tables did, at the points of
    the present tables. A difference within the resolution of the tables, or a constant difference,
    is ignored.
    """
    every, rest = list(now), list(then)
    at = np.unique(np.concatenate([table.position_mm for table in every]))
    unit = max(table.quantum_um for table in (*every, *rest))
    moved = [summed_um(every, at, way) - summed_um(rest, at, way) for way in (1, -1)]
    return all(float(np.max(np.abs(each - moved[0][0]))) <= 2.0 * unit for each in moved)
