"""Fit of a hypothesis to the standstills of a pass: by positions, by the laser's steps, and by the
times of its moves.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Message
from stepdiag.daq.capture.naming.route import Route, log_likelihood, step_noise_mm
from stepdiag.daq.capture.noise import (
    BESIDE_MM,
    FAILURE,
    FAULT,
    LAG_NS,
    LEAST_SAMPLES,
    MOMENT_NS,
    ORDINARY,
    PLACED_MM,
    RANGE_MM,
    SIGMAS,
)
from stepdiag.daq.capture.standing.dwell import Dwell
from stepdiag.daq.capture.standing.window import BIN_NS, EDGE_NS, find_plateaus
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.timing.stream import StreamBuffer

MOVES = {1: 0.0, 0: FAILURE, 2: FAILURE, 3: FAILURE}
CONFIRMED = LEAST_SAMPLES - 1
"""Least number of agreeing steps, or moves, before a cause is named: the steps between the fewest
standstills that show a cause.
"""
APART_MM = SIGMAS * PLACED_MM
"""A position further from a hypothesis than this does not support the hypothesis."""
FREE = math.log(RANGE_MM / PLACED_MM)
ON_TIME = (0.0, 0.0)
EDGE_S = BIN_NS * 1e-9
"""An edge of a plateau is known to its bins."""
LEAST_LATE_S, MOST_LATE_S = 2 * EDGE_NS * 1e-9, 2 * LAG_NS * 1e-9
"""Smallest lateness that is more than both edges of a move leave open, and the largest that is
searched.
"""
RANGE_S = 2 * MOST_LATE_S
Matrix = NDArray[np.float64]
Change = tuple[str, str]
"""A line of the survey file as a dotted name, and its new value."""


@dataclass(frozen=True, slots=True)
class Move:
    """A move seen by the laser: its delays in s against the signals, on leaving the standstill
    before and on arriving, and its length.

    ``u_s`` is the standard uncertainty of both times: the bins of the plateaus and the pace of the
    polls.
    """

    left_s: float
    came_s: float
    step_mm: float
    u_s: float

    def fits(self, late_s: tuple[float, float]) -> float:
        """Return the logarithm of the likelihood of both times, if the laser is later than the
        signals by the given delay.
        """
        off = np.array([self.left_s - late_s[0], self.came_s - late_s[1]])
        return float(np.sum(log_likelihood(off, self.u_s, RANGE_S)))

    def is_at(self, late_s: tuple[float, float]) -> bool:
        """Return whether both times fit a laser that is later than the signals by ``late_s``."""
        off_s = max(abs(self.left_s - late_s[0]), abs(self.came_s - late_s[1]))
        return off_s < SIGMAS * self.u_s


@dataclass(frozen=True, slots=True)
class Stand:
    """A standstill: the decoded signals, the laser's reading (None: no beam), and the number of
    losses of its count until then.

    ``moves`` are the laser's possible moves to this standstill; none without plateaus.
    """

    signals: Signals
    reading_mm: float | None
    losses: int = 0
    moves: tuple[Move, ...] = ()

    def move(self, late_s: tuple[float, float]) -> Move | None:
        """Return the move to this standstill if the laser is later than the signals by the given
        delay; None without a move.
        """
        return max(self.moves, key=lambda move: move.fits(late_s), default=None)


def moves_between(laser: StreamBuffer, before: Dwell, dwell: Dwell) -> tuple[Move, ...]:
    """Return the laser's moves between two consecutive dwells: from any plateau to any later
    plateau.

    The moments of the signals lie between two polls; those of the laser are the edges of its
    plateaus.
    """
    poll_ns = dwell.from_ns - (dwell.not_before_ns or dwell.from_ns)
    span = laser.span(before.from_ns - MOST_LATE_S * 1e9, math.inf)
    levels = find_plateaus(span.time_ns, span.position_mm, MOMENT_NS * 1e-9)
    u_s = math.hypot(EDGE_S, poll_ns * 1e-9 / math.sqrt(12))
    moves = (
        Move(
            (level.to_ns - before.to_ns - poll_ns / 2) * 1e-9,
            (after.from_ns - dwell.from_ns + poll_ns / 2) * 1e-9,
            after.level_mm - level.level_mm,
            u_s,
        )
        for number, level in enumerate(levels)
        for after in levels[number + 1 :]
    )
    return tuple(
        each
        for each in moves
        if abs(each.left_s) < MOST_LATE_S
        and abs(each.came_s) < MOST_LATE_S
        and abs(each.step_mm) > BESIDE_MM
    )


@dataclass(frozen=True, slots=True)
class Cause:
    """A hypothesis: the machine's path, the control's positions on it, the laser's readings on it,
    and the lines to change.

    ``factors`` and ``shifts_mm`` map planned positions to shown positions, whose axes are taken in
    the order ``axes``. ``free`` is the number of fitted numbers.
    """

    route: Route
    axes: tuple[int, ...] = (0, 1, 2)
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    shifts_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    laser: float = 1.0
    late_s: tuple[float, float] = ON_TIME
    free: int = 0
    kind: str = ""
    what: Message | None = None
    changes: tuple[Change, ...] = ()

    def shown_mm(self, count: int) -> Matrix:
        """Return the positions that the control shows at the first standstills, shape
        (count, 3)."""
        stops = self.route.stops_mm[:count][:, list(self.axes)]
        shown: Matrix = stops * self.factors + self.shifts_mm
        return shown

    def steps_mm(self, count: int) -> Matrix:
        """Return the laser's steps between the first standstills, shape (count - 1,)."""
        steps: Matrix = self.laser * np.diff(self.route.nominal_mm[:count])
        return steps

    def parts_from(self, other: "Cause", stops: int) -> int | None:
        """Return the number of the first stop, after the given number, at which another hypothesis
        shows another position or step; None without such a stop.
        """
        count = min(len(self.route), len(other.route))
        apart = np.any(
            np.abs(self.shown_mm(count) - other.shown_mm(count)) > APART_MM, axis=1
        )
        apart[1:] |= ~_agrees(self.steps_mm(count), other.steps_mm(count))
        later = np.flatnonzero(apart[stops:])
        return stops + int(later[0]) if len(later) else None


@dataclass(slots=True)
class Evidence:
    """The standstills of a pass so far."""

    stands: list[Stand] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.stands)

    def steps_mm(self, late_s: tuple[float, float] = ON_TIME) -> Matrix:
        """Return the laser's steps between the standstills; if the laser is late against the
        signals, the steps of its moves at that time.
        """
        readings = [
            math.nan if each.reading_mm is None else each.reading_mm for each in self.stands
        ]
        steps: Matrix = np.diff(np.array(readings))
        if late_s != ON_TIME:
            moves = [each.move(late_s) for each in self.stands[1:]]
            steps = np.array(
                [
                    step if move is None else move.step_mm
                    for step, move in zip(steps, moves, strict=True)
                ]
            )
        return steps

    def shown_mm(self) -> Matrix | None:
        places = [each.signals.commanded_mm for each in self.stands]
        return None if None in places else np.array(places, dtype=np.float64)

    def fits(self, causes: Sequence[Cause]) -> Matrix:
        """Return the logarithms of the likelihoods of hypotheses and of their priors, without the
        edges of their moves, shape (n,): all at once, because the machine waits meanwhile.
        """
        count, shown, steps_mm = len(self), self.shown_mm(), cache(self.steps_mm)
        scores = np.array([-FAULT * bool(each.changes) - FREE * each.free for each in causes])
        wanted = np.array([each.steps_mm(count) for each in causes])
        off = np.array([steps_mm(each.late_s) for each in causes]) - wanted
        scores += np.nansum(log_likelihood(off, step_noise_mm(wanted)), axis=1)
        if shown is not None:
            apart = shown - np.array([each.shown_mm(count) for each in causes])
            scores += _placed(apart).sum(axis=1)
        return scores

    def as_stated(self, route: Route) -> float:
        """Return the best logarithm of the likelihood of the unchanged file, over the errors of a
        pass at single stops.

        A standstill is the next stop. At the cost `FAILURE` it may be the same stop again, a stop
        one or two further on, or no stop: a place anywhere on the way. Its step counts from the
        last standstill that is a stop.
        """
        shown, nominal = self.shown_mm(), route.nominal_mm
        readings = np.array([each.reading_mm for each in self.stands], dtype=np.float64)
        usual_mm = step_noise_mm(np.median(np.abs(np.diff(nominal)), keepdims=True))
        alike = float(log_likelihood(np.zeros(1), usual_mm)[0])
        here = np.zeros((len(self), len(route)))
        nowhere = np.full(len(self), -FAILURE - math.log(RANGE_MM))
        if shown is not None:
            here = _placed(shown[:, None] - route.stops_mm)
            nowhere += 2 / 3 * float(_placed(np.zeros((1, 3)))[0])
            nowhere[1:] += alike
        paths: dict[tuple[int, int], float] = {(-1, -1): 0.0}
        for number, reading_mm in enumerate(readings):
            # the machine may have reversed at its first stop, whose reading the pass before holds
            moves = [
                (stop, base, stop + on, score - (ORDINARY if (stop, on) == (-1, 2) else cost))
                for (stop, base), score in paths.items()
                for on, cost in MOVES.items()
                if 0 <= stop + on < len(route)
            ]
            stop, base, there, score = np.array(moves).reshape(-1, 4).T
            stop, base, there = (each.astype(np.intp) for each in (stop, base, there))
            before_mm = np.where(base >= 0, readings[base], math.nan)
            wanted = nominal[there] - nominal[stop]
            stepped = log_likelihood(reading_mm - before_mm - wanted, step_noise_mm(wanted))
            stepped[np.isnan(stepped)] = alike if number else 0.0
            scores = score + here[number, there] + stepped
            following = {key: on + float(nowhere[number]) for key, on in paths.items()}
            for place, on in zip(there.tolist(), scores.tolist(), strict=True):
                key = place, number
                following[key] = max(following.get(key, -math.inf), on)
            paths = following
        return max(paths.values())

    def in_time(self, late_s: tuple[float, float]) -> float:
        """Return the logarithm of the likelihood of the edges of the moves, if the laser is later
        than the signals by ``late_s`` (begin, end).
        """
        moves = [each.move(late_s) for each in self.stands]
        return sum(move.fits(late_s) for move in moves if move is not None)

    def confirms(self, cause: Cause) -> bool:
        """Return whether the laser has confirmed enough steps, or the times of enough moves, and no
        position contradicts them.
        """
        shown = self.shown_mm()
        if shown is not None and np.abs(shown - cause.shown_mm(len(shown))).max() > APART_MM:
            return False
        if cause.late_s != ON_TIME:
            seen = [
                (move, cause.late_s)
                for each in self.stands
                if (move := each.move(cause.late_s)) is not None
            ]
            alike = [move.is_at(late_s) for move, late_s in seen]
            return sum(alike) >= CONFIRMED and self.agreeing(cause) >= CONFIRMED
        return self.agreeing(cause) >= CONFIRMED

    def begin(self, route: Route) -> int | None:
        """Return the stop, the first or second of the route, from which every standstill is the
        next stop, by position and by the laser; None without such a stop.
        """
        steps, shown, count = self.steps_mm(), self.shown_mm(), len(self.stands)
        for begin in (0, 1):
            places, wanted = (
                route.stops_mm[begin : begin + count],
                np.diff(route.nominal_mm[begin : begin + count]),
            )
            there = len(places) == count and (
                shown is None or bool(np.abs(shown - places).max() <= APART_MM)
            )
            if there and bool(np.all(_agrees(steps, wanted))):
                return begin
        return None

    def covers(self, route: Route) -> bool:
        """Return whether so many standstills have a step of every axis of a route: until then a
        wrong length of an axis shows only in how it turns the diagonal.
        """
        axes = [route.axis_to(stop) for stop in range(1, len(route))]
        return set(axes[: len(self) - 1]) == set(axes)

    def agreeing(self, cause: Cause) -> int:
        """Return the number of the laser's steps that agree with a hypothesis."""
        wanted = cause.steps_mm(len(self.stands))
        return int(np.count_nonzero(_agrees(self.steps_mm(cause.late_s), wanted)))


def _agrees(steps: Matrix, wanted: Matrix) -> NDArray[np.bool_]:
    """Return the steps that agree with the expected steps: their difference is noise."""
    agreeing: NDArray[np.bool_] = np.abs(steps - wanted) <= SIGMAS * step_noise_mm(wanted)
    return agreeing


def _placed(off_mm: Matrix) -> Matrix:
    """Return the logarithm of the likelihood of positions that are off by (..., stops, 3)."""
    placed: Matrix = log_likelihood(off_mm, PLACED_MM).sum(axis=-1)
    return placed
