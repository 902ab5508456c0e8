"""The test whether the compensation was on during the measurement. The test compares the result
with the statement of the survey file.

An old table of a function was made from an error e, and may have k times the right size today. For
this function the survey measures

    measured = e (1 +- CHANGED)                 compensation off
    measured = e (1 +- CHANGED) - k e           compensation on

With old = k e, the share a = <measured, old> / <old, old> is 1 / k for "off" and 1 / k - 1 for
"on". The size k is log-normal around 1 (`SIZES`). All tables of a kind have the same k. The
uncertainty of the result gives an uncertainty of the share. The odds of "on" against "off" are the
ratio of the likelihoods of all shares of a kind, integrated over k.

A third explanation is a table from another source: from another machine, or from before a repair.
Such a table can have any share (`ALIEN`), and the measured function has another shape than the
table. A difference of shape above the share `CHANGED` of e is evidence against "on" and against
"off". The odds are `ALIEN_ODDS` that all tables of a kind come from another source. A single table
of a kind comes from another source with the probability `ALIEN_ODDS`, so a single repaired function
is no evidence about the other functions.

If all tables of a kind fit one state and a single table fits the opposite state, the switch of this
table was probably forgotten. A finding names the table. The size k of the other tables is used for
this comparison.

A statement with odds of `CERTAIN` against it is refused. A statement with odds of `CERTAIN` for it
counts as confirmed by the data. Between these odds the data do not decide. For example, a table
with the share 1/2 can be off and twice the right size (k = 2), or on and two thirds of the right
size (k = 2/3). A warning asks a person in two cases: the odds against a statement exceed `DOUBTED`,
or a single table has the opposite state. Without a confirmed statement, the prediction is valid
only after a proof run. Functions are judged by kind of table, so that a single forgotten switch can
be found.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import msgspec
import numpy as np

from stepdiag.base.findings import Finding, finding, warning
from stepdiag.base.messages import message
from stepdiag.base.result.field import from_first
from stepdiag.base.result.result import Function, Result
from stepdiag.base.volume import Vector, rms
from stepdiag.exporters.safety.verdicts.regression import regress
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.curves import SQUARENESS_SLOPE
from stepdiag.exporters.tables.fit import line_um_mm
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, summed_um

SIZES = 0.25
"""Standard deviation of the logarithm of k: ordinary old tables have 0.7 to 1.4 of the right
size.
"""
CHANGED = 0.15
"""Change of a function from the survey of an old table to the present survey, as a share of the
function.
"""
SEEN = 0.3
"""Largest standard uncertainty of a share that is evidence. With a larger uncertainty, the old
table is no larger than the uncertainty of the survey.
"""
CERTAIN, DOUBTED = 20.0, 4.0
"""Odds at which the data confirm or contradict a statement, and odds against a statement above
which a warning asks a person.
"""
FEWEST_BESIDE = 2
"""Number of other tables of a kind that must show the size before a single table is judged."""
CONTRADICTED: Final = "compensation-contradicted"
UNPROVEN: Final = "compensation-contradicted.unproven"
"""Code of all findings about the state, and key of the finding that requires a proof run."""
ALIEN, ALIEN_ODDS = 1.0, 0.1
"""Standard deviation of the share of a table from another source, and the odds of such a table
relative to one of the states.
"""
_LOG_K = np.linspace(-1.0, 1.0, 81)


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """Share of an old table of a function in the survey: 1 for an inactive table, 0 for a right
    active table.

    ``rest`` is the part of the function with another shape than the table, as a share of the table;
    0 for a squareness, which is a single number.
    """

    name: str
    kind: str
    value: float
    u: float
    rest: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A group of tables: their ``shares``, the mean share with its standard uncertainty, and the
    ``odds`` of "on" and of "off"."""

    kind: str
    shares: tuple[Share, ...]
    value: float
    u: float
    odds: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(share.name for share in self.shares)


def shares(result: Result, tables: Sequence[Table]) -> list[Share]:
    """Return the share of every function and every squareness whose old tables are large enough to
    be visible in a result.
    """
    old = [table for table in tables if table.multiplier is None and table.value_um.any()]
    named = {
        name: [table for table in old if table.name == name]
        for name in dict.fromkeys(table.name for table in old)
    }
    found = [
        _of_function(result.errors[name], name, mine)
        for name, mine in named.items()
        if name in result.errors
    ]
    found += [_of_squareness(result, name, named) for name in SQUARENESS_SLOPE]
    return [share for share in found if share is not None]


def _of_function(function: Function, name: str, tables: Sequence[Table]) -> Share | None:
    """Return the share of the old tables of a function. A straightness is compared without its
    slope, which depends on the directions of the axes.
    """
    if function.value is None or function.u is None or len(function.value) < 2:
        return None
    at = function.position_mm
    shape = name[1] != name[2] or not function.slope_identified
    measured, old = (
        from_first(each, at, shape=shape) for each in (function.value, _error_um(tables, at))
    )
    if not old.any():
        return None
    u = float(np.abs(old) @ function.u) / float(
        old @ old
    )  # the errors of all nodes have the same sign: this is their largest possible effect
    fit = regress(measured, old)
    return _seen(name, tables, fit.factor, u, fit.rest_um / fit.asked_um)


def _of_squareness(
    result: Result, name: str, named: Mapping[str, Sequence[Table]]
) -> Share | None:
    found = result.squareness.get(name)
    tables = [
        table for function in SQUARENESS_SLOPE[name] for table in named.get(function, ())
    ]
    if found is None or found.value is None or found.u is None or not tables:
        return None
    old_urad = 0.0
    for function, sign in SQUARENESS_SLOPE[name].items():
        mine = named.get(function, ())
        if mine:
            ends = np.array(
                [
                    min(table.position_mm[0] for table in mine),
                    max(table.position_mm[-1] for table in mine),
                ]
            )
            old_urad += (
                sign * 1000.0 * float(np.diff(_error_um(mine, ends))[0]) / float(np.ptp(ends))
            )
    if old_urad == 0.0:
        return None
    lines_urad, u_urad = (
        _lines_urad(result, name) if tables[0].law.ends == "extended" else (0.0, 0.0)
    )
    return _seen(
        name,
        tables,
        (found.value + lines_urad) / old_urad,
        float(np.hypot(found.u, u_urad)) / abs(old_urad),
    )


def _lines_urad(result: Result, name: str) -> tuple[float, float]:
    """Return the rotation of the best lines of both straightnesses of a squareness, with its
    standard uncertainty. A control with one slope per pair of axes stores these lines.
    """
    turned, variance = 0.0, 0.0
    for function, sign in SQUARENESS_SLOPE[name].items():
        found = result.errors.get(function)
        if found is not None and found.value is not None and len(found.value) > 1:
            at = found.position_mm
            turned += sign * 1000.0 * line_um_mm(at, from_first(found.value, at, shape=True))
            spread = np.sqrt(len(at)) * float(np.std(at))
            variance += 0.0 if found.u is None else (1000.0 * rms(found.u) / spread) ** 2
    return turned, float(np.sqrt(variance))


def _seen(
    name: str, tables: Sequence[Table], value: float, u: float, rest: float = 0.0
) -> Share | None:
    kind = "+".join(sorted({table.kind for table in tables}))
    return Share(name=name, kind=kind, value=value, u=u, rest=rest) if u <= SEEN else None


def _error_um(tables: Sequence[Table], at: Vector) -> Vector:
    error: Vector = -(summed_um(tables, at, +1) + summed_um(tables, at, -1)) / 2
    return error


def judged(found: Sequence[Share]) -> list[Judged]:
    kinds = dict.fromkeys(share.kind for share in found)
    return [_group(kind, [share for share in found if share.kind == kind]) for kind in kinds]


def _group(kind: str, members: Sequence[Share]) -> Judged:
    weights = np.array([(share.u**2 + CHANGED**2) ** -1.0 for share in members])
    value = float(weights @ [share.value for share in members] / weights.sum())
    on, off = (_log_likelihood(members, acted=acted) for acted in (True, False))
    alien = sum(
        -0.5 * (share.value / ALIEN) ** 2 - np.log(ALIEN) for share in members
    ) + np.log(ALIEN_ODDS)
    odds = {
        state: float(one - np.logaddexp(other, alien))
        for state, one, other in (("on", on, off), ("off", off, on))
    }
    return Judged(
        kind=kind,
        shares=tuple(members),
        value=value,
        u=float(weights.sum() ** -0.5),
        odds={state: float(np.exp(min(each, 700.0))) for state, each in odds.items()},
    )


def _log_likelihood(members: Sequence[Share], *, acted: bool) -> float:
    return float(
        np.logaddexp.reduce(_log_sizes(members, acted=acted))
        - np.logaddexp.reduce(_log_sizes((), acted=acted))
    )


def _log_sizes(members: Sequence[Share], *, acted: bool) -> Vector:
    """Return the logarithm of prior and likelihood for each size of `_LOG_K`."""
    logs: Vector = -0.5 * (_LOG_K / SIZES) ** 2
    for share in members:
        alien = np.log(ALIEN_ODDS / ALIEN) - 0.5 * (share.value / ALIEN) ** 2
        logs = logs + np.logaddexp(
            np.log(1 - ALIEN_ODDS) + _log_fit(share, acted=acted), alien
        )
    return logs


def _log_fit(share: Share, *, acted: bool) -> Vector:
    whole = np.exp(-_LOG_K)
    u = np.hypot(share.u, CHANGED * whole)
    unlike = np.maximum((share.rest / u) ** 2 - 1.0, 0.0)
    return np.asarray(
        -np.log(u) - 0.5 * ((share.value - whole + acted) / u) ** 2 - 0.5 * unlike
    )


def apart(group: Judged, *, acted: bool, least: float) -> list[str]:
    """Return the tables of a group that were off although the other tables of the group were on
    (``acted`` is true), or on although the other tables were off. The list contains a minority of
    the group.

    The state of a single table is judged with the size of the other tables. The opposite state of a
    returned table has odds above ``least``. A table that fits neither "on" nor "off" comes from
    another source. A squareness has no switch of its own.
    """
    found = []
    for share in group.shares:
        rest = [other for other in group.shares if other is not share]
        sizes = _log_sizes(rest, acted=acted)
        alien = np.log(ALIEN_ODDS / ALIEN) - 0.5 * (share.value / ALIEN) ** 2
        other, same = (_log_fit(share, acted=state) for state in (not acted, acted))
        odds = np.logaddexp.reduce(sizes + other) - np.logaddexp.reduce(
            sizes + np.logaddexp(same, alien)
        )
        if (
            share.name not in SQUARENESS_SLOPE
            and len(rest) >= FEWEST_BESIDE
            and odds > np.log(least)
        ):
            found.append(share.name)
    return found if len(found) <= len(group.shares) - FEWEST_BESIDE else []


def states(result: Result, controller: Controller, profile: Profile) -> Iterator[Finding]:
    """Yield the findings of `state_findings` about the stated compensation, for the active tables
    and for tables that were off while other tables were active.
    """
    acting = controller.standing(profile.existing, (), profile) if profile.existing else ()
    yield from state_findings(result, acting, profile.machine.measured_with)
    if profile.machine.measured_with == "on":
        machine = msgspec.structs.replace(profile.machine, measured_with="off")
        every = controller.standing(profile.existing, (), replace(profile, machine=machine))
        acted = {table.identity for table in acting}
        idle = [table for table in every if table.identity not in acted]
        yield from state_findings(result, idle, "off")


def state_findings(result: Result, tables: Sequence[Table], stated: str) -> Iterator[Finding]:
    """Yield, for each kind of table, the finding of the data about the ``stated`` compensation
    ("on" or "off").

    The finding is an error if the data contradict the statement. The finding is a warning if the
    data make the statement doubtful, or if a single table contradicts the statement. The finding is
    the warning `UNPROVEN` if the data do not confirm the statement.
    """
    for group in judged(shares(result, tables)):
        each = [
            message("share-of-table", name=share.name, share=share.value)
            for share in group.shares
        ]
        acted, shown = stated == "on", group.odds[stated] >= CERTAIN
        against = group.odds["off" if acted else "on"]
        if shown and (alone := apart(group, acted=acted, least=CERTAIN)):
            yield warning(
                "compensation-contradicted.one", names=alone, each=each, stated=stated
            )
        elif against > DOUBTED or not shown or apart(group, acted=acted, least=DOUBTED):
            text = message(
                _key(against),
                names=group.names,
                stated=stated,
                share=group.value,
                expanded=2 * group.u,
                each=each,
            )
            yield finding("error" if against > CERTAIN else "warning", text)


def _key(
    against: float,
) -> Literal[
    "compensation-contradicted",
    "compensation-contradicted.doubted",
    "compensation-contradicted.unproven",
]:
    if against > CERTAIN:
        return CONTRADICTED
    return "compensation-contradicted.doubted" if against > DOUBTED else UNPROVEN


def proof_needed(findings: Iterable[Finding]) -> bool:
    """Return whether the data leave open which tables were active during the measurement. In this
    case a proof run decides, and the prediction is not valid before the proof run.
    """
    return any(each.code == CONTRADICTED for each in findings)
