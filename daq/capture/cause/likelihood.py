"""Fit of a hypothesis to the standstills of a pass: to the positions, to the laser's steps, and to
the times of the laser's moves.
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
"""A changed line of the survey file: its dotted name, and its new value."""


@dataclass(frozen=True, slots=True)
class Move:
    """A move seen by the laser: its length, and its delays in s against the signals at the
    departure and at the arrival.

    ``u_s`` is the standard uncertainty of both delays, from the bins of the plateaus and the period
    of the polls.
    """

    left_s: float
    came_s: float
    step_mm: float
    u_s: float

    def fits(self, late_s: tuple[float, float]) -> float:
        """Return the logarithm of the likelihood of both delays if the laser is later than the
        signals by ``late_s``.
        """
        off = np.array([self.left_s - late_s[0], self.came_s - late_s[1]])
        return float(np.sum(log_likelihood(off, self.u_s, RANGE_S)))

    def is_at(self, late_s: tuple[float, float]) -> bool:
        """Return whether both delays of the move fit a laser that is later than the signals by
        ``late_s``.
        """
        off_s = max(abs(self.left_s - late_s[0]), abs(self.came_s - late_s[1]))
        return off_s < SIGMAS * self.u_s


@dataclass(frozen=True, slots=True)
class Stand:
    """A standstill: the decoded signals, the laser's reading (None: no beam), and the number of
    losses of the laser's count until then.

    ``moves`` are the laser's possible moves to this standstill; none without plateaus.
    """

    signals: Signals
    reading_mm: float | None
    losses: int = 0
    moves: tuple[Move, ...] = ()

    def move(self, late_s: tuple[float, float]) -> Move | None:
        """Return the laser's move to this standstill if the laser is later than the signals by
        ``late_s``; None without a move.
        """
        return max(self.moves, key=lambda move: move.fits(late_s), default=None)


def moves_between(
    laser: StreamBuffer, before: Dwell, dwell: Dwell, least_s: float
) -> tuple[Move, ...]:
    """Return the laser's possible moves between two consecutive dwells: from each plateau to each
    later plateau.

    The times of the signals lie between two polls; the times of the laser are the edges of its
    plateaus. ``least_s`` is the least duration of a plateau: with a longer one the standstills of a
    hasty machine are missing, and a later move of the same size takes the place of the right one.
    """
    poll_ns = dwell.from_ns - (dwell.not_before_ns or dwell.from_ns)
    span = laser.span(before.from_ns - MOST_LATE_S * 1e9, math.inf)
    levels = find_plateaus(span.time_ns, span.position_mm, least_s)
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
    """A hypothesis: the path of the machine, the positions and the readings along this path, and
    the lines of the survey file to change.

    ``factors`` and ``shifts_mm`` map planned positions to the positions that the control shows,
    with the axes in the order ``axes``. ``free`` is the number of fitted numbers.
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
        """Return the number of the first stop, after the first ``stops``, at which two hypotheses
        differ in position or step; None without such a stop.
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
        """Return the laser's steps between the standstills; with a delay ``late_s``, the steps of
        the moves with this delay.
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
        """Return the sum of log-likelihood and log-prior of each hypothesis, without the times of
        the moves, shape (n,). All are computed at once, because the machine waits meanwhile.
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
        """Return the largest log-likelihood of the unchanged file, over all paths with errors at
        single stops.

        A standstill is usually the next stop. At the cost `FAILURE` it may be the same stop again,
        the stop one or two after the next, or no stop but any place on the way. The step to a
        standstill counts from the last standstill at a stop.
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
            # the machine may have reversed at its first stop; the previous pass then holds this
            # stop's reading
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
        """Return the log-likelihood of the times of the moves if the laser is later than the
        signals by ``late_s`` (at begin and end of a move).
        """
        moves = [each.move(late_s) for each in self.stands]
        return sum(move.fits(late_s) for move in moves if move is not None)

    def confirms(self, cause: Cause) -> bool:
        """Return whether the laser has confirmed enough steps or times of moves of a hypothesis,
        and no position contradicts the hypothesis.
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
        """Return the stop (first or second of the route) at which the pass begins so that every
        further standstill is the next stop, by position and by the laser; None without such a stop.
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
        """Return whether the standstills contain a step of every axis of a route. A wrong length of
        an axis that has not moved shows only in the direction of the diagonal.
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
