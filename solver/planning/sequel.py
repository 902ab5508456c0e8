"""The next setups of a running survey, and the decision that the survey is complete.

The driven setups show the sizes of the angles and the scatter of machine and laser
(`solver.adjustment`). With these sizes, driven and possible setups are compared as in a plan
(`solver.planning.search`). The search computes the best additional lines for several time limits;
the lines with the largest gain per minute are driven next. The survey is complete if no choice of
lines has a useful gain: neither the lines that fit into `HORIZON_MIN` minutes nor the planned
lines. A gain is useful if it reaches both `LEAST_UM` and `LEAST_SHARE`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from stepdiag.base.errors import StepdiagError
from stepdiag.base.readings.readings import Readings
from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.setups import setup_of
from stepdiag.solver.adjustment.adjustment import Adjustment, adjust
from stepdiag.solver.linear.families import families
from stepdiag.solver.model.effects import ANGLES
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.planning.circumstances import Circumstances
from stepdiag.solver.planning.search import INCREMENTS, Exchange, Ways, offered

HORIZON_MIN = 60.0
"""Largest additional time in minutes that the search considers; one alignment takes half of it."""
TIMES = (0.15, 0.3, 0.6, 1.0)
"""Time limits as shares of `HORIZON_MIN`."""
SHOWN = 3.0
"""The readings show the size of the angles if the interval with two thirds of the likely sizes is
narrow: its upper limit is at most this multiple of its lower limit. Without information the ratio
is 15."""
LEAST_UM, LEAST_SHARE = 0.1, 0.05
"""Smallest useful gain, in um and as a share of the remaining error."""


@dataclass(frozen=True, kw_only=True)
class Sequel:
    """The next setups of a survey: ``runs`` are the setups with the largest gain per minute, in the
    order of driving. ``end`` is True if the gain of these setups is too small.

    ``now_um`` is the remaining error after compensation by the driven setups (rms over the volume),
    and ``then_um`` is the error after the additional ``runs``. ``minutes`` is the time of ``runs``
    including set-up; ``at_most_um`` is the largest possible gain of ``runs`` (k = 2).
    ``angles_urad`` is the range of the angles, None if the readings do not show it.
    """

    runs: tuple[Run, ...]
    end: bool
    now_um: float
    then_um: float
    minutes: float
    at_most_um: float
    angles_urad: float | None


def sequel(
    survey: Plan, about: Circumstances, done: Sequence[str], readings: Readings | None = None
) -> Sequel:
    """Return the runs to drive after the setups ``done``, from their ``readings``. The last
    setup of ``done`` is still set up."""
    shown, angles_urad = shown_by(readings, survey, about)
    driven = [survey.run_of(name) for name in done]
    todo = [run for run in survey.runs if run.setup not in done]
    awaited = {run.travel.base for run in todo}
    known = [_offered_line(run) for run in driven]
    # a line shifted from a planned line is driven directly after the planned line
    further = [
        line
        for line in offered(survey, shown)
        if line.setup not in awaited and line not in known
    ]
    lines, ways = (*map(_offered_line, todo), *further), _ways(survey)
    chosen = _most_a_minute(
        Exchange(survey, shown, lines, ways, driven), len(todo), survey.volume.increments
    )
    fine = Exchange(
        survey,
        shown,
        [lines[place] for place in chosen],
        ways,
        driven,
        min(survey.volume.increments, INCREMENTS[-1]),
    )
    every = range(len(chosen))
    now_um, then_um = (_left_um(fine, some, survey.volume.increments) for some in ((), every))
    lowered, spread = fine.lowered_um2(every)
    return Sequel(
        runs=_named(survey, fine.lines, todo, driven, ways),
        end=now_um - then_um < max(LEAST_UM, LEAST_SHARE * now_um),
        now_um=now_um,
        then_um=then_um,
        minutes=fine.minutes(every, survey.volume.increments),
        at_most_um=(lowered + 2.0 * spread) / (now_um + then_um),
        angles_urad=angles_urad,
    )


def _left_um(exchange: Exchange, chosen: Sequence[int], increments: int) -> float:
    return float(np.sqrt(exchange.square_um2(chosen) + exchange.beside_um2(increments)))


def _most_a_minute(exchange: Exchange, planned: int, increments: int) -> Sequence[int]:
    """Return the numbers of the lines with the largest gain per minute; lines 0 to ``planned`` - 1
    are in the plan.

    Without a useful gain, return the planned lines. If no lines are planned, return the choice with
    the smallest remaining error, or no lines if none reduces this error."""
    todo = list(range(planned))
    now_um, rest_min = _left_um(exchange, (), increments), exchange.minutes(todo, increments)
    found: list[tuple[float, float, Sequence[int]]] = []
    for limit in dict.fromkeys((*(HORIZON_MIN * share for share in TIMES), rest_min)):
        starts = [[], todo] if todo and rest_min <= limit else [[]]
        choices = [
            *(exchange.improved(start, increments, limit) for start in starts),
            *starts[1:],
        ]
        found += [
            (_left_um(exchange, one, increments), exchange.minutes(one, increments), one)
            for one in choices
            if one
        ]
    worth = [one for one in found if now_um - one[0] >= max(LEAST_UM, LEAST_SHARE * now_um)]
    if worth:
        return max(worth, key=lambda one: (now_um - one[0]) / one[1])[2]
    return todo or min(found, default=(0.0, 0.0, ()))[2]


def _offered_line(run: Run) -> Run:
    return Run(
        setup=run.travel.base,
        return_pass=False,
        beam_offset_mm=run.beam_offset_mm,
        targets=run.targets,
    )


def _ways(survey: Plan) -> Ways:
    runs = survey.runs
    orders, alternate = next(
        ((run.axis_orders, run.alternate) for run in runs if run.axis_orders), ((), False)
    )
    return Ways(
        repeats=runs[0].repeats,
        return_pass=runs[0].return_pass,
        axis_orders=orders,
        alternate=alternate,
        dwell_s=survey.pace.dwell_s,
    )


def _named(
    survey: Plan, lines: Sequence[Run], todo: Sequence[Run], driven: Sequence[Run], ways: Ways
) -> tuple[Run, ...]:
    """Return lines as runs with setup names: runs of the present setup first, then planned runs,
    then other runs. Each shifted line gets the next free number."""
    taken, runs = {run.setup for run in survey.runs}, list[Run]()
    for line in lines:
        planned = next((run for run in todo if _offered_line(run) == line), None)
        numbers = count(1) if any(line.beam_offset_mm) else count()
        name = next(
            name for number in numbers if (name := line.travel.shifted(number)) not in taken
        )
        runs.append(planned or ways.of(replace(line, setup=name)))
        taken.add(runs[-1].setup)
    stands = driven[-1].travel.base if driven else ""
    return tuple(
        sorted(
            runs,
            key=lambda run: (
                setup_of(run.setup).base != stands,
                run not in todo,
                runs.index(run),
            ),
        )
    )


def shown_by(
    readings: Readings | None, survey: Plan, about: Circumstances
) -> tuple[Circumstances, float | None]:
    """Return the circumstances, with the assumed sizes replaced by those that the readings show.
    Also return the range of the angles in urad, or None if the readings do not show this range."""
    if readings is None:
        return about, None
    try:
        found = adjust(
            lay_out(readings, "readings", survey.volume), about.chain, assumed=about.assumed
        )
    except StepdiagError:
        # for too few stops, or for a pass that contradicts its plan, there is another
        # finding
        return about, None
    assumed, scatter = about.assumed, found.scatter
    repeats = assumed.repeatability_um and np.any(scatter.freedom_misses[:3] > 0)
    factor, shown = _factor(found)
    sizes = replace(
        assumed,
        angles_urad=factor * assumed.angles_urad,
        angle_urad={name: factor * size for name, size in assumed.angle_urad.items()},
        repeatability_um=scatter.repeatability_um if repeats else assumed.repeatability_um,
    )
    return replace(about, assumed=sizes), sizes.angles_urad if shown else None


def _factor(found: Adjustment) -> tuple[float, bool]:
    names = [effect.name for effect in found.effects]
    if ANGLES not in names or not found.sizes.sought[names.index(ANGLES)]:
        return 1.0, False
    group = np.repeat(np.arange(len(names)), [effect.count for effect in found.effects])
    likely = families(found.fit, group, found.sizes)[names.index(ANGLES)].factor
    middle = len(likely) // 6
    return float(found.sizes.factor[names.index(ANGLES)]), bool(
        likely[-1 - middle] < SHOWN * likely[middle]
    )
