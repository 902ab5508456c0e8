"""Test, by readings of ten minutes, whether each table in the control acts as the exported table.

    change = sum over functions of factor * effect of the function's tables on the readings +
    origin, mirror tilts and scale of the new set-up

The factor is 1 for a table that acts as exported, -1 for a table with the opposite sign, 0 for an
inactive table, and 1/2 or 2 for a wrong weight or a double loading. If two axes were exchanged, the
tables of each axis act along the other axis. One fault affects one function, all functions of a
kind of table, or all functions. The search adds one fault at a time, as long as each fault makes
the readings `NAMED` times as likely as before.

Any other factor means a table of another size. A table of another size is wrong if both of these
conditions are true; it is undecided if only condition 1 is true: (1) Its size differs by more than
`verdicts.regression` tolerates. (2) This size is `SURE` times as likely as the nearest state.
Condition 2 is tested twice: with the factors of all other tables fixed by their states, and with
these factors as unknowns.

The state of a table is decided if each other state makes the readings `SURE` times less likely, for
this table alone and for all tables of its kind. The report shows the factor of the table with U. If
the most likely factor is -1, 0, 1/2 or 2, all tables with this factor get one common estimate, and
the factors of all other tables are fixed by their states. In every other case, the factors of the
other tables are unknowns of the same regression. The tables are kept if each table is right, or is
undecided but too small to matter: its possible states then differ by no more than U of the survey.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Literal

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.readings.readings import Readings
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector, rms
from stepdiag.exporters.proof.change import (
    changes,
    columns,
    exchanged,
    regressed,
    unit_u,
    ways_of,
)
from stepdiag.exporters.safety.verdicts.regression import SIZED, Measured
from stepdiag.exporters.safety.verdicts.verdict import Code
from stepdiag.exporters.tables.tables import Table

STATES: tuple[tuple[Code, float], ...] = (
    ("right", 1.0),
    ("sign-turned", -1.0),
    ("missing", 0.0),
    ("scaled", 0.5),
    ("scaled", 2.0),
)
SURE, NAMED = 20.0, 400.0
"""Least odds for one state of a table against another state, and least odds for a fault against no
fault. The second value is higher, because more than fifty faults are tried.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proved:
    """The verdict on the tables of one function: the ``factor`` with its standard uncertainty
    ``u``, and ``seen_um``, the rms of the expected effect on the readings.

    ``code`` is None if the run does not decide the state. ``harmless`` is then true if the possible
    states differ by no more than U of the survey.
    """

    function: str
    kind: str
    code: Code | None
    factor: float
    u: float
    seen_um: float
    harmless: bool = True

    @property
    def state(self) -> Literal["right", "wrong", "undecided"]:
        if self.code is None:
            return "right" if self.harmless else "undecided"
        return "right" if self.code == "right" else "wrong"


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """The verdicts of a proof run.

    ``further`` contains the setups of the survey that show the undecided tables best. A repetition
    of the proof run would not help, because the mirror tilts of its set-up stay unknown.
    """

    tables: tuple[Proved, ...]
    sigma_um: float
    further: tuple[str, ...] = ()

    @property
    def action(self) -> Literal["keep", "restore", "undecided"]:
        states = {each.state for each in self.tables}
        if "wrong" in states:
            return "restore"
        return "undecided" if "undecided" in states else "keep"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Explained:
    states: Mapping[str, tuple[Code, float]]
    predicted_um: Vector


class _Case:
    def __init__(
        self,
        before: Readings,
        after: Readings,
        acting: Sequence[Table],
        replaced: Sequence[Table],
    ) -> None:
        self.ways, self.change_um = changes(before, after)
        self.tables = [table for table in acting if table.value_um.any()]
        self.nothing = np.zeros(len(self.change_um))
        if not self.ways:
            raise DataError(
                message("proof-run"),
                expected=message("proof-stops"),
                found=", ".join(dict.fromkeys(after.setup)),
            )
        old = columns(replaced, self.ways)
        self.seen = columns(self.tables, self.ways)
        # The tables that were active during the survey are replaced: their effect is missing
        # in the new readings, or the new tables include it.
        self.change_um = self.change_um + sum(old.values(), self.nothing)
        if not self.seen:
            raise DataError(
                message("proof-run"), expected=message("proof-sees"), found=message("nothing")
            )
        self.fit: Measured = regressed(self.ways, self.change_um, self.seen)
        self.kinds = {table.name: table.kind for table in self.tables}
        self.groups = self._groups()

    def _groups(self) -> list[tuple[str, ...]]:
        kinds = [
            tuple(name for name in self.seen if self.kinds[name] == kind)
            for kind in dict.fromkeys(self.kinds[name] for name in self.seen)
        ]
        return list(
            dict.fromkeys([*((name,) for name in self.seen), *kinds, tuple(self.seen)])
        )

    def misfit(self, explained: _Explained) -> float:
        return self.fit.misfit(explained.predicted_um)

    def parts(self, explained: _Explained, names: Sequence[str]) -> tuple[Vector, Vector]:
        together = sum((self.seen[name] for name in names), self.nothing)
        own = sum(
            (explained.states[name][1] * self.seen[name] for name in names), self.nothing
        )
        return together, explained.predicted_um - own

    def shown(self, best: _Explained, name: str) -> tuple[float, float]:
        """Return the factor of a function's tables and its standard uncertainty, estimated for
        these tables alone or together with all tables in the same state.
        """
        state = best.states[name]
        alike = [each for each, one in best.states.items() if one == state]
        if state[0] in ("right", "axes-swapped"):
            alike = [name]
        elif state in STATES:
            return self.fit.factor_of(*self.parts(best, alike))
        others = [seen for each, seen in self.seen.items() if each not in alike]
        together = sum((self.seen[each] for each in alike), self.nothing)
        return self.fit.factor_of(together, self.nothing, others)

    def right(self) -> _Explained:
        return _Explained(
            states=dict.fromkeys(self.seen, STATES[0]),
            predicted_um=sum(self.seen.values(), self.nothing),
        )

    def others(self, than: _Explained) -> Iterator[_Explained]:
        """Yield explanations with one further cause: another factor for a group of tables, or two
        exchanged axes.
        """
        for group in self.groups:
            for state in STATES:
                if any(than.states[name] != state for name in group) and all(
                    than.states[name][0] != "axes-swapped" for name in group
                ):
                    added = [
                        (state[1] - than.states[name][1]) * self.seen[name] for name in group
                    ]
                    yield _Explained(
                        states={**than.states, **dict.fromkeys(group, state)},
                        predicted_um=than.predicted_um + sum(added),
                    )
        if all(state == STATES[0] for state in than.states.values()):
            kinds = dict.fromkeys(self.kinds.values())
            for some, pair in product(
                dict.fromkeys([*((kind,) for kind in kinds), tuple(kinds)]),
                combinations("XYZ", 2),
            ):
                yield self._exchanged(than, some, *pair)

    def sized(self, than: _Explained) -> Iterator[_Explained]:
        """Yield explanations with the best factor for a group of tables, if this factor changes the
        state of a table in the group.
        """
        for group in self.groups:
            if all(than.states[name][0] != "axes-swapped" for name in group):
                together, beside = self.parts(than, group)
                factor, u = self.fit.factor_of(together, beside)
                state = (_code(factor, u), factor)
                if any(than.states[name][0] != state[0] for name in group):
                    yield _Explained(
                        states={**than.states, **dict.fromkeys(group, state)},
                        predicted_um=beside + factor * together,
                    )

    def _exchanged(
        self, than: _Explained, kinds: Sequence[str], one: str, other: str
    ) -> _Explained:
        mine = [
            table
            for table in self.tables
            if table.kind in kinds and {table.input_axis, table.output_axis} & {one, other}
        ]
        turned = columns([exchanged(table, one, other) for table in mine], self.ways)
        names = {table.name for table in mine if table.name in self.seen}
        moved = sum(turned.values(), self.nothing) - sum(
            (self.seen[name] for name in names), self.nothing
        )
        swapped: tuple[Code, float] = ("axes-swapped", 0.0)
        return _Explained(
            states={**than.states, **dict.fromkeys(names, swapped)},
            predicted_um=than.predicted_um + moved,
        )


def prove(
    result: Result,
    before: Readings,
    after: Readings,
    acting: Sequence[Table],
    replaced: Sequence[Table] = (),
) -> Proof:
    """Return the verdicts of a proof run. ``before`` contains the readings of the survey with this
    ``result``, ``after`` the readings of the proof run.

    The tables in ``acting`` should be active in the proof run. The tables in ``replaced`` were
    active in the survey. Raises ``DataError`` if survey and proof run share no stops, or if no
    table changes the readings.
    """
    case = _Case(before, after, acting, replaced)
    best = case.right()
    for _ in range(len(case.seen)):
        found = min(case.others(best), key=case.misfit, default=best)
        sized = min(case.sized(best), key=case.misfit, default=found)
        if case.misfit(found) - case.misfit(sized) > 2.0 * np.log(
            SURE
        ):  # a free factor always explains more than a state does
            found = sized
        if case.misfit(best) - case.misfit(found) < 2.0 * np.log(NAMED):
            break
        best = found
    unseen = dict.fromkeys(table.name for table in case.tables if table.name not in case.seen)
    proved = (
        *(_proved(case, best, name, result) for name in case.seen),
        *(_unseen(case, name, result) for name in unseen),
    )
    return Proof(
        tables=proved,
        sigma_um=case.fit.sigma_um,
        further=_further(case, before, after, proved),
    )


def _further(
    case: _Case, before: Readings, after: Readings, proved: Sequence[Proved]
) -> tuple[str, ...]:
    """Return the setups outside the proof run that give the undecided tables the smallest u. The
    list is as short as possible, and covers every undecided table that the survey can show.
    """
    missing = {each.function for each in proved if each.state == "undecided"}
    ways = {
        name: [way for way, _ in ways_of(before, [name])]
        for name in dict.fromkeys(before.setup)
        if name not in after.setup
    }
    shown = {name: missing & columns(case.tables, own).keys() for name, own in ways.items()}
    driven, found = list(case.ways), list[str]()

    def left(setup: str) -> tuple[int, float]:
        seen_u = unit_u(case.tables, [*driven, *ways[setup]])
        us = [u for name, u in seen_u.items() if name in missing]
        return -len(us), max(us)

    rest = [name for name, seen in shown.items() if seen]
    while rest:
        found.append(min(rest, key=left))
        driven += ways[found[-1]]
        rest = [name for name in rest if shown[name] - columns(case.tables, driven).keys()]
    return tuple(found)


def _proved(case: _Case, best: _Explained, name: str, result: Result) -> Proved:
    seen = case.seen[name]
    code, factor = best.states[name]
    least = case.misfit(best) + 2.0 * np.log(SURE)
    remain = {
        other.states[name]
        for other in case.others(best)
        if other.states[name][0] != code and case.misfit(other) < least
    }
    states = [*remain, (code, factor)]
    off = max(
        np.inf if state == "axes-swapped" else abs(share - 1.0) for state, share in states
    )
    shown, u = case.shown(best, name)
    # A size without a known cause is undecided if sizes of the other tables can explain it.
    unsized = (code, factor) not in STATES and code == "scaled" and _code(shown, u) != code
    return Proved(
        function=name,
        kind=case.kinds[name],
        code=None if remain or unsized else code,
        factor=shown,
        u=u,
        seen_um=rms(seen - np.mean(seen)),
        harmless=bool(off * _size_um(case, name) <= _unknown_um(result, name)),
    )


def _unseen(case: _Case, name: str, result: Result) -> Proved:
    return Proved(
        function=name,
        kind=case.kinds[name],
        code=None,
        factor=0.0,
        u=1.0,
        seen_um=0.0,
        harmless=bool(2.0 * _size_um(case, name) <= _unknown_um(result, name)),
    )


def _size_um(case: _Case, name: str) -> float:
    values = [table.absolute_um for table in case.tables if table.name == name]
    return rms(np.concatenate([each - np.mean(each) for each in values]))


def _code(factor: float, u: float) -> Code:
    """Return the state (right, opposite sign, missing) whose factor is nearest. Return "scaled" if
    the difference from this factor is larger than tolerated and makes the nearest state `SURE`
    times less likely.
    """
    code, exact = min(STATES[:3], key=lambda state: abs(state[1] - factor))
    within = max(SIZED, float(np.sqrt(2.0 * np.log(SURE))) * u)
    return code if abs(factor - exact) <= within else "scaled"


def _unknown_um(result: Result, function: str) -> float:
    """Return U of a function from the readings, as rms over the positions in um; 0 for an unknown
    function. For a product, U is that of the curve in its name (``EYX`` of ``EYX*Z``).
    """
    found = result.errors.get(function[:3])
    if found is None:
        return 0.0
    u = found.u if found.u_readings is None else found.u_readings
    return 0.0 if u is None else 2.0 * rms(u)
