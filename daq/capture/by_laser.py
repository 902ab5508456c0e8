"""A machine without signals: the laser's plateaus are the standstills, and the chain of `naming`
assigns them to stops.

The machine sends no stop number. So the first stops of a pass are sure by the steps between them,
and a lost count ends the pass: the machine's place is then unknown. Every named stop is handed on
as a dwell at its planned position, and judged like any other. A pass that seems to begin after its
first stop may be another order of the axes: the last stop of such a pass is handed on with the next
standstill, or with the end of the count. An instrument whose marker input receives the machine's
stop relay (quDIS) reports and counts the standstills itself.
"""

import math

import numpy as np

from stepdiag.base.findings import Severity, finding
from stepdiag.base.messages import Message, Place, message
from stepdiag.daq.capture.log_start import CaptureStart
from stepdiag.daq.capture.naming.route import agrees, route_of
from stepdiag.daq.capture.naming.walk import (
    BACK,
    OUT,
    SURE,
    Chain,
    Known,
    Look,
    Path,
    beginnings,
)
from stepdiag.daq.capture.noise import FAULT, LAG_NS, MAJORITY, MOMENT_NS, STILL_MM
from stepdiag.daq.capture.outcome import Ended, Outcome
from stepdiag.daq.capture.standing.dwell import Dwell
from stepdiag.daq.capture.standing.window import EDGE_NS, Plateau, find_plateaus
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.stream import Span, StreamBuffer

LOOK_NS = 200_000_000
REACH_NS = 60_000_000_000
"""The span of time before now, in ns, in which a standstill is searched."""
LONG = 2.5
"""Duration in dwells after which a standstill is captured before its end, because the machine may
stay at the last stop without limit.
"""


class ByLaser:
    """Follows the laser through one log. ``look`` is called with every chunk and returns the
    standstills in the order of the pass.
    """

    def __init__(self, survey: Survey, start: CaptureStart, laser: StreamBuffer) -> None:
        self._laser = laser
        self.setup = next(iter(start.hints))
        out, back = start.hints[self.setup].numbers
        self._routes = (
            route_of(survey.planned, self.setup, out),
            route_of(survey.planned, self.setup, back),
        )
        needed_s = survey.stop.settle_s + survey.stop.min_window_s
        # a plateau of less than half a dwell is a place where the machine turned round
        self._least_s = max(needed_s, MAJORITY * survey.plan.dwell_s)
        self._long_ns = LONG * survey.plan.dwell_s * 1e9
        self._looked_ns = 0
        self._done_ns = -np.inf
        self._breaks = 0
        self._began_ns = np.inf
        self._marked = survey.laser.format == "qudis" and survey.laser.qudis.marker
        self._left_ns: int | None = None
        self._stands: list[Plateau] = []
        self._taken = 0
        self._reported: set[str] = set()
        self._lost_ns: float | None = None
        self._held: list[tuple[int, Plateau]] = []
        """The last stop of a pass that seems to begin after its first stop."""
        self._other_order = False
        self.seen: list[tuple[float, float]] = []
        """Every standstill until now, also those without a stop: the time of its end (ns), and its
        reading in mm.
        """
        hint = start.hints[self.setup]
        self._way, self._fresh = OUT if hint.outward else BACK, not hint.known
        first = 0 if hint.outward else len(self._routes[0]) - 1
        reaches_back = not any(each.watched for each in start.breaks)
        self._turns = reaches_back and hint.next_stop == 0 and first in hint.known
        self._chain = self._begun(hint.known if self._turns else {})

    def _begun(self, known: Known) -> Chain:
        """Return the chain of a pass that begins in the expected direction, or in the opposite
        direction; ``known`` are the readings of the present count, by stop of the outward route.
        """
        begins = beginnings(Path(way=self._way), known, len(self._routes[OUT]), FAULT)
        return Chain(self._routes, *begins, signalled=False)

    def look(self, now_ns: int) -> tuple[list[Dwell], list[Outcome]]:
        """Return the named stops whose standstill is over, and the findings."""
        dwells: list[Dwell] = []
        outcomes: list[Outcome] = []
        if now_ns - self._looked_ns < LOOK_NS:
            return dwells, outcomes
        self._looked_ns = now_ns
        if self._lost_ns is not None:
            if now_ns - self._lost_ns > 2 * LAG_NS:
                self._lost_ns = math.inf
                lost_words = message("count-lost-unplaced", setup=self.setup)
                outcomes.append(Ended("aborted", lost_words))
            return dwells, outcomes
        lost = self._lost()
        for over in self._over(lost=lost):
            self.seen.append((over.to_ns, over.level_mm))
            dwells += [self._dwell(stop, stand) for stop, stand in self._name(over, outcomes)]
        dwells += self.finish() if lost else []
        begun = self._taken and self._chain.best.stop < len(self._routes[0]) - 1
        if lost and (begun or self._other_order):
            self._lost_ns = now_ns
        elif lost:
            self._chain, self._stands, self._taken, self._turns = (
                self._begun({}),
                [],
                0,
                False,
            )
        return dwells, outcomes

    def finish(self) -> list[Dwell]:
        """Return the last stop that waits for the next standstill: the count has ended, so no
        standstill follows.
        """
        held, self._held = self._held, []
        return [self._dwell(stop, stand) for stop, stand in held]

    def _lost(self) -> bool:
        """Return whether the count was lost since the last call."""
        seen, self._breaks = self._breaks, len(self._laser.breaks)
        return any(each.watched for each in self._laser.breaks[seen:])

    def _over(self, *, lost: bool) -> list[Plateau]:
        """Return the standstills that ended since the last call, also a standstill that lasts long
        (`LONG`), and one during which the beam was lost.
        """
        newest = self._laser.newest_ns()
        if not np.isfinite(newest):
            return []
        span = self._laser.span(max(self._done_ns, newest - REACH_NS), newest)
        if not len(span.time_ns):
            return []
        self._began_ns = min(self._began_ns, float(span.time_ns[0]))
        found = _marked(span) if self._marked else _without_shakes(span)
        over = []
        for stand, following in zip(found, [*found, None][1:], strict=True):
            left = lost or following is not None or self._has_left(span, stand)
            if left or stand.to_ns - stand.from_ns > self._long_ns:
                over.append(stand)
                self._done_ns = stand.to_ns
        return [each for each in over if each.to_ns - each.from_ns >= self._least_s * 1e9]

    def _has_left(self, span: Span, stand: Plateau) -> bool:
        """Return whether the machine has left the newest standstill."""
        if stand.count is not None:
            return float(span.time_ns[-1]) > stand.to_ns
        return abs(float(span.position_mm[-1]) - stand.level_mm) > STILL_MM

    def _name(self, stand: Plateau, outcomes: list[Outcome]) -> list[tuple[int, Plateau]]:
        """Return the stops that are sure after a further standstill, each with its own
        standstill.
        """
        if self._held or self._other_order:
            return self._after_last(stand)
        self._stands.append(stand)
        before = self._chain.best
        path = self._chain.take(Look(count=stand.count, reading_mm=stand.level_mm))
        if self._chain.margin < SURE:
            return []
        if path.name is None:
            self._report_nowhere(before, stand, outcomes)
            return []
        if self._fresh and path.way != self._way:
            self._report_wrong_sign(outcomes)
            return []
        stops = [
            (stop, each)
            for last, stop, each in zip(
                (None, *path.names), path.names, self._stands, strict=False
            )
            if stop is not None and stop != last and not self._is_of_pass_before(stop, each)
        ]
        taken, self._taken = self._taken, len(stops)
        sure = stops[taken:]
        late = not self._turns and bool(stops) and stops[0][0] > 0
        if late and sure and sure[-1][0] == len(self._routes[0]) - 1:
            self._held = [sure.pop()]
        return sure

    def _after_last(self, stand: Plateau) -> list[tuple[int, Plateau]]:
        """Return the last stop of a pass that began after its first stop; empty if the machine
        continues by a step of the plan, because the order of the axes is then another.
        """
        held, self._held = self._held, []
        steps_mm = np.diff(self._routes[self._chain.best.way].nominal_mm)
        self._other_order = self._other_order or any(
            agrees(stand.level_mm - last.level_mm, step_mm)
            for _, last in held
            for step_mm in steps_mm
        )
        return [] if self._other_order else held

    def _is_of_pass_before(self, stop: int, stand: Plateau) -> bool:
        """Return whether a standstill is still the last stop of the previous pass: the machine has
        not moved since.
        """
        return self._turns and stop == 0 and stand.from_ns - self._began_ns < EDGE_NS

    def _report_wrong_sign(self, outcomes: list[Outcome]) -> None:
        """Report the first pass of a setup that runs in the opposite direction."""
        before, stand = self._stands[-2:]
        moved = stand.level_mm - before.level_mm
        words = message(
            "wrong-laser-sign.first", setup=self.setup, moved_mm=moved, wanted_mm=-moved
        )
        self._say("error", words, outcomes)

    def _report_nowhere(self, path: Path, stand: Plateau, outcomes: list[Outcome]) -> None:
        """Report a standstill that is at no stop of a pass. Before a pass, only a step beyond the
        last stop of the previous pass is reported: that pass may be shifted by a stop.
        """
        route, stop = self._routes[path.way], max(path.stop, 0)
        if stop not in path.known:
            return
        moved = stand.level_mm - path.known[stop]
        expected = route.step_mm(stop, min(stop + 1, len(route) - 1))
        if path.stop >= 0:
            words = message(
                "between-stops.apart", setup=self.setup, moved_mm=moved, wanted_mm=expected
            )
            self._say("warning", words, outcomes)
        elif agrees(moved, -expected):
            self._say("error", message("place-unknown.one-more", setup=self.setup), outcomes)

    def _say(self, severity: Severity, words: Message, outcomes: list[Outcome]) -> None:
        """Add a finding once per log."""
        if words.code not in self._reported:
            self._reported.add(words.code)
            outcomes.append(finding(severity, words, Place(setup=self.setup)))

    def _dwell(self, stop: int, stand: Plateau) -> Dwell:
        """Return the dwell at the planned position that a machine with signals would show for a
        standstill.
        """
        x_mm, y_mm, z_mm = self._routes[self._chain.best.way].planned_mm(stop)
        from_ns, to_ns = int(stand.from_ns), int(stand.to_ns) - EDGE_NS
        before, self._left_ns = self._left_ns, to_ns
        signals = Signals(
            stopped=True, stop_count=stand.count, x_mm=x_mm, y_mm=y_mm, z_mm=z_mm
        )
        return Dwell(
            from_ns=from_ns,
            to_ns=max(from_ns, to_ns),
            not_before_ns=before or from_ns - 1,
            signals=signals,
        )


def _marked(span: Span) -> list[Plateau]:
    """Return the standstills of the marker input: while its count of edges is odd, the relay is
    closed.
    """
    if span.channels is None:
        return []
    (marker,) = span.channels.T.astype(np.int64)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], marker % 2, [0]))))
    found = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        level_mm = float(np.median(span.position_mm[begin:end]))
        found.append(
            Plateau(
                float(span.time_ns[begin]),
                float(span.time_ns[end - 1]),
                level_mm,
                int(marker[begin] + 1) // 2,
            )
        )
    return found


def _without_shakes(span: Span) -> list[Plateau]:
    """Return the plateaus of a span; plateaus of one standstill, between which the machine was
    shaken but did not move, are joined.
    """
    found: list[Plateau] = []
    for part in find_plateaus(span.time_ns, span.position_mm, MOMENT_NS * 1e-9):
        last = found[-1] if found else None
        if last is not None and _still_between(last, part, span):
            found[-1] = Plateau(last.from_ns, part.to_ns, last.level_mm)
        else:
            found.append(part)
    return found


def _still_between(last: Plateau, part: Plateau, span: Span) -> bool:
    first, end = np.searchsorted(span.time_ns, (last.to_ns - EDGE_NS, part.from_ns + EDGE_NS))
    between = np.append(span.position_mm[first:end], part.level_mm)
    return bool(np.abs(between - last.level_mm).max() < STILL_MM)
