"""A machine without signals: the laser's plateaus place the stops, and the geometry of the begun
pass names them.

The machine sends no stop number. So the first two stops of a pass are known by the step between
them, every following stop by its distance from the stop before, and a lost count ends the pass: the
machine's place is then unknown. Every stop named so is handed on as a dwell at its planned
position, and judged like any other. An instrument whose marker input receives the machine's stop
relay (quDIS) reports and counts the standstills itself.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag.base.findings import Severity, finding
from stepdiag.base.messages import Message, Place, message
from stepdiag.daq.capture.log_start import CaptureStart
from stepdiag.daq.capture.outcome import Ended, Outcome
from stepdiag.daq.capture.place.route import Route, agrees, route_of
from stepdiag.daq.capture.standing.dwell import STILL_MM, Dwell
from stepdiag.daq.capture.standing.window import find_plateaus
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.stream import Span, StreamBuffer

LOOK_NS = 200_000_000
REACH_NS = 60_000_000_000
"""Time before now in ns searched for a standstill."""
PAUSE_NS = 500_000_000
"""Shortest time in ns between two plateaus at a level; less between them is a single shaken
standstill.
"""
ENDING_NS = 1_000_000_000
"""After a lost count the stops before it are still being taken for so long."""
EDGE_NS = 40_000_000
"""The last bins of a plateau may hold the beginning of the move."""
LONG = 2.5
"""A standstill of so many dwells is taken while it lasts: after the last stop the machine may stand
for ever."""
DWELL_SHARE = 0.5
"""A plateau shorter than this share of the dwell is a place where the machine turned round."""
MOST_MISSED = 4


@dataclass(frozen=True, slots=True)
class _Stand:
    """A standstill: its bounds, its level, and its number where the marker input counts."""

    from_ns: float
    to_ns: float
    level_mm: float
    count: int | None = None


@dataclass(slots=True)
class _Place:
    """The stop named last: its index on a route, and what the laser read at the stops so far."""

    route: Route
    stop: int
    levels: dict[int, float]


class ByLaser:
    """Follows the laser of one log. ``look`` is called with every chunk; it returns standstills in
    the order of the pass."""

    def __init__(self, survey: Survey, start: CaptureStart, laser: StreamBuffer) -> None:
        self._laser = laser
        self.setup = next(iter(start.hints))
        out, back = start.hints[self.setup].numbers
        self._routes = {
            True: route_of(survey.planned, self.setup, out),
            False: route_of(survey.planned, self.setup, back),
        }
        needed_s = survey.stop.settle_s + survey.stop.min_window_s
        self._least_s = max(needed_s, DWELL_SHARE * survey.plan.dwell_s)
        self._long_ns = LONG * survey.plan.dwell_s * 1e9
        self._looked_ns = 0
        self._done_ns = -np.inf
        self._breaks = 0
        self._began_ns = np.inf
        self._marked = survey.laser.format == "qudis" and survey.laser.qudis.marker
        self._first: _Stand | None = None
        self._left_ns: int | None = None
        self._place: _Place | None = None
        self._reported: set[str] = set()
        self._lost_ns: int | None = None
        self._over_with = False
        self.seen: list[tuple[float, float]] = []
        """Every standstill so far, placed or not: when it ended (ns), and its level in mm."""
        hint = start.hints[self.setup]
        self._outward, self._fresh = hint.outward, not hint.known
        if hint.next_stop == 0 and not any(each.watched for each in start.breaks):
            self._turn(hint.known)

    def look(self, now_ns: int) -> tuple[list[Dwell], list[Outcome]]:
        """Return the stops whose standstill is over, and what is reported."""
        dwells: list[Dwell] = []
        outcomes: list[Outcome] = []
        if now_ns - self._looked_ns < LOOK_NS:
            return dwells, outcomes
        self._looked_ns = now_ns
        if self._lost_ns is not None:
            if now_ns - self._lost_ns > ENDING_NS and not self._over_with:
                self._over_with = True
                outcomes.append(Ended("aborted", message("count-lost-unplaced", setup=self.setup)))
            return dwells, outcomes
        lost = self._lost()
        for over in self._over(lost=lost):
            self.seen.append((over.to_ns, over.level_mm))
            dwells += [self._dwell(stop, stand) for stop, stand in self._name(over, outcomes)]
        if lost and self._place is not None and 0 <= self._place.stop < len(self._place.route) - 1:
            self._lost_ns = now_ns
        elif lost:
            self._place = self._first = None
        return dwells, outcomes

    def _turn(self, known: dict[int, float]) -> None:
        """Begin at the end of the pass before: the machine is at the first stop of this pass, or
        comes back to it.
        """
        first = 0 if self._outward else len(self._routes[True]) - 1
        if first in known:
            levels = {
                (stop if self._outward else len(self._routes[True]) - 1 - stop): level
                for stop, level in known.items()
            }
            self._place = _Place(self._routes[self._outward], -1, levels)

    def _lost(self) -> bool:
        """Return whether the count was lost since this was asked for the last time."""
        seen, self._breaks = self._breaks, len(self._laser.breaks)
        return any(each.watched for each in self._laser.breaks[seen:])

    def _over(self, *, lost: bool) -> list[_Stand]:
        """Return the standstills left since the last look, a standstill that lasts long, and a
        standstill at the loss of the beam.
        """
        newest = self._laser.newest_ns()
        if not np.isfinite(newest):
            return []
        span = self._laser.span(max(self._done_ns, newest - REACH_NS), newest)
        if not len(span.time_ns):
            return []
        self._began_ns = min(self._began_ns, float(span.time_ns[0]))
        found = _marked(span) if self._marked else _joined(_plateaus(span, self._least_s), span)
        over = []
        for stand, following in zip(found, [*found, None][1:], strict=True):
            left = lost or following is not None or self._has_left(span, stand)
            if left or stand.to_ns - stand.from_ns > self._long_ns:
                over.append(stand)
                self._done_ns = stand.to_ns
        return [each for each in over if each.to_ns - each.from_ns >= self._least_s * 1e9]

    def _has_left(self, span: Span, stand: _Stand) -> bool:
        """Return whether the machine has gone on from the standstill that was seen last."""
        if stand.count is not None:
            return float(span.time_ns[-1]) > stand.to_ns
        return abs(float(span.position_mm[-1]) - stand.level_mm) > STILL_MM

    def _name(self, stand: _Stand, outcomes: list[Outcome]) -> list[tuple[int, _Stand]]:
        """Return the stops that a standstill makes known, with the standstill of each."""
        if self._place is None:
            return self._begin(stand, outcomes)
        place = self._place
        stop = _nearest(place, stand.level_mm)
        turning = place.stop == -1
        if stop is None:
            begun = self._begin(stand, outcomes) if turning else []
            if not begun:
                self._nowhere(place, stand, outcomes)
            return begun
        if stop == place.stop or (
            turning and stop == 0 and stand.from_ns - self._began_ns < EDGE_NS
        ):
            return []  # the machine has not moved since that stop was taken
        self._place = _Place(place.route, stop, {**place.levels, stop: stand.level_mm})
        return [(stop, stand)]

    def _begin(self, stand: _Stand, outcomes: list[Outcome]) -> list[tuple[int, _Stand]]:
        """Hold a standstill until the step to the next shows that a pass has begun, and in which
        direction.
        """
        first, self._first = self._first, stand
        if first is None:
            return []
        moved = stand.level_mm - first.level_mm
        way = next(
            (
                way
                for way in (self._outward, not self._outward)
                if agrees(moved, self._routes[way].step_mm(0, 1))
            ),
            None,
        )
        if way is None:
            return []
        if self._fresh and way is not self._outward:
            self._say(
                "error",
                message(
                    "wrong-laser-sign.first", setup=self.setup, moved_mm=moved, wanted_mm=-moved
                ),
                outcomes,
            )
            return []
        self._place = _Place(self._routes[way], 1, {0: first.level_mm, 1: stand.level_mm})
        return [(0, first), (1, stand)]

    def _nowhere(self, place: _Place, stand: _Stand, outcomes: list[Outcome]) -> None:
        """Report a machine off every stop; if the pass is over, it may have been another pass all
        along.
        """
        last = len(place.route) - 1
        if place.stop == -1 and not agrees(
            stand.level_mm - place.levels[0], -place.route.step_mm(0, 1)
        ):
            return
        if place.stop == -1:
            self._say("error", message("place-unknown.one-more", setup=self.setup), outcomes)
            return
        expected = place.route.step_mm(place.stop, min(place.stop + 1, last))
        moved = stand.level_mm - place.levels[place.stop]
        self._say(
            "warning",
            message("between-stops.apart", setup=self.setup, moved_mm=moved, wanted_mm=expected),
            outcomes,
        )

    def _say(self, severity: Severity, words: Message, outcomes: list[Outcome]) -> None:
        """Take a finding once a log."""
        if words.code not in self._reported:
            self._reported.add(words.code)
            outcomes.append(finding(severity, words, Place(setup=self.setup)))

    def _dwell(self, stop: int, stand: _Stand) -> Dwell:
        """Return a standstill as a machine with signals would show it, at the planned position."""
        place = self._place
        assert place is not None
        x_mm, y_mm, z_mm = place.route.planned_mm(stop)
        from_ns, to_ns = int(stand.from_ns), int(stand.to_ns) - EDGE_NS
        before, self._left_ns = self._left_ns, to_ns
        signals = Signals(stopped=True, stop_count=stand.count, x_mm=x_mm, y_mm=y_mm, z_mm=z_mm)
        return Dwell(
            from_ns=from_ns,
            to_ns=max(from_ns, to_ns),
            not_before_ns=before or from_ns - 1,
            signals=signals,
        )


def _nearest(place: _Place, level_mm: float) -> int | None:
    """Return the stop nearest to a level, seen from the stop before; None if no stop is near."""
    route, here = place.route, max(place.stop, 0)
    most = min(len(route) - 1, place.stop + 1 + MOST_MISSED)
    expected = {
        stop: place.levels.get(stop, place.levels[here] + route.step_mm(here, stop))
        for stop in range(most + 1)
    }
    best = min(expected, key=lambda stop: abs(level_mm - expected[stop]))
    if best == place.stop:
        return best if abs(level_mm - expected[best]) < STILL_MM else None
    return (
        best if agrees(level_mm - place.levels[here], expected[best] - place.levels[here]) else None
    )


def _plateaus(span: Span, least_s: float) -> list[_Stand]:
    """Return the plateaus of a span; a shaken standstill is in several."""
    return [
        _Stand(each.from_ns, each.to_ns, each.level_mm)
        for each in find_plateaus(span.time_ns, span.position_mm, min(least_s, 0.2))
    ]


def _marked(span: Span) -> list[_Stand]:
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
            _Stand(
                float(span.time_ns[begin]),
                float(span.time_ns[end - 1]),
                level_mm,
                int(marker[begin] + 1) // 2,
            )
        )
    return found


def _joined(parts: list[_Stand], span: Span) -> list[_Stand]:
    """Return the parts with the parts of a single standstill joined: the machine was shaken between
    them and did not move.
    """
    found: list[_Stand] = []
    for part in parts:
        last = found[-1] if found else None
        if (
            last is not None
            and part.from_ns - last.to_ns < PAUSE_NS
            and _still_between(last, part, span)
        ):
            found[-1] = _Stand(last.from_ns, part.to_ns, last.level_mm)
        else:
            found.append(part)
    return found


def _still_between(last: _Stand, part: _Stand, span: Span) -> bool:
    first, end = np.searchsorted(span.time_ns, (last.to_ns - EDGE_NS, part.from_ns + EDGE_NS))
    between = np.append(span.position_mm[first:end], part.level_mm)
    return bool(np.abs(between - last.level_mm).max() < STILL_MM)
