"""The driven pass of the plan, the stop of each dwell, and whether the laser agrees."""

from collections.abc import Mapping, Sequence
from typing import Self

import msgspec
import numpy as np

from stepdiag.base.findings import Finding, Severity, finding
from stepdiag.base.messages import Message, Place, Way, message, run
from stepdiag.base.names import SETUP_NUMBERS
from stepdiag.base.setups import CODED_FROM, setup_of, setups_meant
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.capture.place.route import LaserPlaces, Route, agrees, judge_step, route_of
from stepdiag.daq.capture.standing.dwell import COUNT_MODULUS, count_steps
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import Survey

BREAKS_COUNT = {"laser-reset", "step-mismatch"}
"""A step of the wrong size that nothing explains is a lost count: what follows is right again,
relative to itself."""
BACKWARDS = -0.5
"""Shares of a step: who goes back by more, to where no stop is, begins anew."""
ANEW = message("begun-anew")
COUNTER_TRUSTED = 1000
"""A stop counter that seems to have gone on by more than this was set back: the PLC has started
again."""


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
        """Reason why the stops are only assumed to be the next stops; None if position or laser
        confirm them.
        """
        self.nowhere = self.retreated = False
        """The last standstill reads as no stop does; and by the laser's count it was come to as a
        program comes to its first stop."""
        self.apart: Message | None = None
        """Reason why the count of the stops before differs from that of the stop placed last,
        without an event of the laser.
        """
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
        """Return whether a stop of the pass has a reading: before that the beam is blocked and the
        mirror aligned as a matter of course."""
        return self._last_reading_mm is not None

    @property
    def ended(self) -> bool:
        """Return whether the last stop of the route has gone by."""
        return self.expected >= len(self.route)

    def is_bounce(self, signals: Signals) -> bool:
        """Return whether a dwell is the one already captured: the same count at the same place."""
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

    def locate(self, signals: Signals) -> tuple[int | None, list[Finding]]:
        """Return the stop named by the machine's signals, None for a place off the route, and the
        oddities of the place.
        """
        by_count, odd = self._by_count(signals.stop_count)
        if signals.commanded_mm is None:
            return min(by_count, len(self.route) - 1), odd
        index = self.route.find(signals.commanded_mm, self.expected)
        place = ", ".join(f"{value:.4f}" for value in signals.commanded_mm)
        if index is None:
            wanted = ", ".join(
                f"{value:.4f}"
                for value in self.route.stops_mm[min(self.expected, len(self.route) - 1)]
            )
            words = message(
                "unexpected-position", at=place, name=run(self.route.setup, self.way), wanted=wanted
            )
            return None, [*odd, self.finding("error", self.expected, words)]
        if index < self.expected:
            odd.append(self.finding("info", index, message("stop-again.by-position", at=place)))
        elif by_count != index and not self._just_turned(index, signals.stop_count):
            words = message(
                "count-disagrees.with-position", counted=by_count, at=place, named=index
            )
            odd.append(self.finding("warning", index, words))
        return index, odd

    def _just_turned(self, index: int, count: int | None) -> bool:
        """Return whether a counter has nothing against a stop: it does not count, or a pass begins,
        with a stop at the turn or without."""
        if count is None or self._last_count is None:
            return True
        return self.expected == 0 and index in (
            (steps := count_steps(self._last_count, count)) - 1,
            steps,
        )

    def locate_by_laser(
        self, signals: Signals, reading_mm: float | None, *, lost: bool
    ) -> tuple[int | None, list[Finding]]:
        """Return the stop of the standing machine, None for no stop, and its oddities: by the
        machine's counter, corrected by the laser.

        ``reading_mm`` is what the laser reads, None for nothing; ``lost``: the laser's count does
        not reach back.
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

    def _unplaced(
        self, by_count: int, odd: list[Finding], *, lost: bool
    ) -> tuple[int, list[Finding]]:
        """Return the stop if the laser does not decide: the program goes on, but an interrupted
        program may have begun anew.

        Within a log only the following steps separate the two cases: such stops are doubted.
        """
        if self.last is None and self.expected > 0 and lost:
            return 0, [*odd, self.finding("warning", 0, message("place-unknown.at-first"))]
        if lost and self.expected > 0:
            self.unsure = message("place-unknown")
        return by_count, odd

    def _retreats(self, stop: int, reading_mm: float) -> bool:
        """Return whether a standstill is come to as the first stop of a pass is: backwards, or from
        where the machine stood before."""
        if self._last_reading_mm is None:
            return False
        if self.expected == 1:
            return _breaks_count(self.judge(stop, reading_mm))
        forward = (
            (reading_mm - self._last_reading_mm)
            / self.route.step_mm(self._last_stop - 1, self._last_stop)
            if self._last_stop > 0
            else 0.0
        )
        return forward < BACKWARDS

    def goes_on(self, since: Sequence[float]) -> bool:
        """Return whether the last step of some readings is the step to the next stop."""
        stop = self.expected + (len(since) - 1 if self.nowhere else 0)
        return 0 < stop < len(self.route) and agrees(
            since[-1] - since[-2], self.route.step_mm(stop - 1, stop)
        )

    def begin_anew(self) -> Finding:
        """Go back to before the first stop; return its finding."""
        self.expected, self.last, self._last_stop, self._last_reading_mm, self.unsure = (
            0,
            None,
            -1,
            None,
            None,
        )
        self.nowhere = self.retreated = False
        self.laser.lost()
        return self.begun_anew()

    @classmethod
    def begun_before(cls, route: Route, believed: Sequence[float], last_count: int | None) -> Self:
        """Return the walk of a pass whose first stops are in the log before, where they were taken
        for the last ones of its pass."""
        walk = cls(route, len(believed), last_count, None, dict(enumerate(believed)))
        walk.apart = ANEW
        return walk

    def begun_anew(self) -> Finding:
        """Return the finding of a pass that was begun anew."""
        return self.finding("info", 0, message("stop-again.begun-anew"))

    def _nowhere(
        self, by_count: int, odd: list[Finding], counted: int | None, reading_mm: float
    ) -> tuple[int | None, list[Finding]]:
        """Return the stop where the laser reads what no stop reads: its count went wrong, or the
        machine stands between two stops."""
        if self.expected == 0:
            self.laser.lost()
            self.apart = message("reads-no-stop")
            return by_count, odd
        wrong = self.judge(by_count, reading_mm)
        if counted != 0 and (
            counted is not None or (wrong is not None and not _breaks_count(wrong))
        ):
            return self._unplaced(by_count, odd, lost=True)
        following = self.laser.after_nowhere(reading_mm, self.expected) if counted is None else None
        if following is not None:
            return following, odd
        return None, [
            self.finding(
                "warning",
                min(self.expected, len(self.route) - 1),
                message("between-stops.no-reading"),
            )
        ]

    def _compared(
        self, by_laser: int, by_count: int, counted: int | None, odd: list[Finding]
    ) -> list[Finding]:
        """Return what is odd about a stop that the laser names."""
        if counted is not None and by_laser != by_count and self.expected > 0:
            words = message("count-disagrees.with-laser", counted=by_count, named=by_laser)
            odd = [*odd, self.finding("warning", by_laser, words)]
        if by_laser < self.expected:
            odd = [*odd, self.finding("info", by_laser, message("stop-again.by-laser"))]
        return odd

    def counts_on(self, signals: Signals) -> bool:
        """Return whether the counter agrees with the next stop, if it can."""
        return self._steps(signals.stop_count) in (None, 1)

    def _steps(self, count: int | None) -> int | None:
        """Return by how many stops the counter went on since the last stop; None without
        evidence.
        """
        if count is None or self._last_count is None or self.expected == 0:
            return None
        return count_steps(self._last_count, count)

    def judge(self, index: int, reading_mm: float) -> Message | None:
        """Return what is wrong with a reading at a stop, judged by the step from the stop before;
        None where all is well."""
        if self._last_reading_mm is None or index == self._last_stop:
            return None
        return judge_step(
            self.route, self._last_stop, index, reading_mm - self._last_reading_mm, reading_mm
        )

    def expected_reading_mm(self, index: int) -> float | None:
        """Return the reading expected by the geometry at a stop, from the stop before; None before
        the first.
        """
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
        return finding(
            severity,
            words,
            Place(setup=self.route.setup, way=self.way, stop=stop, last=len(self.route) - 1),
            code=code,
        )

    def _stuck(self, count: int) -> list[Finding]:
        """Return, once a pass, the finding of a stop without a new count."""
        reported, self._stuck_reported = self._stuck_reported, True
        return (
            []
            if reported
            else [self.finding("warning", self.expected, message("count-stuck", count=count))]
        )

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
        back = message(
            "count-disagrees.anew", before=self._last_count, now=count, most=COUNT_MODULUS - 1
        )
        return self.expected, [self.finding("warning", self.expected, back)]


def _breaks_count(wrong: Message | None) -> bool:
    return wrong is not None and wrong.code in BREAKS_COUNT


def begun_anew(route: Route, readings: Sequence[float]) -> bool:
    """Return whether two readings or more make the steps of a route from its first stop on."""
    if not 1 < len(readings) <= len(route):
        return False
    return all(
        agrees(step, route.step_mm(stop, stop + 1)) for stop, step in enumerate(np.diff(readings))
    )


class PassFinder:
    """Finds the pass of a log with its first dwell. ``turn`` is the last stop of the pass before, a
    possible first stop of this pass.
    """

    def __init__(self, survey: Survey, start: CaptureStart) -> None:
        self._survey = survey
        self._start = start
        self._planned = survey.plan.all_setups
        self._unplanned_reported = False
        self._setups: dict[int, list[str]] = {}
        self.walk: Walk | None = None
        self.turn: CapturedStop | None = None

    def follow(
        self, signals: Signals, reading_mm: float | None = None
    ) -> Walk | Finding | Ended | None:
        """Return the walk of the driven pass; a finding for another pass, None after this finding.

        ``reading_mm`` is the laser's present reading, None if its count does not reach back to the
        stops of the log before.
        """
        setup = self._setup_of(signals)
        if setup is None:
            return self._unplanned(signals)
        if self.walk is None:
            self.walk = self._begin(setup, signals, reading_mm)
        elif signals.setup is not None and self.walk.route.setup not in self._meant(signals.setup):
            return Ended("aborted", self.walk.at(message("went-on-with", setup=setup)))
        return self.walk

    def is_head_run(self, signals: Signals) -> bool:
        """Return whether the machine drives a run of the 4-DOF head."""
        if signals.setup is not None:
            own = SETUP_NUMBERS.get(signals.setup)
            return any(
                setup_of(name).is_fourdof for name in ([own] if own else self._meant(signals.setup))
            )
        setup = self.walk.route.setup if self.walk else self._first_wanted()
        return setup is not None and setup_of(setup).is_fourdof

    def _setup_of(self, signals: Signals) -> str | None:
        hints = self._start.hints
        if signals.setup is None:
            return self.walk.route.setup if self.walk else self._first_wanted()
        meant = self._meant(signals.setup)
        named = [name for name in hints if name in meant]
        return next((name for name in named if hints[name].wanted), named[0] if named else None)

    def _meant(self, code: int) -> list[str]:
        """Return the setups that a number may mean: a place in the plan, else any wanted or driven
        setup.
        """
        if code not in self._setups:
            self._setups[code] = setups_meant(
                code, self._planned if code > CODED_FROM else self._start.hints
            )
        return self._setups[code]

    def _first_wanted(self) -> str | None:
        return next((name for name, hint in self._start.hints.items() if hint.wanted), None)

    def _unplanned(self, signals: Signals) -> Finding | None:
        if signals.setup is None or self._unplanned_reported:
            return None
        self._unplanned_reported = True
        planned, base = ", ".join(self._start.hints), SETUP_NUMBERS.get(signals.setup)
        text = message(
            "unplanned-setup",
            number=signals.setup,
            name=base or message("unknown-setup"),
            planned=planned,
        )
        return finding("error", text)

    def _begin(self, setup: str, signals: Signals, reading_mm: float | None) -> Walk:
        survey = self._survey
        hint = self._start.hints[setup]
        out, back = (route_of(survey.planned, setup, number) for number in hint.numbers)
        there = self._place(out, hint, signals, reading_mm)
        if there is not None:
            gone_by = self._gone_by(signals)
            hint = _directed(hint, there, len(out), gone_by, returns=survey.plan.return_pass)
        self.turn = (
            hint.turn if hint.turn is not None and hint.turn.outward is not hint.outward else None
        )
        route = out if hint.outward else back
        if reading_mm is not None and begun_anew(route, (*hint.believed, reading_mm)):
            return Walk.begun_before(route, hint.believed, self._start.last_count)
        known = (
            {_mirrored(stop, hint, route): reading for stop, reading in hint.known.items()}
            if reading_mm is not None
            else {}
        )
        return Walk(route, hint.next_stop, self._start.last_count, hint.last_reading_mm, known)

    def _gone_by(self, signals: Signals) -> int | None:
        """Return how many stops the machine has come to since the last one in the log before; None
        without a counter.
        """
        if signals.stop_count is None or self._start.last_count is None:
            return None
        steps = count_steps(self._start.last_count, signals.stop_count)
        return steps if 0 < steps <= COUNTER_TRUSTED else None

    def _place(
        self, forward: Route, hint: PassHint, signals: Signals, reading_mm: float | None
    ) -> int | None:
        """Return the stop of the outward route at which the machine stands, by its position, else
        by the laser; None if unknown.
        """
        if signals.commanded_mm is not None:
            return forward.find(signals.commanded_mm, 0)
        return (
            LaserPlaces(forward, hint.known).stop_at(reading_mm) if reading_mm is not None else None
        )


def _directed(
    hint: PassHint, there: int, count: int, gone_by: int | None, *, returns: bool
) -> PassHint:
    """Return where a setup stands once the machine was seen at a stop of the outward route.

    A pass that was left in the middle goes on in its direction, unless the machine stands where a
    pass in the other direction begins, or has come to more stops since than the pass has left: then
    it is on its way back, however many of them were seen.
    """
    along = there if hint.outward else count - 1 - there
    counted = None if gone_by is None else hint.next_stop - 1 + gone_by
    if hint.next_stop == 0:
        goes_on = bool(hint.known) and counted is not None and along in (counted, counted + 1)
        nearer = hint.outward if 2 * there == count - 1 else 2 * there < count
        return hint if goes_on else msgspec.structs.replace(hint, outward=nearer)
    begins = (
        along == count - 1
        and along not in (hint.next_stop, counted)
        and (returns or not hint.outward)
    )
    if begins or (returns and counted is not None and _turned(counted - count, count - 1 - along)):
        return msgspec.structs.replace(
            hint, outward=not hint.outward, next_stop=0, last_reading_mm=None, turn=None
        )
    return hint


def _turned(beyond: int, back: int) -> bool:
    """Return whether the stops beyond the end of a pass lead to this one of the way back: a program
    stands at the turn twice, or once."""
    return beyond >= 0 and back in (beyond, beyond + 1)


def _mirrored(stop: int, hint: PassHint, route: Route) -> int:
    return stop if hint.outward else len(route) - 1 - stop
