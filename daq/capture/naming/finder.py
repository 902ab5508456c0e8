"""The driven pass of the plan: the signals give its setup, the first standstill gives its
direction.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import message
from stepdiag.base.names import SETUP_NUMBERS
from stepdiag.base.setups import CODED_FROM, setup_of, setups_meant
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.naming.route import Route, agrees, route_of
from stepdiag.daq.capture.naming.walk import (
    BACK,
    BEGUN_ANEW,
    OUT,
    Chain,
    Look,
    Path,
    Walk,
    beginnings,
)
from stepdiag.daq.capture.noise import FAULT
from stepdiag.daq.capture.outcome import Ended
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
            return self._returning(signals, reading_mm) or self._first_wanted()
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

    def _returning(self, signals: Signals, reading_mm: float | None) -> str | None:
        """Return the setup on whose way back the machine is, wanted or not, by the laser's unbroken
        count; None if unknown. Another setup begins with a cut beam."""
        for name, hint in self._start.hints.items() if reading_mm is not None else ():
            if hint.turn is not None and hint.turn.outward:
                path = self._paths(name, signals, reading_mm)[-1]
                return name if path.way == BACK and path.name is not None else None
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
        """Return the walk of the pass that goes on, or of the pass in the other direction if that
        pass is more probable.
        """
        hint = self._start.hints[setup]
        *begins, path = self._paths(setup, signals, reading_mm)
        begin = next(each for each in begins if each.way == path.way)
        self.turn = hint.turn if _reverses(hint, begin) else None
        route = self._routes(setup)[path.way]
        if reading_mm is not None and _begun_anew(route, (*hint.believed, reading_mm)):
            known = dict(enumerate(hint.believed))
            walk = Walk(route, len(known), self._start.last_count, None, known)
            walk.apart = BEGUN_ANEW
            return walk
        return Walk(route, begin.stop + 1, self._start.last_count, begin.left_mm, begin.known)

    def _routes(self, setup: str) -> tuple[Route, Route]:
        """Return the routes of the next pass out and of the next pass back."""
        out, back = self._start.hints[setup].numbers
        planned = self._survey.planned
        return route_of(planned, setup, out), route_of(planned, setup, back)

    def _paths(
        self, setup: str, signals: Signals, reading_mm: float | None
    ) -> tuple[Path, ...]:
        """Return the possible beginnings of the pass, in either direction, and the most probable
        path to the first standstill.
        """
        hint, routes = self._start.hints[setup], self._routes(setup)
        on, *others = beginnings(
            Path(
                way=OUT if hint.outward else BACK,
                stop=hint.next_stop - 1,
                count=None if signals.stop_count is None else self._start.last_count,
                left_mm=hint.last_reading_mm,
            ),
            hint.known if reading_mm is not None else {},
            len(routes[OUT]),
            FAULT if hint.next_stop else 0.0,
        )
        only_out = hint.outward and hint.next_stop > 0 and not self._survey.plan.return_pass
        # of two equal paths of a begun pass, that of a program begun anew goes first
        begins = [on, *others] if hint.next_stop == 0 else [others[0], on, *others[1:]]
        begins = [on] if only_out else begins
        reversed_there = [replace(each, stop=0) for each in begins if _reverses(hint, each)]
        look = Look(signals.commanded_mm, signals.stop_count, reading_mm)
        return *begins, Chain(routes, *begins, *reversed_there).take(look)


def _reverses(hint: PassHint, begin: Path) -> bool:
    """Return whether a pass begins where the pass before, in the other direction, has ended."""
    turn = hint.turn
    return turn is not None and hint.next_stop == 0 and turn.outward is not (begin.way == OUT)


def _begun_anew(route: Route, readings: Sequence[float]) -> bool:
    """Return whether two or more readings agree with the steps of a route from its first stop."""
    if not 1 < len(readings) <= len(route):
        return False
    return all(
        agrees(step, route.step_mm(stop, stop + 1))
        for stop, step in enumerate(np.diff(readings))
    )
