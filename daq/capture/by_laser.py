"""A machine without signals: the laser's plateaus are the standstills, and the chain of `naming`
assigns them to stops. Each is handed on as a dwell at its planned position.

The first stops of a pass are sure by the steps between them. A lost count ends the pass: the
machine's place is then unknown. A pass that seems to begin after its first stop may be another
order of the axes: its last stop is handed on with the next standstill, or with the end of the
count. An instrument whose marker input receives the machine's stop relay (quDIS) reports and counts
the standstills itself.
"""

import math

import numpy as np

from stepdiag.base.findings import Severity, finding
from stepdiag.base.messages import Message, Place, message
from stepdiag.daq.capture.log_start import CaptureStart
from stepdiag.daq.capture.naming.route import agrees, routes_of
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
    """Follows the laser through one log, chunk by chunk."""

    def __init__(self, survey: Survey, start: CaptureStart, laser: StreamBuffer) -> None:
        self._laser = laser
        self.setup = next(iter(start.hints))
        hint = start.hints[self.setup]
        self._routes = routes_of(survey.planned, self.setup, hint.numbers)
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
        self._reported: set[str] = set()
        self._lost_ns: float | None = None
        self._held: list[Dwell] = []
        """The last stop of a pass that seems to begin after its first stop."""
        self._other_order = False
        self.seen: list[tuple[float, float]] = []
        """Every standstill until now, also those without a stop: the time of its end (ns), and its
        reading in mm.
        """
        self._way, self._fresh = OUT if hint.outward else BACK, not hint.known
        first = 0 if hint.outward else len(self._routes[OUT]) - 1
        reaches_back = not any(each.watched for each in start.breaks)
        turns = reaches_back and hint.next_stop == 0 and first in hint.known
        self._begin(hint.known if turns else {})

    def _begin(self, known: Known) -> None:
        begins = beginnings(Path(way=self._way), known, len(self._routes[OUT]), FAULT)
        self._chain = Chain(self._routes, *begins, signalled=False)
        self._turns, self._taken = bool(known), 0
        self._stands: list[Plateau] = []

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
                words = message("count-lost-unplaced", setup=self.setup)
                outcomes.append(Ended("aborted", words))
            return dwells, outcomes
        breaks = self._laser.breaks
        lost = any(each.watched for each in breaks[self._breaks :])
        self._breaks = len(breaks)
        for stand in self._over(lost=lost):
            self.seen.append((stand.to_ns, stand.level_mm))
            dwells += self._name(stand, outcomes)
        if lost:
            dwells += self.finish()
            begun = self._taken and self._chain.best.stop < len(self._routes[OUT]) - 1
            if begun or self._other_order:
                self._lost_ns = now_ns
            else:
                self._begin({})
        return dwells, outcomes

    def finish(self) -> list[Dwell]:
        """Return the last stop that waits for the next standstill: none follows."""
        held, self._held = self._held, []
        return held

    def _over(self, *, lost: bool) -> list[Plateau]:
        """Return the standstills that ended, or last long (`LONG`), since the last call."""
        newest = self._laser.newest_ns()
        span = self._laser.span(max(self._done_ns, newest - REACH_NS), newest)
        if not len(span.time_ns):
            return []
        self._began_ns = min(self._began_ns, float(span.time_ns[0]))
        found = _marked(span) if self._marked else _without_shakes(span)
        over = []
        for stand in found:
            moved = (
                abs(span.position_mm[-1] - stand.level_mm) > STILL_MM
                if stand.count is None
                else span.time_ns[-1] > stand.to_ns
            )
            left = lost or moved or stand is not found[-1]
            if left or stand.to_ns - stand.from_ns > self._long_ns:
                over.append(stand)
                self._done_ns = stand.to_ns
        return [each for each in over if each.to_ns - each.from_ns >= self._least_s * 1e9]

    def _name(self, stand: Plateau, outcomes: list[Outcome]) -> list[Dwell]:
        """Return the stops that are sure after a further standstill."""
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
            moved = stand.level_mm - self._stands[-2].level_mm
            sizes = {"moved_mm": moved, "wanted_mm": -moved}
            words = message("wrong-laser-sign.first", setup=self.setup, **sizes)
            self._report("error", words, outcomes)
            return []
        stops = [
            (stop, each)
            for last, stop, each in zip(
                (None, *path.names), path.names, self._stands, strict=False
            )
            if stop is not None and stop != last and not self._is_of_pass_before(stop, each)
        ]
        taken, self._taken = self._taken, len(stops)
        sure = [self._dwell(stop, each) for stop, each in stops[taken:]]
        late = not self._turns and bool(stops) and stops[0][0] > 0
        if late and sure and stops[-1][0] == len(self._routes[OUT]) - 1:
            self._held = [sure.pop()]
        return sure

    def _after_last(self, stand: Plateau) -> list[Dwell]:
        """Return the last stop that was held; empty if the machine continues by a step of the
        plan: the order of the axes is then another.
        """
        held, last = self.finish(), self._chain.best
        steps_mm = np.diff(self._routes[last.way].nominal_mm)
        moved_mm = stand.level_mm - last.known[last.stop]
        self._other_order |= any(agrees(moved_mm, step_mm) for step_mm in steps_mm)
        return [] if self._other_order else held

    def _is_of_pass_before(self, stop: int, stand: Plateau) -> bool:
        """Return whether the machine has not moved since the last stop of the previous pass."""
        return self._turns and stop == 0 and stand.from_ns - self._began_ns < EDGE_NS

    def _report_nowhere(self, path: Path, stand: Plateau, outcomes: list[Outcome]) -> None:
        """Report a standstill at no stop of a pass; before a pass, only a step beyond the last stop
        of the previous pass, which may be shifted by a stop.
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
            self._report("warning", words, outcomes)
        elif agrees(moved, -expected):
            self._report(
                "error", message("place-unknown.one-more", setup=self.setup), outcomes
            )

    def _report(self, severity: Severity, words: Message, outcomes: list[Outcome]) -> None:
        if words.code not in self._reported:
            self._reported.add(words.code)
            outcomes.append(finding(severity, words, Place(setup=self.setup)))

    def _dwell(self, stop: int, stand: Plateau) -> Dwell:
        """Return the dwell at the planned position that a machine with signals would show for a
        standstill.
        """
        x_mm, y_mm, z_mm = self._routes[self._chain.best.way].planned_mm(stop)
        from_ns, to_ns = int(stand.from_ns), int(stand.to_ns) - EDGE_NS
        before_ns, self._left_ns = self._left_ns or from_ns - 1, to_ns
        signals = Signals(
            stopped=True, stop_count=stand.count, x_mm=x_mm, y_mm=y_mm, z_mm=z_mm
        )
        to_ns = max(from_ns, to_ns)
        return Dwell(from_ns=from_ns, to_ns=to_ns, not_before_ns=before_ns, signals=signals)


def _marked(span: Span) -> list[Plateau]:
    """Return the standstills: the relay is closed while the marker's count of edges is odd."""
    if span.channels is None:
        return []
    (marker,) = span.channels.T.astype(np.int64)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], marker % 2, [0]))))
    return [
        Plateau(
            float(span.time_ns[begin]),
            float(span.time_ns[end - 1]),
            float(np.median(span.position_mm[begin:end])),
            int(marker[begin] + 1) // 2,
        )
        for begin, end in zip(edges[::2], edges[1::2], strict=True)
    ]


def _without_shakes(span: Span) -> list[Plateau]:
    """Return the plateaus of a span; those between which the machine did not move are joined."""
    found: list[Plateau] = []
    for part in find_plateaus(span.time_ns, span.position_mm, MOMENT_NS * 1e-9):
        if found and _still_between(found[-1], part, span):
            found[-1] = Plateau(found[-1].from_ns, part.to_ns, found[-1].level_mm)
        else:
            found.append(part)
    return found


def _still_between(last: Plateau, part: Plateau, span: Span) -> bool:
    first, end = np.searchsorted(span.time_ns, (last.to_ns - EDGE_NS, part.from_ns + EDGE_NS))
    between = np.append(span.position_mm[first:end], part.level_mm)
    return bool(np.abs(between - last.level_mm).max() < STILL_MM)
