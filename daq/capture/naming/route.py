"""The stops of a pass, and the laser's readings between them."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Message, Way, message, run
from stepdiag.base.names import AXES
from stepdiag.base.readings.runs import (
    Plan,
    first_count,
    moving_order_of,
    run_stops_mm,
)
from stepdiag.base.setups import Setup, setup_of
from stepdiag.daq.capture.noise import (
    BESIDE_MM,
    FAILURE,
    PLACED_MM,
    RANGE_MM,
    SIGMAS,
    STEP_TOLERANCE,
    STILL_MM,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """A pass: commanded stops in the order of travel, shape (k, 3), and the nominal reading at
    each, relative to the first, shape (k,). ``along`` is the direction in which the reading
    increases. A position within ``beside_mm`` of a stop is at the stop. ``order`` is the order of
    the moving axes (``yzx``); empty if all passes of the setup have the same order. ``counts`` are
    the counts of the first stop in the NC programs, which number the stops of the survey from 1.
    """

    setup: str
    outward: bool
    stops_mm: NDArray[np.float64]
    nominal_mm: NDArray[np.float64]
    along: NDArray[np.float64]
    beside_mm: float
    order: str = ""
    counts: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.nominal_mm)

    @property
    def travel(self) -> Setup:
        return setup_of(self.setup)

    @property
    def way(self) -> Way:
        return "out" if self.outward else "back"

    @property
    def run(self) -> Message:
        return run(self.setup, self.way)

    def axis_to(self, stop: int) -> str:
        """Return the axis that moves to a stop; empty for the first."""
        if stop == 0:
            return ""
        return AXES[int(np.argmax(np.abs(self.stops_mm[stop] - self.stops_mm[stop - 1])))]

    def planned_mm(self, stop: int) -> tuple[float, float, float]:
        x_mm, y_mm, z_mm = self.stops_mm[stop].tolist()
        return x_mm, y_mm, z_mm

    def nominal_at_mm(self, position_mm: tuple[float, float, float]) -> float:
        """Return the nominal reading at any position, relative to the first planned stop."""
        return float((np.asarray(position_mm) - self.stops_mm[0]) @ self.along)

    def numbered(self, count: int) -> NDArray[np.bool_]:
        """Return which stops have a count in the NC programs, shape (k,)."""
        return np.isin(count - np.arange(len(self)), self.counts)

    def step_mm(self, from_stop: int, to_stop: int) -> float:
        """Return the nominal change of the reading between two stops."""
        return float(self.nominal_mm[to_stop] - self.nominal_mm[from_stop])

    def backward_mm(self, from_stop: int, to_stop: int) -> float:
        """Return the nominal change of the reading if the pass is driven from its other end."""
        return self.step_mm(len(self) - 1 - from_stop, len(self) - 1 - to_stop)

    def find(self, position_mm: tuple[float, float, float], expected: int) -> int | None:
        """Return the stop at a position, the nearest to the expected stop; None without one."""
        places = np.flatnonzero(self.beside(position_mm))
        return int(places[np.argmin(np.abs(places - expected))]) if len(places) else None

    def beside(self, position_mm: tuple[float, float, float]) -> NDArray[np.bool_]:
        """Return at which stops a position is, shape (k,)."""
        off = np.max(np.abs(self.stops_mm - np.asarray(position_mm)), axis=1)
        there: NDArray[np.bool_] = off <= self.beside_mm
        return there


@lru_cache(maxsize=256)
def route_of(plan: Plan, setup: str, number: int) -> Route:
    """Return the route of a pass of a setup of a plan, not to be written to. The return pass visits
    the stops of the outward one in reverse.

    Cached, because page and status need the routes of all setups ten times a second.
    """
    planned = plan.run_of(setup)
    stops = run_stops_mm(plan, planned, number)
    travel = np.array(planned.travel.signs) * np.array(plan.volume.size_mm)
    nominal = (stops - stops[0]) @ (travel / np.linalg.norm(travel))
    way = stops[-1] - stops[0]
    along = way / np.linalg.norm(way) * np.sign(nominal.sum())
    for column in (stops, nominal, along):
        column.setflags(write=False)
    least_mm = np.min(np.max(np.abs(np.diff(stops, axis=0)), axis=1), initial=np.inf)
    return Route(
        setup=setup,
        outward=number % 2 == 1,
        stops_mm=stops,
        nominal_mm=nominal,
        along=along,
        beside_mm=float(np.clip(0.1 * least_mm, PLACED_MM, BESIDE_MM)),
        order=moving_order_of(plan, planned, number) if planned.has_several_orders else "",
        counts=tuple(
            first_count(plan, setup, each)
            for each in planned.pass_numbers
            if each % 2 == number % 2
            and moving_order_of(plan, planned, each) == moving_order_of(plan, planned, number)
        ),
    )


def routes_of(plan: Plan, setup: str, numbers: Iterable[int]) -> tuple[Route, ...]:
    """Return the routes of the passes of a setup with the given numbers."""
    return tuple(route_of(plan, setup, number) for number in numbers)


def shared(known: Mapping[int, float], one: Route, other: Route) -> dict[int, float]:
    """Return the readings, by stop, of the stops that are at the same place on two routes of a
    setup in the same direction.
    """
    there = np.abs(one.stops_mm - other.stops_mm).max(axis=1) < PLACED_MM
    return {stop: reading for stop, reading in known.items() if there[stop]}


def step_noise_mm(way_mm: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the standard deviation of the laser's steps over ways in mm."""
    noise: NDArray[np.float64] = (STILL_MM + STEP_TOLERANCE * np.abs(way_mm)) / SIGMAS
    return noise


def agrees(measured_mm: float, nominal_mm: float) -> bool:
    """Return whether a measured step is the nominal step: their difference is noise."""
    return abs(measured_mm - nominal_mm) <= STILL_MM + STEP_TOLERANCE * abs(nominal_mm)


def log_normal(
    off: NDArray[np.float64], scale: float | NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the logarithm of a normal density."""
    density: NDArray[np.float64] = -0.5 * (off / scale) ** 2 - np.log(
        scale * math.sqrt(2 * math.pi)
    )
    return density


def log_likelihood(
    off: NDArray[np.float64], scale: float | NDArray[np.float64], within: float = RANGE_MM
) -> NDArray[np.float64]:
    """Return the logarithm of the likelihood of residuals: normal, or at the rate `FAILURE`
    anywhere ``within`` a range.
    """
    failed = math.exp(-FAILURE) / within
    density: NDArray[np.float64] = np.log(np.exp(log_normal(off, scale)) + failed)
    return density


def judge_step(
    route: Route, from_stop: int, to_stop: int, measured_mm: float, absolute_mm: float
) -> Message | None:
    """Return the fault of a measured step: the first other step with which it agrees; None where it
    agrees with the step of the plan.

    ``absolute_mm`` is the reading itself: after zeroing, a laser reads nearly zero.
    """
    nominal, axis = route.step_mm(from_stop, to_stop), route.axis_to(to_stop)
    if agrees(measured_mm, nominal):
        return None
    sizes = {"moved_mm": measured_mm, "wanted_mm": nominal}
    start = ", ".join(f"{value:g}" for value in route.stops_mm[0])
    from_the_end = route.backward_mm(from_stop, to_stop)
    wrong_sign = (
        message("wrong-laser-sign.or-end", **sizes, start=start)
        if agrees(measured_mm, from_the_end)
        else message("wrong-laser-sign", **sizes)
    )
    faults = [
        (-nominal, wrong_sign),
        (from_the_end, message("wrong-direction", **sizes, start=start)),
        (0.0, message("no-move", **sizes)),
    ]
    if to_stop + 1 < len(route):
        after_mm = route.step_mm(from_stop, to_stop + 1)
        missing = message("stop-missing.sequence", after_mm=after_mm, **sizes)
        faults.append((after_mm, missing))
    for stop in range(max(1, to_stop - 2), min(len(route), to_stop + 3)):
        if (other := route.axis_to(stop)) != axis:
            axes = {"other": other.upper(), "axis": axis.upper()}
            faults.append(
                (route.step_mm(stop - 1, stop), message("wrong-axis-order", **sizes, **axes))
            )
    unexplained = (
        message("laser-reset", **sizes)
        if abs(absolute_mm) <= STILL_MM
        else message("step-mismatch", **sizes)
    )
    return next(
        (words for step_mm, words in faults if agrees(measured_mm, step_mm)), unexplained
    )
