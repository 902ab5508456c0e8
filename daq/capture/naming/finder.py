"""The driven pass of the plan: its setup by the signals, its direction by the first standstill."""

from collections.abc import Sequence

import msgspec
import numpy as np

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import message
from stepdiag.base.names import SETUP_NUMBERS
from stepdiag.base.setups import CODED_FROM, setup_of, setups_meant
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.naming.route import Route, agrees, route_of
from stepdiag.daq.capture.naming.walk import BEGUN_ANEW, COUNTER_TRUSTED, Walk, stop_reading
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.capture.standing.dwell import count_steps
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import Survey


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
        if reading_mm is not None and _begun_anew(route, (*hint.believed, reading_mm)):
            walk = Walk(
                route,
                len(hint.believed),
                self._start.last_count,
                None,
                dict(enumerate(hint.believed)),
            )
            walk.apart = BEGUN_ANEW
            return walk
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
        by the laser; None if unknown."""
        if signals.commanded_mm is not None:
            return forward.find(signals.commanded_mm, 0)
        return stop_reading(forward, hint.known, reading_mm)


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


def _begun_anew(route: Route, readings: Sequence[float]) -> bool:
    """Return whether two readings or more make the steps of a route from its first stop on."""
    if not 1 < len(readings) <= len(route):
        return False
    return all(
        agrees(step, route.step_mm(stop, stop + 1)) for stop, step in enumerate(np.diff(readings))
    )


def _turned(beyond: int, back: int) -> bool:
    """Return whether the stops beyond the end of a pass lead to this one of the way back: a program
    stands at the turn twice, or once."""
    return beyond >= 0 and back in (beyond, beyond + 1)


def _mirrored(stop: int, hint: PassHint, route: Route) -> int:
    return stop if hint.outward else len(route) - 1 - stop
