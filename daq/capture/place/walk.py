"""Which stop of its pass a dwell is, and whether the laser agrees."""

from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

from stepdiag.base.findings import Finding, Severity, finding
from stepdiag.base.messages import Message, Place, Way, message, run
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.place.laser_place import LaserPlaces
from stepdiag.daq.capture.place.route import Route, agrees, judge_step
from stepdiag.daq.capture.standing.dwell import COUNT_MODULUS, count_steps
from stepdiag.daq.formats.signals import Signals

BREAKS_COUNT = {"laser-reset", "step-mismatch"}
"""A step of the wrong size that nothing explains is a lost count: what follows is right again, relative to itself."""
BACKWARDS = -0.5
"""Shares of a step: who goes back by more, to where no stop is, begins anew."""
ANEW = message("begun-anew")
COUNTER_TRUSTED = 1000
"""A stop counter that seems to have gone on by more than this was set back: the PLC has started again."""


class Walk:
    """Follows a pass stop by stop. ``expected`` is the index of the stop that comes next."""

    def __init__(
        self,
        route: Route,
        expected: int,
        last_count: int | None,
        last_reading_mm: float | None,
        known: Mapping[int, float] | None = None,
    ) -> None:
        self.route = route
        self.laser = LaserPlaces(route, known or {})
        self._stuck_reported = False
        self.unsure: Message | None = None
        """Why the stops are only believed to be those that come next; None where position or laser say it."""
        self.nowhere = self.retreated = False
        """The last standstill reads as no stop does; and by the laser's count it was come to as a program comes to its first stop."""
        self.apart: Message | None = None
        """Why the count of the stops before is not that of the stop that was placed last, though nothing happened to the laser."""
        self.expected = expected
        self.last: CapturedStop | None = None
        self._last_stop = expected - 1
        self._last_count = last_count
        self._last_reading_mm = last_reading_mm

    @property
    def name(self) -> str:
        """Return the pass in words."""
        return f"{self.route.setup} {'out' if self.route.outward else 'back'}"

    @property
    def way(self) -> Way:
        """Return the direction of the pass."""
        return "out" if self.route.outward else "back"

    def at(self, what: Message) -> Message:
        """Return a message with the pass before it."""
        return message("in-run", run=run(self.route.setup, self.way), what=what)

    @property
    def started(self) -> bool:
        """Tell whether a stop of the pass has a reading: before that the beam is blocked and the mirror aligned as a matter of course."""
        return self._last_reading_mm is not None

    @property
    def ended(self) -> bool:
        """Tell whether the last stop of the route has gone by."""
        return self.expected >= len(self.route)

    def is_bounce(self, signals: Signals) -> bool:
        """Tell whether a dwell is the one already captured: the same count at the same place."""
        if signals.stop_count is None or signals.stop_count != self._last_count or self.expected == 0:
            return False
        return signals.commanded_mm is None or self.route.find(signals.commanded_mm, self._last_stop) == self._last_stop

    def locate(self, signals: Signals) -> tuple[int | None, list[Finding]]:
        """Return the stop that the machine's signals name, None for a place that is not on the route, and what is odd about it."""
        by_count, odd = self._by_count(signals.stop_count)
        if signals.commanded_mm is None:
            return min(by_count, len(self.route) - 1), odd
        index = self.route.find(signals.commanded_mm, self.expected)
        place = ", ".join(f"{value:.4f}" for value in signals.commanded_mm)
        if index is None:
            wanted = ", ".join(f"{value:.4f}" for value in self.route.stops_mm[min(self.expected, len(self.route) - 1)])
            words = message("unexpected-position", at=place, name=run(self.route.setup, self.way), wanted=wanted)
            return None, [*odd, self.finding("error", self.expected, words)]
        if index < self.expected:
            odd.append(self.finding("info", index, message("stop-again.by-position", at=place)))
        elif by_count != index and not self._just_turned(index, signals.stop_count):
            words = message("count-disagrees.with-position", counted=by_count, at=place, named=index)
            odd.append(self.finding("warning", index, words))
        return index, odd

    def _just_turned(self, index: int, count: int | None) -> bool:
        """Tell whether a counter has nothing against a stop: it does not count, or a pass begins, with a stop at the turn or without."""
        if count is None or self._last_count is None:
            return True
        return self.expected == 0 and index in ((steps := count_steps(self._last_count, count)) - 1, steps)

    def locate_by_laser(self, signals: Signals, reading_mm: float | None, *, lost: bool) -> tuple[int | None, list[Finding]]:
        """Return the stop at which the machine stands, None for no stop, and what is odd: its counter says it, the laser knows better.

        ``reading_mm`` is what the laser reads, None for nothing; ``lost`` tells that its count does not reach back.
        """
        by_count, odd = self._by_count(signals.stop_count)
        by_count = min(by_count, len(self.route) - 1)
        counted = self._steps(signals.stop_count)
        was_nowhere, self.nowhere = self.nowhere, False
        if lost:
            self.laser.lost()
            self.retreated = False
        if reading_mm is None or not self.laser.known:
            return (None, []) if counted == 0 else self._unplaced(by_count, odd, lost=lost)
        by_laser = self.laser.stop_at(reading_mm)
        if by_laser is None or (self.expected == 1 and self._retreats(by_laser, reading_mm)):
            self.nowhere = self.expected > 0
            self.retreated = self.retreated if was_nowhere else self._retreats(by_count, reading_mm)
            return self._nowhere(by_count, odd, counted, reading_mm)
        if counted == 0 and by_laser == self._last_stop:
            return None, []
        return by_laser, self._compared(by_laser, by_count, counted, odd)

    def _unplaced(self, by_count: int, odd: list[Finding], *, lost: bool) -> tuple[int, list[Finding]]:
        """Return the stop where the laser cannot tell: the program goes on, but one that was left in the middle may have begun anew.

        Within a log nobody tells the two apart but by the steps that follow: such stops are doubted.
        """
        if self.last is None and self.expected > 0 and lost:
            return 0, [*odd, self.finding("warning", 0, message("place-unknown.at-first"))]
        if lost and self.expected > 0:
            self.unsure = message("place-unknown")
        return by_count, odd

    def _retreats(self, stop: int, reading_mm: float) -> bool:
        """Tell whether a standstill is come to as the first stop of a pass is: backwards, or from where the machine stood before."""
        if self._last_reading_mm is None:
            return False
        if self.expected == 1:
            return _breaks_count(self.judge(stop, reading_mm))
        forward = (
            (reading_mm - self._last_reading_mm) / self.route.step_mm(self._last_stop - 1, self._last_stop) if self._last_stop > 0 else 0.0
        )
        return forward < BACKWARDS

    def goes_on(self, since: Sequence[float]) -> bool:
        """Tell whether the last step of some readings is that to the stop that comes next."""
        stop = self.expected + (len(since) - 1 if self.nowhere else 0)
        return 0 < stop < len(self.route) and agrees(since[-1] - since[-2], self.route.step_mm(stop - 1, stop))

    def begin_anew(self) -> Finding:
        """Go back to before the first stop; return its finding."""
        self.expected, self.last, self._last_stop, self._last_reading_mm, self.unsure = 0, None, -1, None, None
        self.nowhere = self.retreated = False
        self.laser.lost()
        return self.begun_anew()

    @classmethod
    def begun_before(cls, route: Route, believed: Sequence[float], last_count: int | None) -> Self:
        """Return the walk of a pass whose first stops are in the log before, where they were taken for the last ones of its pass."""
        walk = cls(route, len(believed), last_count, None, dict(enumerate(believed)))
        walk.apart = ANEW
        return walk

    def begun_anew(self) -> Finding:
        """Return the finding of a pass that was begun anew."""
        return self.finding("info", 0, message("stop-again.begun-anew"))

    def _nowhere(self, by_count: int, odd: list[Finding], counted: int | None, reading_mm: float) -> tuple[int | None, list[Finding]]:
        """Return the stop where the laser reads what no stop reads: its count went wrong, or the machine stands between two stops."""
        if self.expected == 0:
            self.laser.lost()
            self.apart = message("reads-no-stop")
            return by_count, odd
        wrong = self.judge(by_count, reading_mm)
        if counted != 0 and (counted is not None or (wrong is not None and not _breaks_count(wrong))):
            return self._unplaced(by_count, odd, lost=True)
        following = self.laser.after_nowhere(reading_mm, self.expected) if counted is None else None
        if following is not None:
            return following, odd
        return None, [self.finding("warning", min(self.expected, len(self.route) - 1), message("between-stops.no-reading"))]

    def _compared(self, by_laser: int, by_count: int, counted: int | None, odd: list[Finding]) -> list[Finding]:
        """Return what is odd about a stop that the laser names."""
        if counted is not None and by_laser != by_count and self.expected > 0:
            words = message("count-disagrees.with-laser", counted=by_count, named=by_laser)
            odd = [*odd, self.finding("warning", by_laser, words)]
        if by_laser < self.expected:
            odd = [*odd, self.finding("info", by_laser, message("stop-again.by-laser"))]
        return odd

    def counts_on(self, signals: Signals) -> bool:
        """Tell whether the counter says the next stop, as far as it can say anything."""
        return self._steps(signals.stop_count) in (None, 1)

    def _steps(self, count: int | None) -> int | None:
        """Return by how many stops the counter went on since the last stop; None where it cannot tell."""
        if count is None or self._last_count is None or self.expected == 0:
            return None
        return count_steps(self._last_count, count)

    def judge(self, index: int, reading_mm: float) -> Message | None:
        """Return what is wrong with a reading at a stop, judged by the step from the stop before; None where all is well."""
        if self._last_reading_mm is None or index == self._last_stop:
            return None
        return judge_step(self.route, self._last_stop, index, reading_mm - self._last_reading_mm, reading_mm)

    def expected_reading_mm(self, index: int) -> float | None:
        """Return the reading that the geometry wants at a stop, from the stop before; None before the first."""
        if self._last_reading_mm is None or self._last_stop < 0:
            return None
        return self._last_reading_mm + self.route.step_mm(self._last_stop, index)

    def advance(self, stop: CapturedStop) -> None:
        """Go on past a stop."""
        self.skip(stop.stop, stop.stop_count)
        self.last = stop
        if not stop.refused:
            self.laser.take(stop.stop, stop.reading_mm, anew=bool(stop.broken))
        self._last_stop = stop.stop
        self._last_reading_mm = stop.reading_mm

    def skip(self, index: int, count: int | None) -> None:
        """Go on past a stop without a reading."""
        self.expected = index + 1
        self._last_count = count

    def finding(self, severity: Severity, stop: int, words: Message, code: str = "") -> Finding:
        """Return the finding of a message at a stop of the pass; a phrase needs its ``code``."""
        return finding(severity, words, Place(setup=self.route.setup, way=self.way, stop=stop, last=len(self.route) - 1), code=code)

    def _stuck(self, count: int) -> list[Finding]:
        """Return, once a pass, that the machine comes to a stop and does not count it."""
        reported, self._stuck_reported = self._stuck_reported, True
        return [] if reported else [self.finding("warning", self.expected, message("count-stuck", count=count))]

    def _by_count(self, count: int | None) -> tuple[int, list[Finding]]:
        if count is None or self._last_count is None or self.expected == 0:
            return self.expected, []
        steps = count_steps(self._last_count, count)
        if steps == 1:
            return self.expected, []
        if steps == 0:
            return self.expected, self._stuck(count)
        if 1 < steps <= COUNTER_TRUSTED:
            index = self.expected + steps - 1
            missed = message("stop-missed", before=self._last_count, now=count, missed=steps - 1)
            return index, [self.finding("warning", self.expected, missed)]
        back = message("count-disagrees.anew", before=self._last_count, now=count, most=COUNT_MODULUS - 1)
        return self.expected, [self.finding("warning", self.expected, back)]


def _breaks_count(wrong: Message | None) -> bool:
    return wrong is not None and wrong.code in BREAKS_COUNT


def begun_anew(route: Route, readings: Sequence[float]) -> bool:
    """Tell whether two readings or more make the steps of a route from its first stop on."""
    if not 1 < len(readings) <= len(route):
        return False
    return all(agrees(step, route.step_mm(stop, stop + 1)) for stop, step in enumerate(np.diff(readings)))
