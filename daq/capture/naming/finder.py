"""The driven pass of the plan: the signals give its setup, the first standstill gives its
direction.
"""

import math
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
from stepdiag.daq.capture.naming.walk import (
    AGAIN,
    BEGUN_ANEW,
    COUNTER_TRUSTED,
    FAULT,
    Walk,
    stop_reading,
)
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.capture.standing.dwell import COUNT_MODULUS, count_steps
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import Survey


class PassFinder:
    """Finds the pass of a log at its first dwell. ``turn`` is the last stop of the pass before, a
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
        """Return the walk of the driven pass, or a finding if another pass is driven; None after
        this finding.

        ``reading_mm`` is the laser's present reading, None if its count does not reach back to the
        stops of the log before.
        """
        setup = self._setup_of(signals, reading_mm)
        if setup is None:
            return self._unplanned(signals)
        if self.walk is None:
            self.walk = self._begin(setup, signals, reading_mm)
        elif signals.setup is not None and self.walk.route.setup not in self._meant(
            signals.setup
        ):
            return Ended("aborted", self.walk.at(message("went-on-with", setup=setup)))
        return self.walk

    def is_head_run(self, signals: Signals) -> bool:
        """Return whether the machine drives a run of the 4-DOF head."""
        if signals.setup is not None:
            own = SETUP_NUMBERS.get(signals.setup)
            return any(
                setup_of(name).is_fourdof
                for name in ([own] if own else self._meant(signals.setup))
            )
        setup = self.walk.route.setup if self.walk else self._first_wanted()
        return setup is not None and setup_of(setup).is_fourdof

    def _setup_of(self, signals: Signals, reading_mm: float | None) -> str | None:
        hints = self._start.hints
        if signals.setup is None:
            if self.walk is not None:
                return self.walk.route.setup
            return self._returning(reading_mm) or self._first_wanted()
        meant = self._meant(signals.setup)
        named = [name for name in hints if name in meant]
        return next(
            (name for name in named if hints[name].wanted), named[0] if named else None
        )

    def _meant(self, code: int) -> list[str]:
        """Return the setups that a number may mean: a place in the plan, or else any wanted or
        driven setup.
        """
        if code not in self._setups:
            self._setups[code] = setups_meant(
                code, self._planned if code > CODED_FROM else self._start.hints
            )
        return self._setups[code]

    def _returning(self, reading_mm: float | None) -> str | None:
        """Return the setup on whose way back the machine is, wanted or not, by the laser's unbroken
        count; None if unknown. Another setup begins with a cut beam."""
        for name, hint in self._start.hints.items():
            if hint.turn is not None and hint.turn.outward:
                out = route_of(self._survey.planned, name, hint.numbers[0])
                return name if stop_reading(out, hint.known, reading_mm) else None
        return None

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
            odds = _turned_odds(
                hint, there, len(out), self._gone_by(signals), returns=survey.plan.return_pass
            )
            hint = _turned(hint) if odds > 0.0 else hint
        self.turn = (
            hint.turn
            if hint.turn is not None and hint.turn.outward is not hint.outward
            else None
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
        return Walk(
            route, hint.next_stop, self._start.last_count, hint.last_reading_mm, known
        )

    def _gone_by(self, signals: Signals) -> int | None:
        """Return the number of stops since the last stop of the previous log, by the counter; None
        without a counter.
        """
        if signals.stop_count is None or self._start.last_count is None:
            return None
        steps = count_steps(self._start.last_count, signals.stop_count)
        return steps if 0 < steps <= COUNTER_TRUSTED else None

    def _place(
        self, forward: Route, hint: PassHint, signals: Signals, reading_mm: float | None
    ) -> int | None:
        """Return the stop of the outward route at which the machine stands, by its position, or
        else by the laser; None if unknown.
        """
        if signals.commanded_mm is not None:
            return forward.find(signals.commanded_mm, 0)
        return stop_reading(forward, hint.known, reading_mm)


def _turned(hint: PassHint) -> PassHint:
    """Return the place at which a setup stands that has begun its pass in the other direction."""
    anew = (
        {} if hint.next_stop == 0 else {"next_stop": 0, "last_reading_mm": None, "turn": None}
    )
    return msgspec.structs.replace(hint, outward=not hint.outward, **anew)


def _turned_odds(
    hint: PassHint, there: int, count: int, gone_by: int | None, *, returns: bool
) -> float:
    """Return the logarithm of the odds that a setup seen at a stop of the outward route has begun
    its pass in the other direction, against the pass that goes on.

    The program continued past the end onto its way back, whatever number of stops was missed, or
    was restarted at the other end. Stops that the counter shows are no coincidence.
    """
    along = there if hint.outward else count - 1 - there
    back, left = count - 1 - along, count - hint.next_stop
    if hint.next_stop == 0:
        known = gone_by if hint.known else None
        return _unseen(along, along, known) - _unseen(back, None, known)
    on = along - hint.next_stop
    goes_on = (
        _unseen(on, on + 1, gone_by, twice=False)
        if on >= 0
        else FAULT + _unseen(0, None, gone_by)
    )
    if hint.outward and not returns:
        return -math.inf
    turned = FAULT + _unseen(left + back, left + back if returns else None, gone_by)
    begun = FAULT + _unseen(0, None, gone_by) if back == 0 else math.inf
    return goes_on - min(turned, begun)


def _unseen(
    stops: int, counts: int | None, gone_by: int | None, *, twice: bool = True
) -> float:
    """Return the cost of missed stops. The counter shows ``counts`` stops, or one more where a
    program stands ``twice`` at the turn; None for an uncertain number.
    """
    if gone_by is not None and counts is not None and gone_by - counts in (0, int(twice)):
        return FAULT if stops else 0.0
    return (FAULT + AGAIN * stops if stops else 0.0) + (
        0.0 if gone_by is None else math.log(COUNT_MODULUS)
    )


def _begun_anew(route: Route, readings: Sequence[float]) -> bool:
    """Return whether two or more readings agree with the steps of a route from its first stop."""
    if not 1 < len(readings) <= len(route):
        return False
    return all(
        agrees(step, route.step_mm(stop, stop + 1))
        for stop, step in enumerate(np.diff(readings))
    )


def _mirrored(stop: int, hint: PassHint, route: Route) -> int:
    return stop if hint.outward else len(route) - 1 - stop
