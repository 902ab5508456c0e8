"""Which pass of the plan the machine drives, as far as its signals and the log's start record say."""

import msgspec

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import message
from stepdiag.base.names import SETUP_NUMBERS
from stepdiag.base.setups import CODED_FROM, setup_of, setups_meant
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.capture.place.laser_place import LaserPlaces
from stepdiag.daq.capture.place.route import Route, route_of
from stepdiag.daq.capture.place.walk import COUNTER_TRUSTED, Walk, begun_anew
from stepdiag.daq.capture.standing.dwell import count_steps
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import Survey


class PassFinder:
    """Finds the pass of a log with its first dwell. ``turn`` is the last stop of the pass before it, with which it may begin."""

    def __init__(self, survey: Survey, start: CaptureStart) -> None:
        self._survey = survey
        self._start = start
        self._planned = survey.plan.all_setups
        self._unplanned_reported = False
        self.walk: Walk | None = None
        self.turn: CapturedStop | None = None

    def follow(self, signals: Signals, reading_mm: float | None = None) -> Walk | Finding | Ended | None:
        """Return the walk of the pass that the machine drives; what is wrong where it drives another one, None where that was reported.

        ``reading_mm`` is what the laser reads now, None where its count does not reach back to the stops of the log before.
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
        """Tell whether the machine drives a run of the 4-DOF head."""
        if signals.setup is not None:
            own = SETUP_NUMBERS.get(signals.setup)
            return any(setup_of(name).is_fourdof for name in ([own] if own else self._meant(signals.setup)))
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
        """Return the setups that a number may mean: a place in the plan, else any that is wanted or was driven."""
        return setups_meant(code, self._planned if code > CODED_FROM else self._start.hints)

    def _first_wanted(self) -> str | None:
        return next((name for name, hint in self._start.hints.items() if hint.wanted), None)

    def _unplanned(self, signals: Signals) -> Finding | None:
        if signals.setup is None or self._unplanned_reported:
            return None
        self._unplanned_reported = True
        planned, base = ", ".join(self._start.hints), SETUP_NUMBERS.get(signals.setup)
        text = message("unplanned-setup", number=signals.setup, name=base or message("unknown-setup"), planned=planned)
        return finding("error", text)

    def _begin(self, setup: str, signals: Signals, reading_mm: float | None) -> Walk:
        survey = self._survey
        hint = self._start.hints[setup]
        out, back = (route_of(survey.planned, setup, number) for number in hint.numbers)
        there = self._place(out, hint, signals, reading_mm)
        if there is not None:
            gone_by = self._gone_by(signals)
            hint = _directed(hint, there, len(out), gone_by, returns=survey.plan.return_pass)
        self.turn = hint.turn if hint.turn is not None and hint.turn.outward is not hint.outward else None
        route = out if hint.outward else back
        if reading_mm is not None and begun_anew(route, (*hint.believed, reading_mm)):
            return Walk.begun_before(route, hint.believed, self._start.last_count)
        known = {_mirrored(stop, hint, route): reading for stop, reading in hint.known.items()} if reading_mm is not None else {}
        return Walk(route, hint.next_stop, self._start.last_count, hint.last_reading_mm, known)

    def _gone_by(self, signals: Signals) -> int | None:
        """Return how many stops the machine has come to since the last one in the log before; None where its counter does not say."""
        if signals.stop_count is None or self._start.last_count is None:
            return None
        steps = count_steps(self._start.last_count, signals.stop_count)
        return steps if 0 < steps <= COUNTER_TRUSTED else None

    def _place(self, forward: Route, hint: PassHint, signals: Signals, reading_mm: float | None) -> int | None:
        """Return the stop of the outward route at which the machine stands, by its position, else by the laser; None where nobody knows."""
        if signals.commanded_mm is not None:
            return forward.find(signals.commanded_mm, 0)
        return LaserPlaces(forward, hint.known).stop_at(reading_mm) if reading_mm is not None else None


def _directed(hint: PassHint, there: int, count: int, gone_by: int | None, *, returns: bool) -> PassHint:
    """Return where a setup stands once the machine was seen at a stop of the outward route.

    A pass that was left in the middle goes on in its direction, unless the machine stands where a pass in the other direction begins, or
    has come to more stops since than the pass has left: then it is on its way back, however many of them were seen.
    """
    along = there if hint.outward else count - 1 - there
    counted = None if gone_by is None else hint.next_stop - 1 + gone_by
    if hint.next_stop == 0:
        goes_on = bool(hint.known) and counted is not None and along in (counted, counted + 1)
        nearer = hint.outward if 2 * there == count - 1 else 2 * there < count
        return hint if goes_on else msgspec.structs.replace(hint, outward=nearer)
    begins = along == count - 1 and along not in (hint.next_stop, counted) and (returns or not hint.outward)
    if begins or (returns and counted is not None and _turned(counted - count, count - 1 - along)):
        return msgspec.structs.replace(hint, outward=not hint.outward, next_stop=0, last_reading_mm=None, turn=None)
    return hint


def _turned(beyond: int, back: int) -> bool:
    """Tell whether the stops beyond the end of a pass lead to this one of the way back: a program stands at the turn twice, or once."""
    return beyond >= 0 and back in (beyond, beyond + 1)


def _mirrored(stop: int, hint: PassHint, route: Route) -> int:
    return stop if hint.outward else len(route) - 1 - stop
