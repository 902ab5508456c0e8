"""The forecast of a survey, and its cost, before the drive; and the surveys that are worth their
time.

A forecast needs no reading: the model of the adjustment follows from the places of the stops, and
its uncertainty over the volume equals the figure in the result of the survey. Unidentified
quantities have the usual sizes of the machine's class (`Assumptions`), so that a run that
identifies them has a gain, and no run makes a forecast worse.
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
"""Largest ratio of remaining errors at which a longer survey is listed beside a shorter one."""
MOST_NAMED = 7
SHORTEST_MIN, LONGEST_MIN, LONGER = 90.0, 300.0, 1.3
"""Ratio of the times for which surveys are sought, one to the next."""
MAX_INCREMENTS = 20
"""Finer surveys are forecast with this number of increments: angular functions then have no more
waves (`effects.MOST_WAVES`), and the uncertainty at a node hardly depends on the number of others.
"""
HALVINGS = 2
"""Number of halvings of the time between a survey that reaches the target and a shorter one that
does not.
"""
FUNCTIONS = (*DISPLACEMENTS, *ROTATIONS)


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """The forecast of a planned survey; each figure is computed on its first request.

    ``u``: combined standard uncertainty by name, root mean square over a function's nodes, None
    where not identified (units: um, urad, um/m). ``angles`` states whether the readings resolve all
    angular functions, or the assumed size is used. ``volumetric_um``: root mean square over the
    volume of the error vector's uncertainty (k = 1), rigid motion removed; ``left_um``: the
    remaining error after an ideal compensation (rms, k = 2), predicted by result and ``verify``
    after the survey. ``hidden``: independent combinations of the unknowns without any reading, if
    the angular functions are unknowns too.
    """

    plan: Plan
    layout: Layout
    about: Circumstances
    assumed: Assumptions

    @property
    def minutes(self) -> float:
        """Return the duration of the survey."""
        return plan_minutes(self.plan)

    @cached_property
    def ahead(self) -> Foresight:
        """Return its uncertainties."""
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
        """Return the number of combinations of the unknowns that no reading shows."""
        return self._free.hidden

    @property
    def resolved(self) -> tuple[str, ...]:
        """Return the functions that are solved from the laser's readings."""
        return tuple(name for name in FUNCTIONS if self._free.known[name])

    @property
    def angles(self) -> Literal["assumed", "solved"]:
        """Name the source of the angular functions."""
        return "solved" if self.resolves_all else "assumed"

    @property
    def u(self) -> dict[str, float | None]:
        """Return combined standard uncertainties."""
        return {
            name: self.ahead.u.get(name) for name in (*FUNCTIONS, *SQUARENESS, *AXIS_LETTERS)
        }

    @property
    def volumetric_um(self) -> float:
        """Return the uncertainty over the volume."""
        return self.ahead.volumetric_um

    @property
    def left_um(self) -> Interval:
        """Return the remaining error after compensation."""
        return self.ahead.left_um

    @property
    def resolves_all(self) -> bool:
        """Return whether all 18 functions could be solved from the laser's readings alone."""
        return set(self.resolved) == set(FUNCTIONS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """The survey as planned, and the surveys worth their time, shortest first (`MOST_NAMED` at
    most, each `WORTH` its minutes).

    ``best``: the survey for the requested time or target uncertainty, None without a request or a
    fit. ``with_head``: the requested survey (without a request the planned survey), with a run of a
    4-DOF head along each axis; None if the head has no gain or is already planned.
    """

    forecast: Forecast
    front: tuple[Forecast, ...]
    best: Forecast | None
    with_head: Forecast | None

    @property
    def next(self) -> Forecast | None:
        """Return the first survey of the list that is worth its time beside the planned survey;
        None without such a survey.
        """
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
    """Return the forecast, the surveys worth their time, and the best survey within
    ``available_min`` or down to ``target_um``.
    """
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
    """Return the best surveys within some times, until the last two are not worth their time or one
    reaches a target; the last time is always tried where there is no target.
    """
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
    """Return the shortest survey found whose remaining error is within a target."""
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
    """Return the forecast of the survey. Raises ``UsageError`` for a plan without a run of the
    laser.
    """
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
