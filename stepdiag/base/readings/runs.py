"""The plan of a survey: its runs, their stops and their duration in minutes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.base.setups import Setup, setup_of
from stepdiag.base.volume import Vector, Volume, irregular_mm, nodes_to_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """A run of a survey: its setup, the number of its passes out (and back), and its measured line.

    ``beam_offset_mm``: distance of the measured line from the usual line of the setup. Along a
    standing axis it is the distance from the low end of the axis; across the moving axes it is the
    shift of the beam. ``axis_orders``: the orders in which a step diagonal moves its axes, one for
    each repeat in turn; if empty, the order of the plan is used. ``alternate``: different setups
    begin with different orders. ``targets``: approximate number of irregular targets
    (`irregular_mm`) of a linear run; with 0 the targets are the nodes.
    """

    setup: str
    repeats: int = 1
    return_pass: bool = True
    beam_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis_orders: tuple[str, ...] = ()
    alternate: bool = False
    targets: int = 0

    @property
    def is_fourdof(self) -> bool:
        return self.travel.is_fourdof

    @property
    def travel(self) -> Setup:
        """Return the setup of the run as a `Setup`. Raises ``UsageError`` for an invalid name."""
        return setup_of(self.setup, "plan: setup")

    @property
    def orders(self) -> tuple[str, ...]:
        """Return the axis orders of the run, beginning with the order of its first repeat."""
        if not self.alternate or self.travel.kind not in ("step", "face"):
            return self.axis_orders
        # the first axis order depends only on the name of the setup, so that an additional setup in
        # the plan does not change the orders of other setups
        first = self.travel.order[0] % max(len(self.axis_orders), 1)
        return (*self.axis_orders[first:], *self.axis_orders[:first])

    @property
    def driven_orders(self) -> tuple[str, ...]:
        """Return the axis orders that the repeats of the run use, without duplicates; empty for a
        run along one axis."""
        several = self.travel.kind in ("step", "face")
        return tuple(dict.fromkeys(self.orders[: self.repeats])) if several else ()

    @property
    def has_several_orders(self) -> bool:
        """Return whether the repeats of the run move the axes in different orders."""
        return len({_moving(self.travel, order) for order in self.driven_orders}) > 1

    @property
    def pass_numbers(self) -> range:
        return range(1, 2 * self.repeats + 1, 1 if self.return_pass else 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """Durations in minutes of the parts of a survey. ``diagonal_setup_min`` and similar fields:
    placing and aligning the optics for a setup of this kind. ``beam_shift_min``: moving the beam to
    another line of the same setup.

    The four published diagonals of 1 m^3 take 2 to 4 hours, nearly all of it for setting up.
    """

    feed_mm_min: float = 2000.0
    dwell_s: float = 2.0
    overrun_mm: float = 5.0
    diagonal_setup_min: float = 30.0
    linear_setup_min: float = 20.0
    fourdof_setup_min: float = 25.0
    beam_shift_min: float = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The runs of a survey in a volume. Step diagonals move their axes in ``axis_order``."""

    volume: Volume
    runs: tuple[Run, ...]
    axis_order: str = "xyz"
    pace: Pace = Pace()

    def with_runs(self, *added: Run) -> "Plan":
        """Return the plan with further runs. A second run of a setup gets the next free number
        (``ppp+1``)."""
        runs = list(self.runs)
        for run in added:
            taken = {other.setup for other in runs}
            names = map(run.travel.shifted, range(len(taken) + 1))
            runs.append(replace(run, setup=next(name for name in names if name not in taken)))
        return replace(self, runs=tuple(runs))

    def run_of(self, setup: str) -> Run:
        """Return the run of a setup; for a setup outside the plan, a run along its usual line.
        Raises ``UsageError`` for an invalid name."""
        return next((run for run in self.runs if run.setup == setup), Run(setup=setup))


def run_stops_mm(plan: Plan, run: Run, number: int = 1) -> Vector:
    """Return the commanded positions of a pass in the order of travel, shape (stops, 3)."""
    setup, order = run.travel, order_of(plan, run, number)
    signs, size = np.array(setup.signs), np.array(plan.volume.size_mm)
    if run.targets and setup.kind == "linear":
        axis = AXES.index(setup.axis)
        at_mm = irregular_mm(plan.volume, axis, run.targets)
        stops = np.tile(np.array(plan.volume.origin_mm), (len(at_mm), 1))
        stops[:, axis] = at_mm
    else:
        stops = nodes_to_mm(plan.volume, _nodes(plan.volume.increments, setup, order))
    stops = stops + np.where((signs == 0) & (size > 0), run.beam_offset_mm, 0.0)
    return stops if number % 2 else stops[::-1]


def first_count(plan: Plan, setup: str, number: int) -> int:
    """Return the count of a pass's first stop in the NC programs: these number the stops of the
    survey from 1."""
    count = 1
    for planned in plan.runs:
        stops = len(run_stops_mm(plan, planned))
        if planned.setup == setup:
            return count + stops * planned.pass_numbers.index(number)
        count += stops * len(planned.pass_numbers)
    return count


def order_of(plan: Plan, run: Run, number: int) -> str:
    """Return the order in which a pass moves the axes. An outward pass and the back pass after it
    have the same order."""
    orders = run.orders or (plan.axis_order,)
    return orders[(number - 1) // 2 % len(orders)]


def moving_order_of(plan: Plan, run: Run, number: int) -> str:
    """Return the moving axes of a pass in the order in which they move: ``yzx`` on a body diagonal,
    ``yx`` on a face diagonal.
    """
    return _moving(run.travel, order_of(plan, run, number))


def _moving(setup: Setup, order: str) -> str:
    return "".join(axis for axis in order if setup.signs[AXES.index(axis)])


def _nodes(n: int, setup: Setup, order: str) -> NDArray[np.int64]:
    signs = np.array(setup.signs)
    moving = [AXES.index(axis) for axis in _moving(setup, order)]
    together = setup.kind == "body"
    moves = np.zeros((n if together else n * len(moving), 3), dtype=np.int64)
    for place, axis in enumerate(moving):
        moves[(slice(None) if together else slice(place, None, len(moving))), axis] = 1
    walked = np.vstack([np.zeros(3, dtype=np.int64), np.cumsum(moves, axis=0)])
    return np.where(signs < 0, n - walked, walked)


def run_minutes(plan: Plan, run: Run) -> float:
    """Return the minutes of a run: setting up, travel at feed, dwells, and the overrun at both ends
    of a pass."""
    pace = plan.pace
    stops = run_stops_mm(plan, run)
    travel_mm = (
        float(np.linalg.norm(np.diff(stops, axis=0), axis=1).sum()) + 4 * pace.overrun_mm
    )
    one_pass = travel_mm / pace.feed_mm_min + len(stops) * pace.dwell_s / 60
    back_mm = float(np.linalg.norm(stops[-1] - stops[0]))
    # without return passes the machine still has to go back before it can start again
    idle = 0.0 if run.return_pass else (run.repeats - 1) * back_mm / pace.feed_mm_min
    return setup_minutes(plan, run) + len(run.pass_numbers) * one_pass + idle


def setup_minutes(plan: Plan, run: Run) -> float:
    """Return the minutes for setting up a run. A shift of the beam to another line of the same
    setup needs no new alignment."""
    pace, setup = plan.pace, run.travel
    before = plan.runs[: plan.runs.index(run)] if run in plan.runs else plan.runs
    if any(other.travel.base == setup.base for other in before):
        return pace.beam_shift_min
    if run.is_fourdof:
        return pace.fourdof_setup_min
    return pace.linear_setup_min if setup.kind == "linear" else pace.diagonal_setup_min


def plan_minutes(plan: Plan) -> float:
    return sum(run_minutes(plan, run) for run in plan.runs)


def perfect_readings(plan: Plan, reading_u_um: float = np.nan) -> Readings:
    """Return the readings of a perfect machine; a forecast depends only on the places of the stops.

    Raises ``UsageError`` for a plan without a run of the laser.
    """
    laser = [run for run in plan.runs if not run.is_fourdof]
    if not laser:
        raise UsageError(
            "plan: setups", expected=message("at-least-one-run"), found=message("none")
        )
    parts = [part for run in laser for part in _passes(plan, run)]
    count = sum(len(stops) for _, _, stops, _ in parts)
    return make_readings(
        setup=[run.setup for run, _, stops, _ in parts for _ in stops],
        pass_number=np.concatenate(
            [np.full(len(stops), number) for _, number, stops, _ in parts]
        ),
        stop=np.concatenate([np.arange(len(stops)) for _, _, stops, _ in parts]),
        position_mm=np.vstack([stops for _, _, stops, _ in parts]),
        reading_mm=np.concatenate(
            [(stops - stops[0]) @ _direction(plan, run) for run, _, stops, _ in parts]
        ),
        u_um=np.full(count, reading_u_um),
        beam_mm=np.vstack(
            [np.broadcast_to(beam, stops.shape) for _, _, stops, beam in parts]
        ),
    )


def beam_mm(plan: Plan, run: Run) -> Vector:
    """Return a point of the beam line of a run, shape (3,): its first stop on the usual line,
    shifted by the offset of the beam."""
    usual = run_stops_mm(plan, replace(run, beam_offset_mm=(0.0, 0.0, 0.0)))[0]
    beam: Vector = usual + np.array(run.beam_offset_mm)
    return beam


def _passes(plan: Plan, run: Run) -> Sequence[tuple[Run, int, Vector, Vector]]:
    beam = beam_mm(plan, run)
    return [
        (run, number, run_stops_mm(plan, run, number), beam) for number in run.pass_numbers
    ]


def _direction(plan: Plan, run: Run) -> Vector:
    travel = np.array(run.travel.signs) * np.array(plan.volume.size_mm)
    unit: Vector = travel / np.linalg.norm(travel)
    return unit
