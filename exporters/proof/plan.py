"""The plan of a proof run: its diagonal, its line, the number of passes, and the expected effect of
each table on the readings.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.names import BODY_DIAGONALS
from stepdiag.base.readings.readings import Readings
from stepdiag.base.readings.runs import Plan, run_minutes, setup_minutes
from stepdiag.base.result.result import Result
from stepdiag.base.volume import rms
from stepdiag.exporters.proof.change import Way, columns, unit_u, ways_of
from stepdiag.exporters.tables.tables import Table

LINES = ("linear-x", "linear-y", "linear-z")
USUAL_UM = 0.5
"""Assumed scatter of a reading in um, if the result states none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Foreseen:
    """The expected effect of a function's tables on the readings (rms over the stops, um), and its
    U (k = 2).
    """

    function: str
    seen_um: float
    expanded_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofPlan:
    """The setups of a proof run with the number of repeats, the minutes of driving, and the
    expected effect of each table.
    """

    setups: tuple[str, ...]
    repeats: int
    minutes: float
    foreseen: tuple[Foreseen, ...]


def plan_proof(
    result: Result, readings: Readings, driven: Plan, acting: Sequence[Table], minutes: float
) -> ProofPlan:
    """Return the plan with the diagonal and the line of a survey that best show the table with the
    smallest effect. The run is driven as often as ``minutes`` of driving allow, and at least once.

    Raises ``DataError`` for a survey without a diagonal, and if no table changes the readings of
    the survey.
    """
    names = [run.setup for run in driven.runs if run.setup in readings.setup]
    diagonals, lines = (
        [name for name in names if name in some] for some in (BODY_DIAGONALS, LINES)
    )
    if not diagonals:
        raise DataError(
            result.source,
            expected=message("proof-diagonal"),
            found=", ".join(names) or message("none"),
        )
    pairs = [tuple(pair) for pair in product(diagonals, lines)] or [
        (name,) for name in diagonals
    ]
    ways = {name: [way for way, _ in ways_of(readings, [name])] for name in names}

    def least(pair: Sequence[str]) -> float:
        return max(
            (
                each.expanded_um / each.seen_um
                for each in _foreseen(result, ways, pair, acting)
            ),
            default=0.0,
        )

    chosen = min(pairs, key=least)
    foreseen = _foreseen(result, ways, chosen, acting)
    if not foreseen:
        raise DataError(
            result.source, expected=message("proof-sees"), found=message("nothing")
        )
    runs = [driven.run_of(name) for name in chosen]
    once = sum(
        run_minutes(driven, replace(run, repeats=1)) - setup_minutes(driven, run)
        for run in runs
    )
    # The proof run needs readings of the survey at the same stops. With another order of axes
    # these stops differ.
    most = min((run.repeats for run in runs if run.alternate), default=int(minutes / once))
    repeats = max(min(int(minutes / once), most), 1)
    return ProofPlan(
        setups=chosen, repeats=repeats, minutes=repeats * once, foreseen=foreseen
    )


def _foreseen(
    result: Result, ways: dict[str, list[Way]], setups: Sequence[str], acting: Sequence[Table]
) -> tuple[Foreseen, ...]:
    there = [way for name in setups for way in ways[name]]
    seen = columns(acting, there)
    spreads = [
        found
        for name in setups
        if (found := result.setups[name].residual_um if name in result.setups else None)
        is not None
    ]
    scatter_um = max([*spreads, USUAL_UM])
    return tuple(
        Foreseen(
            function=name,
            seen_um=(size_um := rms(seen[name] - np.mean(seen[name]))),
            expanded_um=2.0 * scatter_um * u * size_um,
        )
        for name, u in unit_u(acting, there).items()
    )
