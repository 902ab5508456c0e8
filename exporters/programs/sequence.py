"""The path of a survey: the stops of every pass in order, and the point from which the machine
approaches the first stop of a pass.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES, BODY_DIAGONALS
from stepdiag.base.readings.runs import Plan, Run, first_count, run_stops_mm
from stepdiag.base.setups import setup_of
from stepdiag.base.volume import Vector, Volume
from stepdiag.exporters.programs.jogs import Jog, jogs_at

LARGEST_COUNT = 32767
"""Largest stop count: some controls send the stop count to the PLC as a signed 16-bit word."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sequence:
    """The commanded part of a survey, in machine coordinates.

    Each of the ``setups`` has a program. The setup ``ppp+1`` is a repetition of the body diagonal
    ppp with a shifted beam. The program of ``ppp+1`` drives the same stops as the program of ppp
    and sends the same setup number to the PLC; only the place of the laser differs.
    ``beam_offset_mm`` by setup, ``axis_orders``, ``alternate`` and ``targets`` are those of
    `stepdiag.base.readings.runs.Run`. A pass begins ``overrun_mm`` outside its first stop, so that
    every moving axis has taken up its backlash; with 0 the pass has no approach.
    """

    name: str
    volume: Volume
    setups: tuple[str, ...] = BODY_DIAGONALS
    axis_order: str = "xyz"
    return_pass: bool = True
    repeats: int = 1
    feed_mm_min: float = 2000.0
    dwell_s: float = 2.0
    overrun_mm: float = 5.0
    handshake: bool = False
    axis_orders: tuple[str, ...] = ()
    alternate: bool = False
    targets: int = 0
    beam_offset_mm: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    commission: bool = False
    """Whether the first pass of a run of the 4-DOF head also commissions the head (`jogs_at`)."""

    @property
    def plan(self) -> Plan:
        runs = tuple(
            Run(
                setup=setup,
                repeats=self.repeats,
                return_pass=self.return_pass,
                beam_offset_mm=self.beam_offset_mm.get(setup, (0.0, 0.0, 0.0)),
                axis_orders=self.axis_orders,
                alternate=self.alternate,
                targets=self.targets,
            )
            for setup in self.setups
        )
        return Plan(volume=self.volume, runs=runs, axis_order=self.axis_order)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """A commanded stop. ``axis`` is the axis that moves to the stop (x, y, z), empty for the first
    stop of a pass.

    ``count`` is the number that the PLC receives: it numbers the stops of the whole survey from 1.
    """

    stop: int
    count: int
    axis: str
    position_mm: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pass:
    """One pass of a setup. A pass with an odd number leads outward, a pass with an even number
    back.

    ``approach_mm`` is the point outside the first stop from which the machine approaches this stop,
    None without overrun.
    """

    number: int
    approach_mm: tuple[float, float, float] | None
    stops: tuple[Stop, ...]
    jogs: Mapping[int, tuple[Jog, ...]] = field(default_factory=dict)
    """The jogs before the move to a stop, by the number of the stop."""

    @property
    def outward(self) -> bool:
        return self.number % 2 == 1


def line_stops_mm(sequence: Sequence, setup: str, number: int = 1) -> Vector:
    """Return the commanded positions of a pass of a setup, shape (stops, 3)."""
    return run_stops_mm(sequence.plan, sequence.plan.run_of(setup), number)


def passes_of(sequence: Sequence, setup: str) -> tuple[Pass, ...]:
    """Return the passes of one setup in the order of driving.

    The stop counter continues from setup to setup in the order of ``sequence.setups``.
    """
    check(sequence)
    passes = []
    for number in _pass_numbers(sequence):
        stops = line_stops_mm(sequence, setup, number)
        count = first_count(sequence.plan, setup, number)
        passes.append(_pass(sequence, number, stops, count))
        if sequence.commission and number == 1 and setup_of(setup).is_fourdof:
            passes[0] = replace(passes[0], jogs=_jogs(stops, setup_of(setup).axis))
    return tuple(passes)


def travel_mm(sequence: Sequence, setup: str) -> Vector:
    """Return the lowest and the highest commanded position of each axis, at stops and approach
    points, shape (2, 3).
    """
    points = [
        point
        for each in passes_of(sequence, setup)
        for point in (
            each.approach_mm,
            *(stop.position_mm for stop in each.stops),
            *(jog.position_mm for jogs in each.jogs.values() for jog in jogs),
        )
        if point is not None
    ]
    return np.array([np.min(points, axis=0), np.max(points, axis=0)])


def check(sequence: Sequence) -> None:
    for name, number, least in (
        ("feed_mm_min", sequence.feed_mm_min, "above 0"),
        ("dwell_s", sequence.dwell_s, "above 0"),
        ("overrun_mm", sequence.overrun_mm, "of 0 or above"),
    ):
        if not np.isfinite(number) or number < 0 or (number == 0 and least == "above 0"):
            raise UsageError(
                f"plan.{name}",
                expected=message("number-limits", limits=least),
                found=repr(number),
            )
    if sequence.repeats < 1:
        raise UsageError(
            "plan.repeats", expected=message("1-or-more"), found=repr(sequence.repeats)
        )
    for order in (sequence.axis_order, *sequence.axis_orders):
        if sorted(order) != list(AXES):
            raise UsageError(
                "volume.axis_order", expected=message("each-x-y-z"), found=repr(order)
            )
    _check_setups(sequence)


def _check_setups(sequence: Sequence) -> None:
    for setup in sequence.setups:
        setup_of(setup, "plan.setups")
    if not sequence.setups or len(set(sequence.setups)) < len(sequence.setups):
        raise UsageError(
            "plan.setups",
            expected=message("at-least-one-setup"),
            found=", ".join(sequence.setups) or message("none"),
        )
    total = sum(_stops_in(sequence, setup) for setup in sequence.setups)
    if total > LARGEST_COUNT:
        raise UsageError(
            "plan",
            expected=message("at-most-stops-stop", largest_count=LARGEST_COUNT),
            found=str(total),
            remedy=message("fewer-setups-repeats-or"),
        )


def _pass_numbers(sequence: Sequence) -> Iterator[int]:
    for repeat in range(sequence.repeats):
        yield 2 * repeat + 1
        if sequence.return_pass:
            yield 2 * repeat + 2


def _stops_in(sequence: Sequence, setup: str) -> int:
    return len(line_stops_mm(sequence, setup)) * len(list(_pass_numbers(sequence)))


def _pass(sequence: Sequence, number: int, stops: Vector, count: int) -> Pass:
    approach = None
    if sequence.overrun_mm > 0:
        approach = _triple(stops[0] - sequence.overrun_mm * np.sign(stops[-1] - stops[0]))
    moved = [""] + [AXES[int(np.argmax(np.abs(step)))] for step in np.diff(stops, axis=0)]
    return Pass(
        number=number,
        approach_mm=approach,
        stops=tuple(
            Stop(
                stop=index,
                count=count + index,
                axis=moved[index],
                position_mm=_triple(stops[index]),
            )
            for index in range(len(stops))
        ),
    )


def _jogs(stops: Vector, axis: str) -> dict[int, tuple[Jog, ...]]:
    """Return the jogs by the number of the next stop. Jogs at the near end follow the first stop,
    jogs at the far end precede the last stop.
    """
    near, far = jogs_at(_triple(stops[0]), axis), jogs_at(_triple(stops[-1]), axis, last=True)
    return {1: (*near, *far)} if len(stops) == 2 else {1: near, len(stops) - 1: far}


def _triple(point: Vector) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z
