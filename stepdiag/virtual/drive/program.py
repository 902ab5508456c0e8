"""The NC program of the virtual survey, step by step: moves, dwells, pauses, and the effects of
faults."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stepdiag.virtual.base.faults import FaultBoard
from stepdiag.virtual.drive.sequence import Box, DrivenPass, axis_of_run, driven_pass
from stepdiag.virtual.physics.error_functions import Array

_GAP_S = 0.2
"""Time in s in which no axis moves although the program is not at a stop."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """The next step of the control.

    A move ends at ``target_mm`` (3,); dwells and pauses have no movement. ``duration_s`` applies to
    dwells and pauses, infinite until the program is started. ``counts`` is added to the stop
    counter at this stop; a stop that is not ``signalled`` gives no signal. ``setup`` is empty
    between two programs, ``pass_number`` is 0 before the first pass. During an ``alarm`` the
    program does not run.
    """

    kind: Literal["move", "dwell", "pause"]
    target_mm: Array | None = None
    setup: str = ""
    pass_number: int = 0
    stop: int = -1
    duration_s: float = 0.0
    counts: int = 0
    signalled: bool = True
    beam: bool = True
    wobbled: bool = False
    alarm: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The setups in order, with ``passes`` of each, odd passes outward. With ``pause_s`` None, the
    program waits for a start before each setup.

    ``overrun_mm`` is the distance beyond the first stop of a pass, so that every axis reaches this
    stop in the direction of the pass. Without ``first_overrun`` the program overruns only at the
    turns, not before the first pass of a setup.
    """

    box: Box
    setups: tuple[str, ...] = ("ppp", "npp", "pnp", "ppn")
    passes: int = 2
    axis_order: str = "xyz"
    dwell_s: float = 2.0
    overrun_mm: float = 5.0
    first_overrun: bool = True
    pause_s: float | None = 2.0
    commission_s: tuple[float, float, float] | None = None
    """Three times in s for the commissioning of the head: the dwell at each position beside a stop,
    the time with a wobbled beam, and the time without light. The commissioning takes place in the
    first pass of a run of the head."""


def steps(plan: Plan, faults: FaultBoard) -> Iterator[Step]:
    """Yield every step of the survey; the beam is off while laser and mirror are moved to the next
    setup."""
    for setup in plan.setups:
        yield Step(
            kind="pause",
            duration_s=math.inf if plan.pause_s is None else plan.pause_s,
            beam=False,
        )
        yield from _setup_steps(plan, setup, faults)


def again(plan: Plan, setup: str, faults: FaultBoard) -> Iterator[Step]:
    """Yield the steps of a repeated setup, and the wait after it."""
    yield from _setup_steps(plan, setup, faults)
    yield Step(
        kind="pause",
        duration_s=math.inf if plan.pause_s is None else plan.pause_s,
        beam=False,
    )


def _setup_steps(plan: Plan, setup: str, faults: FaultBoard) -> Iterator[Step]:
    wrong = faults.take("axis-order", setup, 1, 0)
    order = wrong.text if wrong else plan.axis_order
    first = driven_pass(plan.box, setup, 1, order)
    first_mm = plan.overrun_mm if plan.first_overrun else 0.0
    yield Step(kind="move", target_mm=_before(first, 0, first_mm), beam=False)
    yield Step(kind="pause", setup=setup, duration_s=_GAP_S)
    for number in range(1, plan.passes + 1):
        driven = driven_pass(plan.box, setup, number, order)
        if number > 1:
            yield from _approach(plan, driven, 0)
        yield from _pass_steps(plan, driven, faults)
    yield Step(kind="pause", setup=setup, pass_number=plan.passes, duration_s=_GAP_S)


def _approach(plan: Plan, driven: DrivenPass, stop: int) -> Iterator[Step]:
    before = _before(driven, stop, plan.overrun_mm)
    place = Step(kind="move", target_mm=before, setup=driven.setup, pass_number=driven.number)
    yield place
    yield replace(place, kind="pause", duration_s=_GAP_S)


def _before(driven: DrivenPass, stop: int, overrun_mm: float) -> Array:
    """Return the point from which all moving axes approach a stop in the direction of the pass,
    shape (3,)."""
    axis = axis_of_run(driven.setup)
    moving = np.ones(3) if axis is None else np.eye(3)[axis]
    before: Array = driven.stop_mm[stop] - overrun_mm * driven.approach * moving
    return before


def _pass_steps(plan: Plan, driven: DrivenPass, faults: FaultBoard) -> Iterator[Step]:
    stop, stuck = 0, False
    while stop < len(driven.stop_mm):
        place = (driven.setup, driven.number, stop)
        stuck = stuck or faults.take("count-stuck", *place) is not None
        if stop and (hold := faults.take("feed-hold", *place)):
            yield from _feed_hold(driven, stop, hold.duration_s)
        if plan.commission_s and driven.number == 1 and driven.setup.startswith("fourdof"):
            yield from _commissioning(plan.commission_s, driven, stop)
        if not faults.take("stop-skipped", *place):
            yield from _stop_steps(plan, driven, stop, faults, stuck=stuck)
        aborted = faults.take("program-aborted", *place)
        if aborted is None:
            stop += 1
            continue
        stop = max(0, stop - int(aborted.value))
        yield Step(
            kind="pause",
            setup=driven.setup,
            pass_number=driven.number,
            duration_s=aborted.duration_s,
            alarm=True,
        )
        yield from _approach(plan, driven, stop)


def _commissioning(
    stand_s: tuple[float, float, float], driven: DrivenPass, stop: int
) -> Iterator[Step]:
    ends = [end for end, at in ((0, 1), (-1, len(driven.stop_mm) - 1)) if stop == at]
    for end in ends:
        move = Step(
            kind="move",
            target_mm=driven.stop_mm[end],
            setup=driven.setup,
            pass_number=driven.number,
        )
        for beside, seconds in _jogs(axis_of_run(driven.setup) or 0, stand_s[0]):
            yield replace(move, target_mm=driven.stop_mm[end] + beside)
            if seconds:
                yield replace(
                    move,
                    kind="dwell",
                    target_mm=driven.stop_mm[end] + beside,
                    duration_s=seconds,
                    signalled=False,
                )
        yield replace(
            move, kind="dwell", duration_s=stand_s[1], signalled=False, wobbled=True
        )
        if end == -1:
            yield replace(
                move, kind="dwell", duration_s=stand_s[2], signalled=False, beam=False
            )


def _jogs(axis: int, stand_s: float) -> Iterator[tuple[Array, float]]:
    first, second = (np.eye(3)[other] for other in range(3) if other != axis)
    lead = -0.4 * (first + second)
    for across in (first, second):
        yield lead, 0.0
        for place in (-0.3, -0.15, 0.0, 0.15, 0.3):
            yield place * across, stand_s
    yield lead, 0.0
    yield 0.0 * lead, stand_s


def _feed_hold(driven: DrivenPass, stop: int, duration_s: float) -> Iterator[Step]:
    half_mm: Array = 0.5 * (driven.stop_mm[stop - 1] + driven.stop_mm[stop])
    move = Step(kind="move", target_mm=half_mm, setup=driven.setup, pass_number=driven.number)
    yield move
    yield replace(move, kind="dwell", duration_s=duration_s)


def _stop_steps(
    plan: Plan, driven: DrivenPass, stop: int, faults: FaultBoard, *, stuck: bool
) -> Iterator[Step]:
    place = (driven.setup, driven.number, stop)
    move = Step(
        kind="move",
        target_mm=driven.stop_mm[stop],
        setup=driven.setup,
        pass_number=driven.number,
        stop=stop,
    )
    yield move
    missed = stuck or faults.take("count-missed", *place)
    counts = 0 if missed else 1 + bool(faults.take("count-doubled", *place))
    silent = faults.take("stop-unsignalled", *place) is not None
    longer = faults.take("dwell-longer", *place)
    dwell_s = plan.dwell_s + (longer.duration_s if longer else 0.0)
    yield replace(
        move,
        kind="dwell",
        duration_s=dwell_s,
        counts=0 if silent else counts,
        signalled=not silent,
    )
