"""The most probable path of a pass over its standstills, and its comparison with the laser."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, Severity, finding
from stepdiag.base.messages import Message, Place, message
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.naming.route import (
    Route,
    judge_step,
    log_likelihood,
    log_normal,
    shared,
    step_noise_mm,
)
from stepdiag.daq.capture.noise import (
    BESIDE_MM,
    FAILURE,
    FAULT,
    ORDINARY,
    PLACED_MM,
    RANGE_MM,
    SIGMAS,
)
from stepdiag.daq.capture.standing.dwell import COUNT_MODULUS, count_steps
from stepdiag.daq.formats.signals import Signals

BEGIN, RARE = 2 * math.log(RANGE_MM), 2 * FAULT
"""The costs of a log that does not begin with the first stop of a pass (the two steps of three
stops that agree outweigh the cost), and of a step that the program does not plan.
"""
SURE = 2.0
"""Difference of log-likelihood by which the path of a name has to exceed those of all other names
to make it sure.
"""
KEPT, WITHIN = 12, 25.0
"""Largest number of paths that are followed, and the log-likelihood by which a followed path may
lie below the best path: the machine waits meanwhile.
"""
BREAKS_COUNT = {"laser-reset", "step-mismatch"}
"""A step of the wrong size without an explanation is a lost count: the readings after it are right
again, relative to each other.
"""
BEGUN_ANEW = message("begun-anew")
Costs = NDArray[np.float64]
Position = tuple[float, float, float] | None
Known = Mapping[int, float]


@dataclass(frozen=True, slots=True)
class Look:
    """The observations of a standstill; None for what the machine does not show.

    ``lost``: the laser's count does not reach back to the standstill before. ``after_mm``: the
    reading at the end of the standstill if its count was lost within it.
    """

    position_mm: Position = None
    count: int | None = None
    reading_mm: float | None = None
    lost: bool = False
    after_mm: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """A path up to a standstill: the logarithm of its probability (``score``), the index of its
    route (``way``), and its last stop (-1 before the first).

    ``nowhere``: the machine stands at no stop; ``astray``: the step to the stop is not a step of
    the plan. ``known`` are the readings of stops in the laser's present count, ``left_mm`` is the
    last reading, ``names`` are the stops of all standstills of this count.
    """

    score: float = 0.0
    way: int = 0
    stop: int = -1
    nowhere: bool = False
    astray: bool = False
    known: Known = field(default_factory=dict)
    left_mm: float | None = None
    count: int | None = None
    miscounts: bool = False
    names: tuple[int | None, ...] = ()

    @property
    def name(self) -> int | None:
        return None if self.nowhere else self.stop


OUT, BACK = range(2)
"""The ways of a setup in the chain's routes."""


def beginnings(on: Path, known: Known, stops: int, cost: float) -> tuple[Path, ...]:
    """Return the path of a pass that goes on, the path of a pass that begins in the other
    direction, and two paths of a pass in the other direction whose first standstills were missed.

    A pass in the other direction has a ``cost``, and its counter agrees by chance. The counter
    shows how many stops were missed before and after the turn; the turn counts as one stop or as
    two. These paths begin at a negative stop. ``known`` are the readings of the laser's unbroken
    count, by stop of the outward route.
    """
    counts = on.stop >= 0 and on.count is not None
    levels = known, {stops - 1 - stop: reading for stop, reading in known.items()}
    other = Path(
        score=-cost - FAILURE * counts,
        way=1 - on.way,
        known=levels[1 - on.way],
        count=on.count,
    )
    over = (
        replace(other, score=0.0, stop=stop)
        for stop in (on.stop - stops, on.stop - stops + 1)
        if counts and stop < -1
    )
    return replace(on, known=levels[on.way]), other, *over


class Chain:
    """Follows a pass on one of several routes. ``margin`` is the margin of the last name.

    ``signalled``: the machine signals its stops. A machine without signals stands anywhere before
    its first stop. So each reading without memory is a coincidence, and a step outside the plan
    leads to no stop.
    """

    def __init__(
        self, routes: tuple[Route, ...], *begins: Path, signalled: bool = True
    ) -> None:
        self._routes = routes
        self._signalled = signalled
        self._paths = list(begins)
        self.margin = math.inf

    @property
    def best(self) -> Path:
        return self._paths[0]

    def take(self, look: Look) -> Path:
        """Add a standstill; return the most probable path to it."""
        best: dict[tuple[int, int, bool, bool], Path] = {}
        for path in (*self._paths, *_other_orders(self.best, self._routes)):
            for on in self._following(path, look):
                key = on.way, on.stop, on.nowhere, on.astray
                if key not in best or best[key].score < on.score:
                    best[key] = on
        paths = sorted(best.values(), key=lambda path: -path.score)[:KEPT]
        first = paths[0]
        others = (
            path.score for path in paths if (path.way, path.name) != (first.way, first.name)
        )
        self.margin = first.score - max(others, default=-math.inf)
        self._paths = [
            replace(path, count=look.count, names=(*path.names, path.name))
            for path in paths
            if first.score - path.score < WITHIN
        ]
        return self.best

    def _following(self, path: Path, look: Look) -> Iterator[Path]:
        route = self._routes[path.way]
        if look.lost:
            path = replace(path, known={}, left_mm=None, names=())
        move, counted, counted_nowhere = _costs(path, look, route)
        score = path.score - move - counted
        idle = BEGIN if self._signalled else ORDINARY
        nowhere = path.score - (idle if path.stop == -1 else FAULT) - counted_nowhere
        fits = np.ones(len(route), dtype=bool)
        if look.position_mm is not None:
            score[~route.beside(look.position_mm)] = -math.inf
            nowhere -= 3 * math.log(RANGE_MM / PLACED_MM)
        if look.reading_mm is not None and (path.known or not self._signalled):
            read, fits = _reading_likelihood(path.known, path.stop, route, look.reading_mm)
            score += read
            nowhere -= math.log(RANGE_MM)
        left_mm = look.reading_mm if look.after_mm is None else look.after_mm
        at = replace(path, nowhere=False, astray=False, left_mm=left_mm)
        for stop in np.flatnonzero(score > max(score.max() - WITHIN, -1e9)).tolist():
            before = path.known if fits[stop] and look.after_mm is None else {}
            known = before if left_mm is None else {**before, stop: left_mm}
            to = float(score[stop])
            yield replace(
                at, score=to, stop=stop, known=known, miscounts=bool(counted[stop] > 0)
            )
        yield replace(path, score=nowhere, nowhere=True)
        if self._signalled and look.position_mm is None:
            yield from _astray(path, at, look, counted, np.diff(route.nominal_mm))


def _astray(
    path: Path, at: Path, look: Look, counted: Costs, planned_mm: Costs
) -> Iterator[Path]:
    """Yield the path to the next stop by the step of another axis, or by a step in the wrong
    direction. A program that leaves the plan once is outside the plan all along.
    """
    stop, steps_mm = path.stop + 1, np.unique(np.round(np.abs(planned_mm), 3))
    if look.reading_mm is None or path.left_mm is None or not 0 < stop < len(counted):
        return
    off = np.abs(look.reading_mm - path.left_mm) - steps_mm
    alike = float(np.logaddexp.reduce(log_normal(off, step_noise_mm(steps_mm))))
    cost = 0.0 if path.astray else RARE + math.log(2 * len(off))
    score = path.score - cost - float(counted[stop]) + alike
    yield replace(at, score=score, stop=stop, astray=True, miscounts=bool(counted[stop] > 0))


def _costs(path: Path, look: Look, route: Route) -> tuple[Costs, Costs, float]:
    """Return the cost of the move to every stop, and the cost of the counter there, each of shape
    (stops,), and the cost of the counter for a standstill at no stop.

    Missed stops are a single fault; their number is any, unless the counter shows it. A counter
    that is set back shows the number of the stop in the NC programs.
    """
    stops = len(route)
    unseen, wrong = np.arange(stops) - path.stop - 1, ORDINARY if path.miscounts else FAILURE
    shown, counted, counted_nowhere = np.zeros(stops, dtype=bool), np.zeros(stops), 0.0
    between_logs = (
        path.stop == -1 and not path.nowhere
    )  # the counter may increase by any number
    if look.count is not None and path.count is not None:
        steps = count_steps(path.count, look.count)
        if steps > COUNT_MODULUS // 2:
            shown = route.numbered(look.count)
        if between_logs:
            counted = np.where(shown, -FAILURE, 0.0)
        else:
            shown |= (steps == np.maximum(unseen + 1, 1)) | ((steps == 0) & (unseen == -1))
            counted, counted_nowhere = np.where(shown, 0.0, wrong), wrong * (steps != 0)
    missed = FAULT + np.where(shown, 0.0, np.log(np.maximum(unseen, 1)))
    move: Costs = np.where(unseen > 0, missed, np.where(unseen < 0, RARE, 0.0))
    if path.stop < -1:  # the counter alone shows that the machine has turned unseen
        move = np.where(shown, FAULT + ORDINARY, math.inf)
    elif path.stop < 0:
        move[1:] += np.where(shown[1:], 0.0, BEGIN - FAULT)
        move[[stop for stop in path.known if stop > 0]] = RARE
    else:
        move[path.stop] = FAILURE
        if path.stop > 0:
            move[0] = ORDINARY if look.lost else FAULT
        move[-1] = min(move[-1], FAULT)  # the program of the other direction begins there
    return move, counted, counted_nowhere


def _reading_likelihood(
    known: Known, last_stop: int, route: Route, reading_mm: float
) -> tuple[Costs, NDArray[np.bool_]]:
    """Return the logarithm of the likelihood of a reading at every stop, and whether the reading
    fits the known readings there, each of shape (stops,)."""
    if not known:
        return np.full(len(route), -math.log(RANGE_MM)), np.ones(len(route), dtype=bool)
    to, stops = np.arange(len(route)), np.array(sorted(known))
    nearest = stops[np.argmin(np.abs(to[:, None] - stops), axis=1)]
    anchor = np.where(np.isin(to, stops) | (last_stop not in known), nearest, last_stop)
    way_mm = route.nominal_mm - route.nominal_mm[anchor]
    off = reading_mm - np.array([known[int(stop)] for stop in anchor]) - way_mm
    noise = step_noise_mm(way_mm)
    slipped = log_normal(off, BESIDE_MM) - FAILURE
    read = np.logaddexp(log_likelihood(off, noise), slipped)
    return read, np.abs(off) < SIGMAS * noise


def _other_orders(begin: Path, routes: tuple[Route, ...]) -> Iterator[Path]:
    """Yield the path of a pass that begins in the same direction on a route with another order of
    the axes: a program driven anew begins with its own first order, whichever pass is missing.
    """
    expected, counts = routes[begin.way], begin.count is not None
    for way, route in enumerate(routes):
        if route.outward == expected.outward and route.order != expected.order:
            known = shared(begin.known, expected, route)
            # behind the expected order, which may go back to its first stop, too
            again = FAULT + FAILURE * counts if begin.stop >= 0 else 0.0
            score = begin.score - FAULT - again
            yield replace(
                begin, score=score, way=way, stop=-1, nowhere=False, astray=False, known=known
            )


class Walk:
    """Follows a pass stop by stop. ``expected`` is the index of the stop that comes next, ``last``
    the last captured stop, ``turn`` the last stop of the pass before, where the machine reversed.

    ``apart`` is the reason why the earlier stops have another count, without an event of the laser;
    ``unsure`` is the reason why the name of the stop is uncertain. The standstills decide between
    the orders of the axes, so `locate` may change ``route``.
    """

    def __init__(
        self,
        routes: tuple[Route, ...],
        begin: Path,
        turn: CapturedStop | None = None,
        apart: Message | None = None,
    ) -> None:
        self.route = routes[begin.way]
        self._routes = routes
        self.chain = Chain(routes, begin)
        self.turn = turn
        self.apart = apart
        self.unsure: Message | None = None
        self.expected = begin.stop + 1
        self.last: CapturedStop | None = None
        self._read = begin
        """The path to the last stop that has a reading, and the last count."""
        self._stuck_reported = False

    def at(self, what: Message) -> Message:
        return message("in-run", run=self.route.run, what=what)

    @property
    def started(self) -> bool:
        """Return whether a stop has a reading: before, the beam is blocked to align the mirror."""
        return self._read.left_mm is not None

    @property
    def ended(self) -> bool:
        return self.expected >= len(self.route)

    def is_bounce(self, signals: Signals) -> bool:
        """Return whether a dwell is the captured one: the same count at the same place."""
        place, stop = signals.commanded_mm, self._read.stop
        return self._steps(signals.stop_count) == 0 and (
            place is None or self.route.find(place, stop) == stop
        )

    def locate(self, look: Look) -> tuple[Path, list[Finding]]:
        """Return the path to a standstill, and the findings."""
        placed = look.position_mm is not None
        read_before = not look.lost and bool(self.chain.best.known)
        path = self.chain.take(look)
        self.unsure = message("place-unknown") if self.chain.margin < SURE else None
        steps, (by_count, odd) = self._steps(look.count), self._by_count(look.count)
        if path.name is None:
            return path, [*(odd if placed else []), self._nowhere(look.position_mm)]
        self._change_route(self._routes[path.way])
        if self.expected == 0 and not placed and read_before and len(path.known) == 1:
            self.apart = message("reads-no-stop")
        if steps != 0 or path.stop != self._read.stop:
            by_count = by_count if placed else min(by_count, len(self.route) - 1)
            miscounted = steps is not None and path.stop != by_count
            odd += self._elsewhere(
                path.stop, look.position_mm, by_count if miscounted else None
            )
        return path, odd

    def _change_route(self, route: Route) -> None:
        """Follow another route. The last reading is then that of the stop with the same number."""
        at, left_mm = self._read.stop, self._read.left_mm
        if route is not self.route and at > 0 and left_mm is not None:
            moved_mm = float(route.nominal_mm[at] - self.route.nominal_mm[at])
            self._read = replace(self._read, left_mm=left_mm + moved_mm)
        self.route = route

    def _nowhere(self, position_mm: Position) -> Finding:
        """Return the finding of a standstill where no stop is."""
        stop = min(self.expected, len(self.route) - 1)
        if position_mm is None:
            return self.finding("warning", stop, message("between-stops.no-reading"))
        words = message(
            "unexpected-position",
            at=_position_words(position_mm),
            name=self.route.run,
            wanted=_position_words(self.route.planned_mm(stop)),
        )
        return self.finding("error", self.expected, words)

    def _elsewhere(
        self, stop: int, position_mm: Position, counted: int | None
    ) -> Iterator[Finding]:
        """Yield the findings of a stop at which the counter names another, or measured again."""
        again, at = stop < self.expected, _position_words(position_mm or ())
        if counted is not None and not (again and at):
            words = (
                message("count-disagrees.with-position", counted=counted, at=at, named=stop)
                if at
                else message("count-disagrees.with-laser", counted=counted, named=stop)
            )
            yield self.finding("warning", stop, words)
        if again:
            words = (
                message("stop-again.by-position", at=at)
                if at
                else message("stop-again.by-laser")
            )
            yield self.finding("info", stop, words)

    def begin_anew(self, stop: int) -> Finding:
        """Go back to the state before a stop whose name has changed. Return the finding."""
        self.expected, self.last, self.unsure = stop, None, None
        self._read = replace(self._read, stop=stop - 1, left_mm=None)
        return self.begun_anew(stop)

    def begun_anew(self, stop: int) -> Finding:
        return self.finding("info", stop, message("stop-again.begun-anew"))

    def counts_on(self, signals: Signals) -> bool:
        """Return whether the counter agrees with the next stop; true without a counter."""
        return self._steps(signals.stop_count) in (None, 1)

    def _steps(self, count: int | None) -> int | None:
        """Return the increase of the counter since the last stop; None without evidence."""
        if count is None or self._read.count is None or self.expected == 0:
            return None
        return count_steps(self._read.count, count)

    def judge(self, index: int, reading_mm: float) -> Message | None:
        """Return the fault of the step from the previous stop; None without a fault."""
        stop, before_mm = self._read.stop, self._read.left_mm
        if before_mm is None or index == stop:
            return None
        return judge_step(self.route, stop, index, reading_mm - before_mm, reading_mm)

    def expected_reading_mm(self, index: int) -> float | None:
        """Return the reading by the geometry from the previous stop; None before the first."""
        before_mm = self._read.left_mm
        return (
            None
            if before_mm is None
            else before_mm + self.route.step_mm(self._read.stop, index)
        )

    def advance(self, stop: CapturedStop) -> None:
        self.skip(stop.stop, stop.stop_count)
        self.last = stop
        self._read = replace(self._read, stop=stop.stop, left_mm=stop.reading_mm)

    def skip(self, index: int, count: int | None) -> None:
        """Go on past a stop without a reading."""
        self.expected = index + 1
        self._read = replace(self._read, count=count)

    def finding(
        self, severity: Severity, stop: int, words: Message, code: str = ""
    ) -> Finding:
        """Return the finding of a message at a stop of the pass; a phrase needs its ``code``."""
        place = Place(
            setup=self.route.setup, way=self.route.way, stop=stop, last=len(self.route) - 1
        )
        return finding(severity, words, place, code=code)

    def _by_count(self, count: int | None) -> tuple[int, list[Finding]]:
        """Return the stop by the counter, and the finding if that is not the next stop."""
        before, index = self._read.count, self.expected
        steps = self._steps(count)
        if count is None or before is None or steps in (None, 1):
            return index, []
        if not steps:
            if self._stuck_reported:
                return index, []
            self._stuck_reported = True
            words = message("count-stuck", count=count)
        elif steps <= len(self.route):
            index += steps - 1
            words = message("stop-missed", before=before, now=count, missed=steps - 1)
        else:  # the counter was reset
            most = COUNT_MODULUS - 1
            words = message("count-disagrees.anew", before=before, now=count, most=most)
        return index, [self.finding("warning", self.expected, words)]


def _position_words(position_mm: Iterable[float]) -> str:
    return ", ".join(f"{value:.4f}" for value in position_mm)
