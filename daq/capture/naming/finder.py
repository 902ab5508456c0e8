"""The driven pass of the plan, by the signals and the first standstill."""

from dataclasses import replace

import numpy as np

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import message
from stepdiag.base.names import SETUP_NUMBERS
from stepdiag.base.setups import CODED_FROM, setup_of, setups_meant
from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.naming.route import agrees, routes_of
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
    """Finds the pass of a log at its first dwell."""

    def __init__(self, survey: Survey, start: CaptureStart) -> None:
        self._survey = survey
        self._start = start
        self._planned = survey.plan.all_setups
        self._unplanned_reported = False
        self._setups: dict[int, list[str]] = {}
        self.walk: Walk | None = None

    def follow(
        self, signals: Signals, reading_mm: float | None = None
    ) -> Walk | Finding | Ended | None:
        """Return the walk of the driven pass, or once a finding if another pass is driven.

        ``reading_mm`` is the laser's present reading, None if its count does not reach back to the
        stops of the log before.
        """
        setup = self._setup_of(signals, reading_mm)
        if setup is None:
            return self._unplanned(signals)
        if self.walk is None:
            self.walk, _ = self._begin(setup, signals, reading_mm)
        elif signals.setup is not None and self.walk.route.setup not in self._meant(
            signals.setup
        ):
            return Ended("aborted", self.walk.at(message("went-on-with", setup=setup)))
        return self.walk

    def is_head_run(self, signals: Signals) -> bool:
        """Return whether the machine drives a run of the 4-DOF head."""
        names: list[str | None]
        if signals.setup is None:
            names = [self.walk.route.setup if self.walk else self._wanted(signals)]
        else:
            own = SETUP_NUMBERS.get(signals.setup)
            names = [own] if own else [*self._meant(signals.setup)]
        return any(name is not None and setup_of(name).is_fourdof for name in names)

    def _setup_of(self, signals: Signals, reading_mm: float | None) -> str | None:
        if signals.setup is not None:
            meant = self._meant(signals.setup)
            hints = [item for item in self._start.hints.items() if item[0] in meant]
            return min(hints, key=lambda item: not item[1].wanted, default=(None, None))[0]
        if self.walk is not None:
            return self.walk.route.setup
        if self._survey.plc.silent:
            return next(iter(self._start.hints))
        return self._going_on(signals, reading_mm) or self._wanted(signals)

    def _meant(self, code: int) -> list[str]:
        """Return the setups that a number may mean."""
        if code not in self._setups:
            self._setups[code] = setups_meant(
                code, self._planned if code > CODED_FROM else self._start.hints
            )
        return self._setups[code]

    def _going_on(self, signals: Signals, reading_mm: float | None) -> str | None:
        """Return the setup with a stop at the present reading of the laser's unbroken count, even
        if the survey needs no further pass of this setup. Another setup would begin with a cut
        beam."""
        for name, hint in self._start.hints.items() if reading_mm is not None else ():
            if hint.known:
                path = self._begin(name, signals, reading_mm)[1]
                # a reading that fits no stop begins a new memory
                if path.name is not None and len(path.known) >= len(hint.known):
                    return name
        return None

    def _wanted(self, signals: Signals) -> str | None:
        """Return the setup that the machine drives by its position: the first wanted setup if the
        machine continues a pass of this setup; else a setup with a stop there, preferably one that
        begins there, that is wanted, and whose NC program has the present count there.
        """
        hints, there = self._start.hints, signals.commanded_mm
        first = next((name for name, hint in hints.items() if hint.wanted), None)
        if first is None or there is None:
            return first
        routes = {
            name: routes_of(self._survey.planned, name, (*hint.numbers, *hint.others))
            for name, hint in hints.items()
        }
        beside = {
            name: [each.beside(there) for each in every] for name, every in routes.items()
        }
        if hints[first].next_stop and np.any(beside[first]):
            return first
        count = signals.stop_count
        shown = {
            name: count is not None
            and any(
                np.any(stands & route.numbered(count))
                for stands, route in zip(beside[name], routes[name], strict=True)
            )
            for name in hints
        }
        return min(
            (name for name in hints if np.any(beside[name])),
            key=lambda name: (
                not beside[name][OUT][0],
                not hints[name].wanted,
                not shown[name],
            ),
            default=first,
        )

    def _unplanned(self, signals: Signals) -> Finding | None:
        if signals.setup is None or self._unplanned_reported:
            return None
        self._unplanned_reported = True
        text = message(
            "unplanned-setup",
            number=signals.setup,
            name=SETUP_NUMBERS.get(signals.setup) or message("unknown-setup"),
            planned=", ".join(self._start.hints),
        )
        return finding("error", text)

    def _begin(
        self, setup: str, signals: Signals, reading_mm: float | None
    ) -> tuple[Walk, Path]:
        """Return the walk of the expected pass, or of the pass in the other direction if that pass
        is more probable; and the path to the first standstill.
        """
        hint = self._start.hints[setup]
        routes = routes_of(self._survey.planned, setup, (*hint.numbers, *hint.others))
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
        # of two equal paths of a begun pass, that of a program begun anew goes first
        begins = [on, *others] if hint.next_stop == 0 else [others[0], on, *others[1:]]
        if hint.outward and hint.next_stop > 0 and not self._survey.plan.return_pass:
            begins = [on]
        reversed_there = [replace(each, stop=0) for each in begins if _reverses(hint, each)]
        look = Look(signals.commanded_mm, signals.stop_count, reading_mm)
        path = Chain(routes, *begins, *reversed_there).take(look)
        outward = routes[path.way].outward
        begin = next(each for each in begins if routes[each.way].outward is outward)
        turn = hint.turn if _reverses(hint, begin) else None
        apart = None
        steps = np.diff([*hint.believed, reading_mm] if reading_mm is not None else [])
        for each in begins if len(steps) else ():
            nominal_mm = routes[each.way].nominal_mm
            if len(steps) < len(nominal_mm) and all(map(agrees, steps, np.diff(nominal_mm))):
                # the believed stops were the first stops of this pass
                known, apart = dict(enumerate(hint.believed)), BEGUN_ANEW
                begin = replace(each, stop=len(known) - 1, left_mm=None, known=known)
        return Walk(routes, begin, turn, apart), path


def _reverses(hint: PassHint, begin: Path) -> bool:
    """Return whether a pass begins where the pass before, in the other direction, has ended."""
    turn = hint.turn
    return turn is not None and hint.next_stop == 0 and turn.outward is not (begin.way == OUT)
