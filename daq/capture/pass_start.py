"""Which pass of the plan the machine drives, as far as its signals and the log's start record say."""

import msgspec

from stepdiag.daq.capture.log_start import CaptureStart
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.capture.route import base_setup, make_route
from stepdiag.daq.capture.stop import CapturedStop
from stepdiag.daq.capture.walk import Walk
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import Survey
from stepdiag.solver.findings import Finding
from stepdiag.solver.geometry.volume import FOURDOF_RUNS, SETUP_NUMBERS


class PassFinder:
    """Finds the pass of a log with its first dwell. ``turn`` is the last stop of the outward pass, with which a return pass may begin."""

    def __init__(self, survey: Survey, start: CaptureStart) -> None:
        self._survey = survey
        self._start = start
        self._unplanned_said = False
        self.walk: Walk | None = None
        self.turn: CapturedStop | None = None

    def follow(self, signals: Signals) -> Walk | Finding | Ended | None:
        """Return the walk of the pass that the machine drives; what is wrong where it drives another one, None where that was said."""
        setup = self._setup_of(signals)
        if setup is None:
            return self._unplanned(signals)
        if self.walk is None:
            self.walk = self._begin(setup, signals)
        elif base_setup(self.walk.route.setup) != base_setup(setup):
            return Ended("aborted", f"{self.walk.name}: the machine went on with {setup}")
        return self.walk

    def is_head_run(self, signals: Signals) -> bool:
        """Tell whether the machine drives a run of the 4-DOF head."""
        if signals.setup is not None:
            return SETUP_NUMBERS.get(signals.setup) in FOURDOF_RUNS
        return (self.walk.route.setup if self.walk else self._first_wanted()) in FOURDOF_RUNS

    def _setup_of(self, signals: Signals) -> str | None:
        hints = self._start.hints
        if signals.setup is None:
            return self.walk.route.setup if self.walk else self._first_wanted()
        base = SETUP_NUMBERS.get(signals.setup)
        named = [name for name in hints if base_setup(name) == base]
        return next((name for name in named if hints[name].wanted), named[0] if named else None)

    def _first_wanted(self) -> str | None:
        return next((name for name, hint in self._start.hints.items() if hint.wanted), None)

    def _unplanned(self, signals: Signals) -> Finding | None:
        if signals.setup is None or self._unplanned_said:
            return None
        self._unplanned_said = True
        planned, base = ", ".join(self._start.hints), SETUP_NUMBERS.get(signals.setup)
        text = f"the machine drives setup {signals.setup} ({base or 'unknown'}), the survey plans {planned}: its stops are not used"
        return Finding(code="unplanned-setup", severity="error", text=text)

    def _begin(self, setup: str, signals: Signals) -> Walk:
        hint = self._start.hints[setup]
        survey = self._survey
        forward = make_route(survey.volume, setup, survey.axis_order, outward=True)
        there = forward.find(signals.commanded_mm, 0) if signals.commanded_mm is not None else None
        if there is not None and hint.next_stop == 0:
            hint = msgspec.structs.replace(hint, outward=2 * there < len(forward))
        self.turn = hint.turn if not hint.outward else None
        route = forward if hint.outward else make_route(survey.volume, setup, survey.axis_order, outward=False)
        return Walk(route, hint.next_stop, self._start.last_count, hint.last_reading_mm)
