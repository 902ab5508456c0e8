"""The most probable path of a pass over its standstills, and its comparison with the laser."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, Severity, finding
from stepdiag.base.messages import Message, Place, Way, message, run
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.naming.route import (
    Route,
    judge_step,
    log_likelihood,
    log_normal,
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
Names = tuple[int | None, ...]
Position = tuple[float, float, float] | None
Known = Mapping[int, float]


@dataclass(frozen=True, slots=True)
class Look:
    """The observations of a standstill: position in mm, counter, the laser's reading in mm; None
    for an observation that the machine does not show.

    ``lost``: the laser's count does not reach back to the standstill before. ``after_mm``: the
    reading at the end of the standstill if its count was lost within it, else None.
    """

    position_mm: Position = None
    count: int | None = None
    reading_mm: float | None = None
    lost: bool = False
    after_mm: float | None = None

    @property
    def left_mm(self) -> float | None:
        """Return the reading at the end of the standstill."""
        return self.reading_mm if self.after_mm is None else self.after_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """A path up to a standstill: the logarithm of its probability (``score``), the index of its
    pass in the chain's list of routes (``way``), and the index of its last stop (-1 before the
    first).

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
    names: Names = ()

    @property
    def name(self) -> int | None:
        """Return the stop at which the machine stands; None where it stands at no stop."""
        return None if self.nowhere else self.stop


OUT, BACK = range(2)
"""The ways of a setup in the chain's routes."""


def beginnings(on: Path, known: Known, stops: int, cost: float) -> tuple[Path, ...]:
    """Return the path of a pass that goes on; the path of a pass that begins in the other
    direction at a ``cost``, and whose counter fits by chance; and the paths over the end of the
    pass, whose stops before the turn, once or twice counted, have negative numbers.

    ``known`` are the readings of the present count, by stop of the outward route.
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
        self._steps_mm = [
            np.unique(np.round(np.abs(np.diff(route.nominal_mm)), 3)) for route in routes
        ]
        self._paths = list(begins)
        self.margin = math.inf

    @property
    def best(self) -> Path:
        """Return the most probable path."""
        return self._paths[0]

    def take(self, look: Look) -> Path:
        """Add a standstill; return the most probable path to it."""
        best: dict[tuple[int, int, bool, bool], Path] = {}
        for path in self._paths:
            for on in self._following(path, look):
                key = on.way, on.stop, on.nowhere, on.astray
                if key not in best or best[key].score < on.score:
                    best[key] = on
        paths = sorted(best.values(), key=lambda path: -path.score)[:KEPT]
        first = paths[0]
        self._paths = [path for path in paths if first.score - path.score < WITHIN]
        others = (
            path.score for path in paths if (path.way, path.name) != (first.way, first.name)
        )
        self.margin = first.score - max(others, default=-math.inf)
        return first

    def _following(self, path: Path, look: Look) -> Iterator[Path]:
        """Yield the extensions of a path: to the probable stops, to the next stop by a step outside
        the plan, and to no stop.
        """
        route = self._routes[path.way]
        if look.lost:
            path = replace(path, known={}, left_mm=None, names=())
        shown, counted, counted_nowhere = _counted(path, look, len(route))
        score = path.score - _moves(path, shown, lost=look.lost) - counted
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
        for stop in np.flatnonzero(score > max(score.max() - WITHIN, -1e9)).tolist():
            known = path.known if fits[stop] else {}
            if look.after_mm is not None:
                known = {stop: look.after_mm}
            elif look.reading_mm is not None:
                known = {**known, stop: look.reading_mm}
            yield _extended(path, look, stop, float(score[stop]), bool(counted[stop]), known)
        yield replace(
            path, score=nowhere, nowhere=True, count=look.count, names=(*path.names, None)
        )
        if self._signalled and look.position_mm is None:
            yield from self._astray(path, look, counted)

    def _astray(self, path: Path, look: Look, counted: Costs) -> Iterator[Path]:
        """Yield the path to the next stop by the step of another axis, or by a step in the wrong
        direction. A program that leaves the plan once is outside the plan all along.
        """
        stop, steps_mm = path.stop + 1, self._steps_mm[path.way]
        if look.reading_mm is None or path.left_mm is None or not 0 < stop < len(counted):
            return
        off = np.abs(look.reading_mm - path.left_mm) - steps_mm
        alike = float(np.logaddexp.reduce(log_normal(off, step_noise_mm(steps_mm))))
        cost = 0.0 if path.astray else RARE + math.log(2 * len(off))
        score = path.score - cost - float(counted[stop]) + alike
        miscounts = bool(counted[stop])
        yield _extended(path, look, stop, score, miscounts, path.known, astray=True)


def _extended(
    path: Path,
    look: Look,
    stop: int,
    score: float,
    miscounts: bool,
    known: Known,
    *,
    astray: bool = False,
) -> Path:
    """Return the extension of a path to a stop."""
    return Path(
        score=score,
        way=path.way,
        stop=stop,
        astray=astray,
        known=known,
        left_mm=look.left_mm,
        count=look.count,
        miscounts=miscounts,
        names=(*path.names, stop),
    )


def _moves(path: Path, shown: NDArray[np.bool_], *, lost: bool) -> Costs:
    """Return the cost of every move from the last stop of a path, shape (stops,). Missed stops
    are a single fault; their number is any, unless the counter has ``shown`` it.
    """
    if path.stop < -1:  # the counter alone shows that the machine has turned unseen
        return np.where(shown, FAULT + ORDINARY, math.inf)
    unseen = np.arange(len(shown)) - path.stop - 1
    missed = FAULT + np.where(shown, 0.0, np.log(np.maximum(unseen, 1)))
    cost: Costs = np.where(unseen > 0, missed, np.where(unseen < 0, RARE, 0.0))
    if path.stop < 0:
        cost[1:] += BEGIN - FAULT
        cost[[stop for stop in path.known if stop > 0]] = RARE
        return cost
    cost[path.stop] = FAILURE
    if path.stop > 0:
        cost[0] = ORDINARY if lost else FAULT
    cost[-1] = min(cost[-1], FAULT)  # the program of the other direction begins there
    return cost


def _counted(path: Path, look: Look, stops: int) -> tuple[NDArray[np.bool_], Costs, float]:
    """Return the stops that the counter shows and the cost of the counter at every stop, each of
    shape (stops,), and the cost of the counter for a standstill at no stop.
    """
    if look.count is None or path.count is None or (path.stop == -1 and not path.nowhere):
        # between two logs the counter may increase by any number
        return np.zeros(stops, dtype=bool), np.zeros(stops), 0.0
    steps, to = count_steps(path.count, look.count), np.arange(stops)
    right = (steps == np.where(to > path.stop, to - path.stop, 1)) | (
        (to == path.stop) & (steps == 0)
    )
    wrong = ORDINARY if path.miscounts else FAILURE
    return right, np.where(right, 0.0, wrong), 0.0 if steps == 0 else wrong


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


class Walk:
    """Follows a pass stop by stop. ``expected`` is the index of the stop that comes next."""

    def __init__(
        self,
        route: Route,
        expected: int,
        last_count: int | None,
        last_reading_mm: float | None,
        known: Known | None = None,
    ) -> None:
        self.route = route
        begin = Path(
            stop=expected - 1,
            known=dict(known or {}),
            count=last_count,
            left_mm=last_reading_mm,
        )
        self.chain = Chain((route,), begin)
        self.apart: Message | None = None
        """Reason why the count of the earlier stops differs from the count at the first stop,
        without an event of the laser.
        """
        self._stuck_reported = False
        self.unsure: Message | None = None
        """Reason why the name of the stop is uncertain; None if the next best path is much less
        probable.
        """
        self.expected = expected
        self.last: CapturedStop | None = None
        self._last_stop = expected - 1
        self._last_count = last_count
        self._last_reading_mm = last_reading_mm

    @property
    def name(self) -> str:
        """Return the name of the pass: its setup and its direction."""
        return f"{self.route.setup} {'out' if self.route.outward else 'back'}"

    @property
    def way(self) -> Way:
        """Return the direction of the pass."""
        return "out" if self.route.outward else "back"

    def at(self, what: Message) -> Message:
        """Return a message that begins with the name of the pass."""
        return message("in-run", run=run(self.route.setup, self.way), what=what)

    @property
    def started(self) -> bool:
        """Return whether a stop of the pass has a reading: before the first reading the beam is
        blocked and the mirror is aligned as a matter of course.
        """
        return self._last_reading_mm is not None

    @property
    def ended(self) -> bool:
        """Return whether the last stop of the route is past."""
        return self.expected >= len(self.route)

    def is_bounce(self, signals: Signals) -> bool:
        """Return whether a dwell is the captured one: the same count at the same place."""
        if (
            signals.stop_count is None
            or signals.stop_count != self._last_count
            or self.expected == 0
        ):
            return False
        return (
            signals.commanded_mm is None
            or self.route.find(signals.commanded_mm, self._last_stop) == self._last_stop
        )

    def locate(
        self,
        signals: Signals,
        reading_mm: float | None,
        after_mm: float | None = None,
        *,
        lost: bool,
    ) -> tuple[int | None, Names, list[Finding]]:
        """Return the stop of a standstill (None for no stop), the names of all standstills of this
        count, and the findings.

        ``reading_mm`` is the laser's reading, None without a reading; ``after_mm`` is the reading
        at the end of the standstill if the count was lost within it;
        ``lost``: the count does not reach back.
        """
        by_count, odd = self._by_count(signals.stop_count)
        placed = signals.commanded_mm is not None
        by_count = by_count if placed else min(by_count, len(self.route) - 1)
        counted = self._steps(signals.stop_count)
        before = {} if lost else self.chain.best.known
        path = self.chain.take(
            Look(signals.commanded_mm, signals.stop_count, reading_mm, lost, after_mm)
        )
        self.unsure = message("place-unknown") if self.chain.margin < SURE else None
        if path.name is None:
            return (
                None,
                path.names,
                [*(odd if placed else []), self._nowhere(signals.commanded_mm)],
            )
        if self.expected == 0 and not placed and before and len(path.known) == 1:
            self.apart = message("reads-no-stop")
        if counted == 0 and path.stop == self._last_stop:
            return path.stop, path.names, odd
        again = path.stop < self.expected
        if path.stop != by_count and counted is not None and not (again and placed):
            odd.append(self._miscounted(path.stop, by_count, signals.commanded_mm))
        if again:
            odd.append(self._again(path.stop, signals.commanded_mm))
        return path.stop, path.names, odd

    def _nowhere(self, position_mm: Position) -> Finding:
        """Return the finding of a standstill where no stop is."""
        stop = min(self.expected, len(self.route) - 1)
        if position_mm is None:
            return self.finding("warning", stop, message("between-stops.no-reading"))
        wanted = _position_words(self.route.planned_mm(stop))
        words = message(
            "unexpected-position",
            at=_position_words(position_mm),
            name=run(self.route.setup, self.way),
            wanted=wanted,
        )
        return self.finding("error", self.expected, words)

    def _again(self, stop: int, position_mm: Position) -> Finding:
        """Return the finding of a stop that is measured again."""
        if position_mm is None:
            return self.finding("info", stop, message("stop-again.by-laser"))
        words = message("stop-again.by-position", at=_position_words(position_mm))
        return self.finding("info", stop, words)

    def _miscounted(self, stop: int, by_count: int, position_mm: Position) -> Finding:
        """Return the finding of a counter that names another stop."""
        if position_mm is None:
            return self.finding(
                "warning",
                stop,
                message("count-disagrees.with-laser", counted=by_count, named=stop),
            )
        words = message(
            "count-disagrees.with-position",
            counted=by_count,
            at=_position_words(position_mm),
            named=stop,
        )
        return self.finding("warning", stop, words)

    def begin_anew(self, stop: int) -> Finding:
        """Go back to the state before a stop: its name and the names after it have changed. Return
        the finding.
        """
        self.expected, self._last_stop = stop, stop - 1
        self.last = self._last_reading_mm = self.unsure = None
        return self.begun_anew(stop)

    def begun_anew(self, stop: int) -> Finding:
        """Return the finding of a pass that was restarted at a stop."""
        return self.finding("info", stop, message("stop-again.begun-anew"))

    def counts_on(self, signals: Signals) -> bool:
        """Return whether the counter agrees with the next stop; true without a counter."""
        return self._steps(signals.stop_count) in (None, 1)

    def _steps(self, count: int | None) -> int | None:
        """Return the increase of the counter since the last stop; None without evidence."""
        if count is None or self._last_count is None or self.expected == 0:
            return None
        return count_steps(self._last_count, count)

    def judge(self, index: int, reading_mm: float) -> Message | None:
        """Return the fault of a reading at a stop, judged by the step from the previous stop; None
        without a fault.
        """
        if self._last_reading_mm is None or index == self._last_stop:
            return None
        return judge_step(
            self.route, self._last_stop, index, reading_mm - self._last_reading_mm, reading_mm
        )

    def expected_reading_mm(self, index: int) -> float | None:
        """Return the reading that the geometry predicts at a stop from the previous stop; None
        before the first stop.
        """
        if self._last_reading_mm is None or self._last_stop < 0:
            return None
        return self._last_reading_mm + self.route.step_mm(self._last_stop, index)

    def advance(self, stop: CapturedStop) -> None:
        """Go on past a stop."""
        self.skip(stop.stop, stop.stop_count)
        self.last = stop
        self._last_stop = stop.stop
        self._last_reading_mm = stop.reading_mm

    def skip(self, index: int, count: int | None) -> None:
        """Go on past a stop without a reading."""
        self.expected = index + 1
        self._last_count = count

    def finding(
        self, severity: Severity, stop: int, words: Message, code: str = ""
    ) -> Finding:
        """Return the finding of a message at a stop of the pass; a phrase needs its ``code``."""
        return finding(
            severity,
            words,
            Place(setup=self.route.setup, way=self.way, stop=stop, last=len(self.route) - 1),
            code=code,
        )

    def _stuck(self, count: int) -> list[Finding]:
        """Return the finding of a stop without a new count, once a pass."""
        reported, self._stuck_reported = self._stuck_reported, True
        return (
            []
            if reported
            else [self.finding("warning", self.expected, message("count-stuck", count=count))]
        )

    def _by_count(self, count: int | None) -> tuple[int, list[Finding]]:
        steps = self._steps(count)
        if count is None or self._last_count is None or steps in (None, 1):
            return self.expected, []
        if not steps:
            return self.expected, self._stuck(count)
        if 1 < steps <= len(self.route):  # a counter that increased by more was reset
            index = self.expected + steps - 1
            missed = message(
                "stop-missed", before=self._last_count, now=count, missed=steps - 1
            )
            return index, [self.finding("warning", self.expected, missed)]
        back = message(
            "count-disagrees.anew", before=self._last_count, now=count, most=COUNT_MODULUS - 1
        )
        return self.expected, [self.finding("warning", self.expected, back)]


def _position_words(position_mm: tuple[float, float, float]) -> str:
    return ", ".join(f"{value:.4f}" for value in position_mm)
