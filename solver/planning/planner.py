"""The forecast of a survey and of its minutes, and other surveys with a smaller remaining error.

A forecast needs no reading, because the positions of the stops determine the model of the
adjustment. The forecast and the result have the same uncertainty over the volume. Quantities that
are not identified have the usual sizes of the machine's class (`Assumptions`), so that no
additional run makes a forecast worse.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.names import FOURDOF_RUNS
from stepdiag.base.readings.runs import Plan, Run, perfect_readings, plan_minutes
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.result import AXIS_LETTERS, DISPLACEMENTS, ROTATIONS, SQUARENESS
from stepdiag.solver.model.layout import Layout, lay_out
from stepdiag.solver.planning.circumstances import Circumstances
from stepdiag.solver.planning.foresight import Foresight
from stepdiag.solver.planning.identifiability import Seen, identified_with_angles
from stepdiag.solver.planning.search import Search

WORTH = 0.95
"""Ratio of the remaining errors of a longer and a shorter survey below which the longer survey
is useful."""
MOST_NAMED = 7
SHORTEST_MIN, LONGEST_MIN, LONGER = 90.0, 300.0, 1.3
"""Shortest and longest time limit in minutes of the search, and the ratio of successive limits."""
MAX_INCREMENTS = 20
"""Largest number of increments in a forecast. More increments add no waves of angular functions
(`effects.MOST_WAVES`) and hardly change the uncertainty at a node."""
HALVINGS = 2
"""Number of bisections of the time between the shortest survey known to reach the target
uncertainty and a survey that does not."""
FUNCTIONS = (*DISPLACEMENTS, *ROTATIONS)


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """The forecast of a planned survey; each value is computed at its first use.

    ``u`` is the combined standard uncertainty of each quantity in um, urad or um/m, rms over the
    nodes of a function, None if it is not identified. ``angles`` is "solved" if the readings
    determine all angular functions, else "assumed". ``volumetric_um`` is the uncertainty of the
    error vector over the volume (rms, k = 1), without rigid motion. ``left_um`` is the remaining
    error after an ideal compensation (rms, k = 2), as the result and ``verify`` predict it.
    ``hidden`` is the number of combinations of all unknowns, including angular functions, that no
    reading shows.
    """

    plan: Plan
    layout: Layout
    about: Circumstances
    assumed: Assumptions

    @property
    def minutes(self) -> float:
        return plan_minutes(self.plan)

    @cached_property
    def ahead(self) -> Foresight:
        return Foresight(
            layout=self.layout,
            chain=self.about.chain,
            assumed=self.assumed,
            increments=self.plan.volume.increments,
            aim=self.about.aim,
            zone=self.about.zone,
        )

    @cached_property
    def _free(self) -> Seen:
        return identified_with_angles(self.layout, self.about.chain)

    @property
    def hidden(self) -> int:
        return self._free.hidden

    @property
    def resolved(self) -> tuple[str, ...]:
        return tuple(name for name in FUNCTIONS if self._free.known[name])

    @property
    def angles(self) -> Literal["assumed", "solved"]:
        return "solved" if self.resolves_all else "assumed"

    @property
    def u(self) -> dict[str, float | None]:
        return {
            name: self.ahead.u.get(name) for name in (*FUNCTIONS, *SQUARENESS, *AXIS_LETTERS)
        }

    @property
    def volumetric_um(self) -> float:
        return self.ahead.volumetric_um

    @property
    def left_um(self) -> Interval:
        return self.ahead.left_um

    @property
    def resolves_all(self) -> bool:
        return set(self.resolved) == set(FUNCTIONS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """The forecast of the planned survey, and at most `MOST_NAMED` other useful surveys (`WORTH`),
    the shortest first.

    ``best`` is the survey for the requested time or target uncertainty, or None. ``with_head`` is
    the requested or planned survey with a 4-DOF run along each axis, or None if the head does not
    reduce the remaining error or is already planned.
    """

    forecast: Forecast
    front: tuple[Forecast, ...]
    best: Forecast | None
    with_head: Forecast | None

    @property
    def next(self) -> Forecast | None:
        """Return the shortest survey of ``front`` that is useful compared with the planned
        survey (`WORTH`), or None."""
        better = (
            one
            for one in self.front
            if one.left_um.value_um < WORTH * self.forecast.left_um.value_um
        )
        return next(better, None)


def plan(
    survey: Plan,
    about: Circumstances | None = None,
    *,
    available_min: float | None = None,
    target_um: float | None = None,
) -> Advice:
    """Return the forecast of a survey, other useful surveys, and the best survey within
    ``available_min`` or the shortest survey that reaches ``target_um``."""
    about = about or Circumstances()
    now = forecast(survey, about)
    search = Search(survey, about)
    found = _found(search, about, _times(available_min), target_um)
    best = None
    if target_um is not None:
        best = _down_to(search, about, found, target_um)
    elif available_min is not None:
        fitting = [one for one in (now, *found) if one.minutes <= available_min]
        best = min(fitting, key=lambda one: one.left_um.value_um, default=None)
    chosen = best or now
    more = forecast(chosen.plan.with_runs(*(Run(setup=name) for name in FOURDOF_RUNS)), about)
    helps = not about.head and more.left_um.value_um < WORTH * chosen.left_um.value_um
    return Advice(
        forecast=now, front=_worth(found), best=best, with_head=more if helps else None
    )


def _times(available_min: float | None) -> list[float]:
    times, longest = [SHORTEST_MIN], available_min or LONGEST_MIN
    while times[-1] * LONGER < longest:
        times.append(times[-1] * LONGER)
    return sorted({time for time in times if time < longest} | {longest})


def _found(
    search: Search,
    about: Circumstances,
    limits_min: Sequence[float],
    target_um: float | None = None,
) -> list[Forecast]:
    found: list[Forecast] = []
    for limit in limits_min:
        if target_um is not None and found and found[-1].left_um.value_um <= target_um:
            break
        if (
            limit == limits_min[-1]
            or len(found) < 3
            or found[-1].left_um.value_um < WORTH * found[-3].left_um.value_um
        ):
            survey = search.within(limit)
            found += [] if survey is None else [forecast(survey, about)]
    return found


def _worth(found: list[Forecast]) -> tuple[Forecast, ...]:
    named: list[Forecast] = []
    for one in sorted(found, key=lambda each: each.minutes):
        if not named or one.left_um.value_um < WORTH * named[-1].left_um.value_um:
            named.append(one)
    return tuple(named[-MOST_NAMED:])


def _down_to(
    search: Search, about: Circumstances, found: list[Forecast], target_um: float
) -> Forecast | None:
    reaching = [one for one in found if one.left_um.value_um <= target_um]
    if not reaching:
        return None
    best = min(reaching, key=lambda one: one.minutes)
    low = max((one.minutes for one in found if one.minutes < best.minutes), default=0.0)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + best.minutes)
        shorter = next(
            (
                one
                for one in _found(search, about, [middle])
                if one.left_um.value_um <= target_um
            ),
            None,
        )
        low, best = (middle, best) if shorter is None else (low, shorter)
    return best


def forecast(survey: Plan, about: Circumstances) -> Forecast:
    """Return the forecast of a planned survey. Raises ``UsageError`` for a plan without a run of
    the laser."""
    coarse = replace(
        survey,
        volume=replace(
            survey.volume, increments=min(survey.volume.increments, MAX_INCREMENTS)
        ),
    )
    layout = lay_out(
        perfect_readings(coarse, about.reading_um(survey.pace.dwell_s)), "plan", coarse.volume
    )
    angles = {**about.assumed.angle_urad, **about.head_ranges_urad(survey.runs)}
    return Forecast(
        plan=survey,
        layout=layout,
        about=about,
        assumed=replace(about.assumed, angle_urad=angles),
    )
