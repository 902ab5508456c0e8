"""The tables of a control after an export: the requested tables, and the old tables that loading
would keep or delete.

The export plans the tables and simulates loading over the machine's own files, until the plan no
longer changes. If a new table takes the place of an old table that was not requested, the old table
is written to a free place. An old product that stays active is included in the computation. If the
table of a function moves to another place, the old table of the function is filled with zeros.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date

import numpy as np

from stepdiag.base.errors import SafetyError
from stepdiag.base.messages import message
from stepdiag.base.result.result import Result
from stepdiag.exporters.safety.checks import Case
from stepdiag.exporters.safety.standing import Standing
from stepdiag.exporters.safety.verify import contents
from stepdiag.exporters.tables.angular import require_chain
from stepdiag.exporters.tables.controller import (
    Controller,
    Emptying,
    Pairing,
    Plan,
    plan_of,
)
from stepdiag.exporters.tables.curves import FUNCTIONS, KEPT, SQUARENESS_SLOPE, Curve
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.merge import merged
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, summed_um

_ROUNDS = 12
"""Largest number of planning rounds: each of nine functions can move once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Planned:
    case: Case
    plan: Plan
    standing: Standing


def planned(result: Result, control: Controller, profile: Profile, today: date) -> Planned:
    require_chain(result, profile)
    before = contents(control, (), profile).before
    kept: dict[str, Curve] = {}
    products: frozenset[str] = frozenset()
    for _ in range(_ROUNDS):
        case, plan = _once(result, control, profile, today, before, kept, products)
        standing = _loaded(case, before)
        asked = {*profile.machine.functions, *kept}
        lost = {table.name for table in standing.lost() if table.multiplier is None} - asked
        stay = frozenset(
            table.name for table in standing.staying if table.multiplier is not None
        )
        if not lost and stay == products:
            break
        kept |= {name: _as_it_was(name, before, profile) for name in lost}
        products = stay
    return Planned(case=case, plan=plan, standing=standing)


def _once(
    result: Result,
    control: Controller,
    profile: Profile,
    today: date,
    before: tuple[Table, ...],
    kept: dict[str, Curve],
    products: frozenset[str],
) -> tuple[Case, Plan]:
    on = profile.machine.measured_with == "on"
    gone = (
        [
            table
            for table in before
            if table.multiplier is not None and table.name not in products
        ]
        if on
        else []
    )
    names = [name for name in _names(result, control, profile) if name not in kept]
    fit = fitted(result, names, profile.machine.squareness_into, profile.zone, gone)
    curves: Sequence[Curve] = merged(fit.curves, before, profile) if on else fit.curves
    if kept:
        curves = sorted(
            (*curves, *kept.values()), key=lambda curve: FUNCTIONS.index(curve.name)
        )
    plan = plan_of(control, curves, fit.products, profile)
    settled = replace(profile, options=plan.options or profile.options)
    if before and isinstance(control, Emptying):
        plan = replace(
            plan,
            tables=(*plan.tables, *control.emptied(profile.existing, plan.tables, settled)),
        )
    case = Case(
        controller=control,
        profile=settled,
        result=result,
        curves=curves,
        tables=plan.tables,
        previous=before,
        today=today,
    )
    return case, plan


def _names(result: Result, control: Controller, profile: Profile) -> Sequence[str]:
    asked = profile.machine.functions
    if not isinstance(control, Pairing):
        return asked
    paired = control.paired(asked, profile.machine.squareness_into)
    return [name for name in paired if name in asked or result.knows(name)]


def _loaded(case: Case, before: tuple[Table, ...]) -> Standing:
    try:
        files = [
            file
            for file in case.controller.render(case.tables, case.profile)
            if file.role == "data"
        ]
    except SafetyError:  # reported when the files are written, after the checks of the plan
        return Standing(before=before, after=tuple(case.tables), new=tuple(case.tables))
    return contents(case.controller, files, case.profile)


def _as_it_was(name: str, before: Sequence[Table], profile: Profile) -> Curve:
    """Return the error that the old tables of a function correct. Raises ``SafetyError`` if the
    tables differ by direction and the profile asks for the mean.
    """
    old = [table for table in before if table.name == name and table.multiplier is None]
    grid = profile.grid_mm(name[2])
    forward, reverse = summed_um(old, grid, 1), summed_um(old, grid, -1)
    directional = not np.array_equal(forward, reverse)
    if directional and profile.machine.direction == "mean":
        raise SafetyError(
            f"{profile.source}: machine.direction",
            code="direction-unfit.active",
            expected=message("both-old", name=name),
            found='"mean"',
        )
    slopes = [square for square, functions in SQUARENESS_SLOPE.items() if name in functions]
    return Curve(
        name=name,
        position_mm=grid,
        forward_um=-forward,
        reverse_um=-reverse if directional else None,
        u_um=np.full(grid.shape, np.nan),
        parts=(KEPT, *(slopes if old[0].law.ends == "extended" else ())),
    )
