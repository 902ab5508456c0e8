"""What a survey would say, and what it would take, before the machine moves; and what is worth adding to it.

A forecast needs no reading: the model of the adjustment follows from where the stops are, and its uncertainty over the volume is the
figure that the result of that survey would state. What a survey does not identify counts with what a machine of its class usually has
(`Assumptions`), so that a run which identifies it is worth something, and no run ever makes a forecast worse.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.names import AXES, BODY_DIAGONALS
from stepdiag.base.readings.runs import Plan, Run, perfect_readings, plan_minutes
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.result import AXIS_LETTERS, DISPLACEMENTS, ROTATIONS, SQUARENESS
from stepdiag.base.setups import setup_of
from stepdiag.base.volume import MOST_INCREMENTS
from stepdiag.solver.model.layout import Layout, lay_out
from stepdiag.solver.planning.foresight import Foresight, foresee
from stepdiag.solver.planning.identifiability import Seen, identified_with_angles

MIN_GAIN = 0.01
"""A step that improves the uncertainty by less than this share ends the search: more time would buy nothing."""
MAX_INCREMENTS = 10
"""Finer surveys are forecast on this many increments: the uncertainty at a node hardly depends on how many others there are."""
_LINEAR = "a linear run along {}"
FUNCTIONS = (*DISPLACEMENTS, *ROTATIONS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Circumstances:
    """Everything about the job that is not in the plan. ``head``: there is a 4-DOF head; ``head_u_urad``: pitch and yaw from a run of it.

    ``made`` keeps what was forecast under them: a search comes to the same plan by many ways.
    """

    chain: str = "FXYZ"
    assumed: Assumptions = field(default_factory=Assumptions)
    head: bool = True
    head_u_urad: float = 1.0
    beam_offset_mm: float = 50.0
    made: dict[Plan, "Forecast"] = field(default_factory=dict, init=False, repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """What a planned survey would give; each figure is worked out when it is first asked for, and a search asks most plans for one or two.

    ``u``: combined standard uncertainty by name, root mean square over a function's nodes, None where not identified (units: um,
    urad, um/m). ``angles`` says whether the readings resolve all angular functions or the assumed size stands for them.
    ``volumetric_um``: root mean square over the volume of the error vector's uncertainty (k = 1), rigid motion removed; ``left_um``: what
    an ideal compensation will leave of it there (rms, k = 2), the figure that result and ``verify`` predict after the survey. ``hidden``:
    independent combinations of the unknowns that no reading shows when the angular functions are unknowns too.
    """

    plan: Plan
    layout: Layout
    chain: str
    assumed: Assumptions

    @property
    def minutes(self) -> float:
        """Return how long the survey takes."""
        return plan_minutes(self.plan)

    @cached_property
    def ahead(self) -> Foresight:
        """Return its uncertainties."""
        return foresee(self.layout, self.chain, self.assumed, self.plan.volume.increments)

    @cached_property
    def _free(self) -> Seen:
        return identified_with_angles(self.layout, self.chain)

    @property
    def hidden(self) -> int:
        """Return how many combinations of the unknowns no reading shows."""
        return self._free.hidden

    @property
    def resolved(self) -> tuple[str, ...]:
        """Return the functions that are solved from the laser's readings."""
        return tuple(name for name in FUNCTIONS if self._free.known[name])

    @property
    def angles(self) -> Literal["assumed", "solved"]:
        """Tell where the angular functions come from."""
        return "solved" if self.resolves_all else "assumed"

    @property
    def u(self) -> dict[str, float | None]:
        """Return combined standard uncertainties."""
        return {name: self.ahead.u.get(name) for name in (*FUNCTIONS, *SQUARENESS, *AXIS_LETTERS)}

    @property
    def volumetric_um(self) -> float:
        """Return the uncertainty over the volume."""
        return self.ahead.volumetric_um

    @property
    def left_um(self) -> Interval:
        """Return what compensation will leave."""
        return self.ahead.left_um

    @property
    def resolves_all(self) -> bool:
        """Tell whether all 18 functions could be solved from the laser's readings alone."""
        return set(self.resolved) == set(FUNCTIONS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Addition:
    """Something to add to a survey, and what it would bring."""

    text: str
    forecast: Forecast
    before: Forecast

    @property
    def minutes(self) -> float:
        """Return how much longer the survey takes."""
        return self.forecast.minutes - self.before.minutes

    @property
    def gain_um(self) -> float:
        """Return by how much the volumetric uncertainty falls."""
        return self.before.volumetric_um - self.forecast.volumetric_um

    @property
    def newly_identified(self) -> tuple[str, ...]:
        """Return what was not identified before."""
        return tuple(name for name, u in self.forecast.u.items() if u is not None and self.before.u[name] is None)

    @property
    def gain_um_per_minute(self) -> float:
        """Return by how much the volumetric uncertainty falls for each minute spent."""
        return self.gain_um / self.minutes


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """The survey as planned, what to add to it (best gain per minute first), and the surveys that answer three questions.

    ``resolving``: the cheapest steps found after which all 18 functions are solved, each with its forecast; empty where
    nothing leads there. ``best``: the survey for the time or the target uncertainty asked for, None where none was asked or none fits.
    """

    forecast: Forecast
    additions: tuple[Addition, ...]
    resolving: tuple[Addition, ...]
    best: Forecast | None


def plan(survey: Plan, about: Circumstances | None = None, *, available_min: float | None = None, target_um: float | None = None) -> Advice:
    """Return forecast, ranked additions and the best survey within ``available_min`` or down to ``target_um``.

    The best survey is built up from four bare diagonals by the addition with the highest gain per minute that still fits.
    """
    about = about or Circumstances()
    now = forecast(survey, about)
    best = None
    if available_min is not None or target_um is not None:
        best = best_survey(bare_survey(survey), about, available_min=available_min, target_um=target_um)
    return Advice(forecast=now, additions=rank(now, about), resolving=resolving(now, about), best=best)


def forecast(survey: Plan, about: Circumstances) -> Forecast:
    """Return what the survey would give. Raises ``UsageError`` for a plan without a run of the laser."""
    if survey not in about.made:
        coarse = replace(survey, volume=replace(survey.volume, increments=min(survey.volume.increments, MAX_INCREMENTS)))
        layout = lay_out(perfect_readings(coarse, about.assumed.reading_um), "plan", coarse.volume)
        about.made[survey] = Forecast(plan=survey, layout=layout, chain=about.chain, assumed=_with_head(survey, about))
    return about.made[survey]


def _with_head(survey: Plan, about: Circumstances) -> Assumptions:
    """Return the assumptions with pitch and yaw of every axis that the head measures known to its uncertainty."""
    angles = dict(about.assumed.angle_urad)
    for run in survey.runs:
        if run.is_fourdof:
            axis = setup_of(run.setup).axis.upper()
            roll = f"E{'ABC'[AXIS_LETTERS.index(axis)]}{axis}"
            measured = [name for name in ROTATIONS if name[2] == axis and name != roll]
            angles |= {name: min(2.0 * about.head_u_urad, about.assumed.angle_range_urad(name)) for name in measured}
    return replace(about.assumed, angle_urad=angles)


def rank(now: Forecast, about: Circumstances) -> tuple[Addition, ...]:
    """Return everything that could be added to a survey, the highest gain per minute first."""
    found = [_addition(text, changed, now, about) for text, changed in _changes(now.plan, about)]
    return tuple(sorted(found, key=lambda one: one.gain_um_per_minute, reverse=True))


def _addition(text: str, changed: Plan, now: Forecast, about: Circumstances) -> Addition:
    return Addition(text=text, forecast=forecast(changed, about), before=now)


def _changes(survey: Plan, about: Circumstances) -> Iterator[tuple[str, Plan]]:
    """Yield every plan that is one step richer, in words."""
    bases = [setup_of(run.setup).base for run in survey.runs]
    for axis in AXES:
        for kind, words in (("linear", _LINEAR), *((("fourdof", "a run of the 4-DOF head along {}"),) if about.head else ())):
            if f"{kind}-{axis}" not in bases:
                yield words.format(axis.upper()), survey.with_runs(Run(setup=f"{kind}-{axis}"))
    diagonals = [run for run in survey.runs if run.setup in BODY_DIAGONALS]
    for axis in AXES if diagonals else ():
        x, y, z = (about.beam_offset_mm * (axis == other) for other in AXES)
        shift = (x, y, z)
        if all(run.beam_offset_mm != shift for run in survey.runs):
            shifted = [replace(run, beam_offset_mm=shift) for run in diagonals]
            yield f"all diagonals again with the beam shifted {about.beam_offset_mm:g} mm in {axis.upper()}", survey.with_runs(*shifted)
    if not all(run.return_pass for run in survey.runs):
        yield "return passes", replace(survey, runs=tuple(replace(run, return_pass=True) for run in survey.runs))
    if (finer := 2 * survey.volume.increments) <= MOST_INCREMENTS:
        yield f"{finer} increments in place of {survey.volume.increments}", replace(survey, volume=replace(survey.volume, increments=finer))
    more = tuple(replace(run, repeats=run.repeats + 1) for run in survey.runs)
    yield "one more repeat of every run", replace(survey, runs=more)


def resolving(now: Forecast, about: Circumstances) -> tuple[Addition, ...]:
    """Return the steps after which all 18 functions are solved from the laser's readings; empty where nothing more is needed or helps.

    Each step shows the most hidden combinations per minute; steps that the later ones made superfluous are then dropped.
    """
    texts: list[str] = []
    here = now
    while not here.resolves_all:
        found = [_addition(text, changed, here, about) for text, changed in _changes(here.plan, about)]
        best = max(found, key=lambda one: (here.hidden - one.forecast.hidden) / one.minutes)
        if best.forecast.hidden >= here.hidden:
            return ()
        texts.append(best.text)
        here = best.forecast
    for text in texts[:-1]:
        fewer = [other for other in texts if other != text]
        if _walk(now, fewer, about)[-1].forecast.resolves_all:
            texts = fewer
    return _walk(now, texts, about)


def _walk(now: Forecast, texts: list[str], about: Circumstances) -> tuple[Addition, ...]:
    """Return the additions named, made one after the other; those that the survey has already are left out."""
    steps: list[Addition] = []
    for text in texts:
        here = steps[-1].forecast if steps else now
        changed = dict(_changes(here.plan, about)).get(text)
        if changed is not None:
            steps.append(_addition(text, changed, here, about))
    return tuple(steps)


def bare_survey(survey: Plan) -> Plan:
    """Return the least survey of the same volume: four body diagonals, driven once."""
    return replace(survey, runs=tuple(Run(setup=name, return_pass=False) for name in BODY_DIAGONALS))


def best_survey(
    start: Plan, about: Circumstances, *, available_min: float | None = None, target_um: float | None = None
) -> Forecast | None:
    """Return the survey for a given time, a target of what compensation leaves (rms over the volume), or both.

    None where the start alone takes too long or nothing reaches the target in time. Grown step by step, the highest gain per minute
    first. Resolving all functions pays only when its last step is made, so it is offered as one step as well, with linear runs.
    """
    limit = float("inf") if available_min is None else available_min
    here = forecast(start, about)
    if here.minutes > limit:
        return None
    whole = [*(step.text for step in resolving(here, about)), *(_LINEAR.format(axis.upper()) for axis in AXES)]
    while target_um is None or here.left_um.value_um > target_um:
        steps = [*rank(here, about), *_as_one_step(_walk(here, whole, about), here)]
        fitting = [one for one in steps if one.forecast.minutes <= limit and one.gain_um > MIN_GAIN * here.volumetric_um]
        if not fitting:
            return here if target_um is None else None
        here = max(fitting, key=lambda one: one.gain_um_per_minute).forecast
    return here


def _as_one_step(steps: tuple[Addition, ...], here: Forecast) -> list[Addition]:
    if not steps:
        return []
    return [Addition(text="; ".join(step.text for step in steps), forecast=steps[-1].forecast, before=here)]
