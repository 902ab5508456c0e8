"""From a dwell on a pass to its stop: its number, its reading, and whether the laser's count
reaches back to the previous stop.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np

from stepdiag.base.findings import Finding, Severity
from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.capture.captured_stop import CapturedStop, marked, remarks_of
from stepdiag.daq.capture.head_stop import troubles
from stepdiag.daq.capture.log_start import CaptureStart
from stepdiag.daq.capture.naming.route import Route, agrees
from stepdiag.daq.capture.naming.walk import BEGUN_ANEW, BREAKS_COUNT, Look, Walk
from stepdiag.daq.capture.noise import LEAST_SAMPLES, PLACED_MM
from stepdiag.daq.capture.outages import LINK_DOWN, Outages
from stepdiag.daq.capture.outcome import Outcome
from stepdiag.daq.capture.standing.certain_window import (
    PassNoise,
    Taken,
    came_along,
    last_beyond_ns,
    take,
    watched_closely,
)
from stepdiag.daq.capture.standing.dwell import Dwell
from stepdiag.daq.capture.standing.window import (
    EDGE_NS,
    Placing,
    find_plateaus,
    summarise,
)
from stepdiag.daq.formats.signals import SignalMap, Signals, resolution
from stepdiag.daq.records.events import Link
from stepdiag.daq.survey.models import StopRules, Survey
from stepdiag.daq.timing.stream import Break, StreamBuffer

FROM_BEYOND, FROM_WHERE, NOT_ALL_MOVED = (
    message("other-side"),
    message("other-side.from-where"),
    message("other-side.not-all-moved"),
)
"""Reasons why a stop may have been approached from the other side."""

Named = tuple[Dwell, list[Taken], int | None]
"""A standstill: its dwell, its windows, and the name of its stop."""


class StopTaker:
    """Captures the stops of one log."""

    def __init__(
        self,
        survey: Survey,
        laser: StreamBuffer,
        head: StreamBuffer | None,
        start: CaptureStart,
        outages: Outages,
    ) -> None:
        self._rules = survey.stop
        self._both_ways = survey.plan.return_pass
        self._positions = PositionCheck(survey.plc.signals)
        self._laser = laser
        self._head = head
        self._outages = outages
        self._wall_offset_ns = start.wall_offset_ns
        self._before = start.breaks
        self._beyond = start.beyond
        self._turn_unseen = False
        self._other_side: set[str] = set()
        """Axes that have not moved since the machine reached a stop from the other side."""
        self._breaks_seen = 0
        self._looked_until_ns = 0.0
        self._noise = PassNoise()
        self._named: list[Named] = []
        """The standstills since the last loss of count, with the names of their stops."""
        self._stops: list[CapturedStop] = []

    def take(
        self,
        walk: Walk,
        dwell: Dwell,
        placing: Placing,
        windows: Sequence[Taken],
        outcomes: list[Outcome],
    ) -> None:
        """Take the stop of a dwell with its windows, and the stops before it that Modbus missed."""
        by_laser = dwell.signals.commanded_mm is None and placing is self._laser
        if not by_laser and walk.is_bounce(dwell.signals):
            return
        taken = [self._noise.take(each, self._rules) for each in windows]
        lost = not self.reaches_back(taken, dwell)
        seen = [each.window.mean_mm for each in taken] if placing is self._laser else []
        look = Look(
            dwell.signals.commanded_mm,
            dwell.signals.stop_count,
            seen[0] if seen else None,
            lost,
            seen[-1] if len(seen) > 1 else None,
        )
        expected_route = walk.route
        path, odd = walk.locate(look)
        index, names = path.name, path.names
        if walk.route is not expected_route:
            outcomes += self._stops_anew(walk.route, index)
        if walk.apart:
            self._before, walk.apart = (*self._before, Break(dwell.from_ns, walk.apart)), None
        self._named = [*([] if lost else self._named), (dwell, taken, names[-1])]
        renamed = (
            by_laser
            and walk.unsure is None
            and [name for _, _, name in self._named] != list(names)
        )
        outcomes += self._name_anew(walk, names) if renamed else odd
        if index is None or (
            by_laser and index < walk.expected and walk.is_bounce(dwell.signals)
        ):
            return
        turn = walk.turn
        if (
            walk.expected == 0
            and turn is not None
            and self._turned_round(walk, turn, index, dwell, outcomes)
        ):
            stop_count = dwell.signals.stop_count if index == 0 else turn.stop_count
            self._stops = [_shared_turn(walk, turn, stop_count)]
            outcomes += self._stops
            if index == 0:
                return
        for missed in range(walk.expected, index):
            expected_mm = (
                turn.reading_mm
                if missed == 0 and turn is not None
                else walk.expected_reading_mm(missed)
            )
            self._recover(walk, missed, dwell, expected_mm, outcomes)
        outcomes += self._positions.judge(walk, index, dwell.signals)
        self._place(walk, index, dwell, taken, outcomes)
        self._looked_until_ns = max(self._looked_until_ns, float(dwell.to_ns))

    def _stops_anew(self, route: Route, until: int | None) -> list[CapturedStop]:
        """Return the earlier stops of the pass, before the stop ``until``, on a route with another
        order of the axes: their places are the same. A program that begins anew has none.
        """
        first = max((at for at, stop in enumerate(self._stops) if stop.stop == 0), default=0)
        return [
            msgspec.structs.replace(stop, order=route.order)
            for stop in self._stops[first:]
            if until is None or stop.stop < until
        ]

    def _turned_round(
        self,
        walk: Walk,
        turn: CapturedStop,
        index: int,
        dwell: Dwell,
        outcomes: list[Outcome],
    ) -> bool:
        """Return whether a pass begins with the last reading of the previous pass: the machine
        reversed at this stop.

        A machine with an overrun came back from the other side: then the pass has a first stop of
        its own, seen or not. If this is unknown, an unseen overrun counts as none: the count does
        not reach back beyond doubt.
        """
        head_run = self._head is not None and walk.route.travel.is_fourdof
        if head_run or self._beyond is None or self._breaks_before(dwell.from_ns):
            self._turn_unseen = not head_run and self._beyond is not None
            return index > 0
        beyond_ns = last_beyond_ns(
            self._laser, turn, -walk.route.step_mm(0, 1), dwell.from_ns
        )
        if beyond_ns is None and not self._beyond:
            if not watched_closely(self._laser, turn, dwell.from_ns):
                return index > 0
            outcomes.append(walk.finding("warning", 0, message("turned-round")))
            return True
        self._looked_until_ns = max(self._looked_until_ns, beyond_ns or turn.window_to_ns)
        return False

    def _name_anew(self, walk: Walk, names: Sequence[int | None]) -> list[Outcome]:
        """Assign the standstills of the present count again whose names a later standstill has
        changed, without the last standstill.
        """
        before = [name for *_, name in self._named]
        first = next(at for at, name in enumerate(names) if name != before[at])
        self._named = [
            (*stand[:2], name) for stand, name in zip(self._named, names, strict=True)
        ]
        stands = self._named[first:-1]
        again = next((name for *_, name in stands if name is not None), None)
        if again is None:
            return []
        return self._place_again(walk, stands, walk.begin_anew(again))

    def name_from_second(self, walk: Walk) -> list[Outcome]:
        """Assign the standstills of a pass again, from its second stop on: the first is missing."""
        self._named = [(*stand[:2], at) for at, stand in enumerate(self._named, 1)]
        walk.begin_anew(1)
        why = walk.finding("error", 0, message("stop-lost.first"))
        return self._place_again(walk, self._named, why)

    def _place_again(
        self, walk: Walk, stands: Sequence[Named], why: Finding
    ) -> list[Outcome]:
        """Place the named ones of standstills again; return the finding that states the reason, and
        the outcomes.
        """
        outcomes: list[Outcome] = [why]
        stops = [(dwell, taken, name) for dwell, taken, name in stands if name is not None]
        self._before = (Break(stops[0][0].from_ns, BEGUN_ANEW),)
        for dwell, taken, name in stops:
            self._place(walk, name, dwell, taken, outcomes)
        return outcomes

    def _place(
        self,
        walk: Walk,
        index: int,
        dwell: Dwell,
        taken: list[Taken],
        outcomes: list[Outcome],
    ) -> None:
        if self._head is not None and walk.route.travel.is_fourdof:
            self._place_head(
                walk, index, dwell, taken[-1] if taken else None, self._head, outcomes
            )
            return
        expected = walk.expected_reading_mm(index)
        if not taken and expected is not None:
            begin = max(self._looked_until_ns, float(dwell.not_before_ns or dwell.from_ns))
            seen = plateau_window(
                self._laser, begin, self._laser.newest_ns(), expected, self._rules
            )
            taken = [seen] if seen is not None else []
        if not taken:
            outcomes += self._without_reading(
                walk, index, dwell, "laser", message("stop-without-reading")
            )
            walk.skip(index, dwell.signals.stop_count)
        for number, window in enumerate(taken):
            stop = make_stop(
                walk.route, index, dwell.signals, window, self._head, self._wall_offset_ns
            )
            if doubt := self._from_beyond(walk, index, dwell, taken[0]):
                stop = marked(stop, doubt)
            self._commit(walk, stop, outcomes, again=number > 0)

    def _without_reading(
        self, walk: Walk, index: int, dwell: Dwell, link: Link, symptom: Message
    ) -> list[Finding]:
        """Return why a stop has no reading: once an outage that the link was down, otherwise the
        symptom.
        """
        if not self._outages.covers(link, dwell.from_ns, dwell.to_ns):
            return [walk.finding("error", index, symptom)]
        return (
            [walk.finding("error", index, LINK_DOWN[link])]
            if self._outages.news(link)
            else []
        )

    def _from_beyond(
        self, walk: Walk, index: int, dwell: Dwell, taken: Taken
    ) -> Message | None:
        """Return the reason why a stop may have been reached in the direction of the other pass;
        None otherwise.

        Every axis is then on the other side until it moves.
        """
        side = self._last_move(walk, index, dwell, taken)
        if side:
            self._other_side = {
                walk.route.axis_to(stop) for stop in range(1, len(walk.route))
            }
        elif index < walk.expected:
            self._other_side = set()
        else:
            self._other_side.discard(walk.route.axis_to(index))
        return side or (NOT_ALL_MOVED if self._other_side else None)

    def _last_move(
        self, walk: Walk, index: int, dwell: Dwell, taken: Taken
    ) -> Message | None:
        """Return the finding of the last move to a stop; None for a move of the pass."""
        if index == 0:
            along = came_along(self._laser, taken, dwell.from_ns, walk.route.step_mm(0, 1))
            came_back = along is False and self._both_ways and walk.expected > 0
            if came_back:
                return FROM_BEYOND
            return FROM_WHERE if self._turn_unseen and along is None else None
        if not self._both_ways or walk.judge(index, taken.window.mean_mm) is not None:
            return None
        along = came_along(
            self._laser, taken, dwell.from_ns, walk.route.step_mm(index - 1, index)
        )
        counted = dwell.signals.stop_count is not None
        if along is None and walk.last is None and index < walk.expected - 1 and not counted:
            return FROM_WHERE
        return FROM_BEYOND if along is False else None

    def _place_head(
        self,
        walk: Walk,
        index: int,
        dwell: Dwell,
        taken: Taken | None,
        head: StreamBuffer,
        outcomes: list[Outcome],
    ) -> None:
        """Take a stop of the 4-DOF head. The head does not count: a cut beam has no effect, and no
        step can judge it.
        """
        outcomes += [walk.finding("warning", index, words) for words in troubles(head, dwell)]
        if taken is None:
            outcomes += self._without_reading(
                walk, index, dwell, "head", message("stop-without-reading.head")
            )
            walk.skip(index, dwell.signals.stop_count)
            return
        stop = make_head_stop(
            walk.route, index, dwell.signals, taken, head, self._laser, self._wall_offset_ns
        )
        outcomes += [*_doubts(walk, stop), stop]
        walk.advance(stop)

    def _recover(
        self,
        walk: Walk,
        index: int,
        dwell: Dwell,
        expected: float | None,
        outcomes: list[Outcome],
    ) -> None:
        """Search the laser's readings since the previous stop for a stop that Modbus missed; its
        level in mm separates it from others.
        """
        end = float(dwell.from_ns)
        taken = (
            plateau_window(self._laser, self._looked_until_ns, end, expected, self._rules)
            if expected is not None
            else None
        )
        if taken is None:
            outcomes += self._without_reading(
                walk, index, dwell, "laser", message("stop-lost")
            )
            return
        elsewhere = replace(dwell.signals, x_mm=None, y_mm=None, z_mm=None)
        stop = make_stop(
            walk.route, index, elsewhere, taken, self._head, self._wall_offset_ns
        )
        doubt = message("stop-recovered")
        stop = marked(msgspec.structs.replace(stop, recovered=True), doubt)
        outcomes.append(walk.finding("warning", index, doubt))
        self._looked_until_ns = taken.to_ns
        self._commit(walk, stop, outcomes)

    def _commit(
        self, walk: Walk, stop: CapturedStop, outcomes: list[Outcome], *, again: bool = False
    ) -> None:
        """Judge a stop and add it. ``again``: it was already measured before the break, at the same
        standstill.
        """
        broken, unwatched = self._breaks_up_to(stop.window_to_ns)
        stop = marked(stop, walk.unsure) if walk.unsure else stop
        count = self._laser.count_at(0.5 * (stop.window_from_ns + stop.window_to_ns))
        stop = msgspec.structs.replace(stop, count=count)
        wrong = (
            walk.judge(stop.stop, stop.reading_mm) if stop.reading_mm is not None else None
        )
        if again:
            outcomes.append(_bridged_break(walk, stop.stop, broken, unwatched))
        elif broken and walk.started:
            outcomes.append(
                walk.finding("error", stop.stop, message("beam-lost", why=broken))
            )
        elif wrong is not None:
            outcomes.append(walk.finding("error", stop.stop, wrong))
            if wrong.code in BREAKS_COUNT and not broken:
                broken = wrong
            else:
                stop = msgspec.structs.replace(stop, refused=wrong.code)
        elif unwatched and walk.started:
            outcomes.append(
                walk.finding("warning", stop.stop, message("laser-unwatched", why=unwatched))
            )
        if stop.doubts and not stop.recovered:
            outcomes += _doubts(walk, stop)
        if stop.doubts and "window-step" in stop.doubt_codes:
            unwatched = unwatched or message("reading-of-pieces")
        stop = msgspec.structs.replace(stop, broken=broken, unwatched=unwatched)
        outcomes.append(stop)
        self._stops.append(stop)
        walk.advance(stop)

    def _breaks_up_to(self, time_ns: int) -> tuple[Words, Words]:
        """Return the reasons of certain and possible losses of the count since the last stop; empty
        without a loss.
        """
        seen = [
            event
            for event in self._laser.breaks[self._breaks_seen :]
            if event.time_ns <= time_ns
        ]
        breaks, self._before = (*self._before, *seen), ()
        self._breaks_seen += len(seen)
        lost, unseen = (
            [event.reason for event in breaks if event.watched is watched]
            for watched in (True, False)
        )
        return lost[-1] if lost else "", unseen[-1] if unseen else ""

    def reaches_back(self, taken: list[Taken], dwell: Dwell) -> bool:
        """Return whether the laser's count at the beginning of a dwell still has the zero of the
        earlier stops.
        """
        return not any(
            each.watched
            for each in self._breaks_before(taken[0].to_ns if taken else dwell.from_ns)
        )

    def _breaks_before(self, until_ns: float) -> list[Break]:
        return [
            *self._before,
            *(
                each
                for each in self._laser.breaks[self._breaks_seen :]
                if each.time_ns <= until_ns
            ),
        ]

    def left_over(self) -> tuple[Break, ...]:
        """Return the breaks after the last stop: they apply to the next log of the pass."""
        return (*self._before, *self._laser.breaks[self._breaks_seen :])


def _doubts(walk: Walk, stop: CapturedStop) -> list[Finding]:
    return [
        walk.finding("warning", stop.stop, why, code)
        for code in stop.doubt_codes
        if isinstance(why := stop.why(code), Message)
    ]


def _bridged_break(walk: Walk, index: int, broken: Words, unwatched: Words) -> Finding:
    """Return the remark on a break that has no effect."""
    words = (
        message("beam-lost.bridged", why=broken)
        if broken
        else message("laser-unwatched.bridged", why=unwatched)
    )
    return walk.finding("info", index, words)


def _shared_turn(walk: Walk, turn: CapturedStop, stop_count: int | None) -> CapturedStop:
    """Return the first stop of a pass that begins with the last stop of the previous pass: the same
    reading of the same moment.
    """
    place = {
        "setup": walk.route.setup,
        "outward": walk.route.outward,
        "stop": 0,
        "axis": "",
        "stop_count": stop_count,
        "order": walk.route.order,
    }
    stop = msgspec.structs.replace(turn, **place, broken="", unwatched="", turned=True)
    walk.advance(stop)
    return stop


class PositionCheck:
    """Compares positions stop by stop, and reports differences once a pass: the first, and the
    first beyond `PLACED_MM`. The machine's statement decides; the readings support it.
    """

    def __init__(self, signals: SignalMap) -> None:
        self._signals = signals
        self._reported: Severity | None = None

    def judge(self, walk: Walk, stop: int, signals: Signals) -> list[Finding]:
        """Return the finding of the commanded position at a stop; none where the register cannot
        distinguish it from the planned position.
        """
        if signals.commanded_mm is None:
            return []
        rows = zip("xyz", signals.commanded_mm, walk.route.planned_mm(stop), strict=True)
        beyond = [
            (abs(here - plan), axis, here, plan)
            for axis, here, plan in rows
            if abs(here - plan) > self._resolution_mm(axis, plan)
        ]
        worst = max(beyond, default=None)
        if worst is None:
            return []
        off_mm, axis, here, plan = worst
        severity: Severity = "info" if off_mm <= PLACED_MM else "warning"
        if self._reported in (severity, "warning"):
            return []
        self._reported = severity
        off_um = (here - plan) * 1e3
        words = message(
            "position-differs", axis=axis.upper(), at_mm=here, planned_mm=plan, off_um=off_um
        )
        return [walk.finding(severity, stop, words)]

    def _resolution_mm(self, axis: str, value_mm: float) -> float:
        spec = self._signals.get(f"{axis}_mm")
        return 0.0 if spec is None else resolution(spec, value_mm)


def plateau_window(
    stream: StreamBuffer, from_ns: float, to_ns: float, expected_mm: float, rules: StopRules
) -> Taken | None:
    """Return the laser's mean over the first plateau at the expected level between two times; None
    without one.
    """
    span = stream.span(from_ns, to_ns)
    for plateau in find_plateaus(span.time_ns, span.position_mm, rules.min_window_s):
        if agrees(plateau.level_mm - expected_mm, 0.0):
            end = plateau.to_ns - EDGE_NS
            begin = min(plateau.from_ns + rules.settle_s * 1e9, (plateau.from_ns + end) / 2)
            return take(stream.span(begin, end), begin, end, rules, stream.resolution_um)
    return None


def make_stop(
    route: Route,
    stop: int,
    signals: Signals,
    taken: Taken,
    head: StreamBuffer | None,
    wall_offset_ns: int,
) -> CapturedStop:
    """Return the stop that a window of the laser gives at a place of the route."""
    channels, u_channels = _head_means(head, taken)
    return CapturedStop(
        setup=route.setup,
        outward=route.outward,
        stop=stop,
        position_mm=signals.commanded_mm or route.planned_mm(stop),
        axis=route.axis_to(stop),
        order=route.order,
        stop_count=signals.stop_count,
        reading_mm=taken.window.mean_mm if math.isfinite(taken.window.mean_mm) else None,
        u_um=taken.window.u_um,
        scatter_um=taken.window.scatter_um,
        slope_um_s=taken.window.slope_um_s,
        samples=taken.window.used,
        rejected=taken.window.rejected,
        window_from_ns=round(taken.from_ns),
        window_to_ns=round(taken.to_ns),
        time_s=round((0.5 * (taken.from_ns + taken.to_ns) + wall_offset_ns) * 1e-9, 6),
        beam=taken.beam if math.isfinite(taken.beam) else None,
        doubts=remarks_of(taken.doubts) if taken.doubts else (),
        channels=channels,
        u_channels=u_channels,
        material_temperature_c=signals.material_temperature_c,
        air_temperature_c=signals.air_temperature_c,
        air_pressure_hpa=signals.air_pressure_hpa,
        relative_humidity_percent=signals.relative_humidity_percent,
    )


def make_head_stop(
    route: Route,
    stop: int,
    signals: Signals,
    taken: Taken,
    head: StreamBuffer,
    laser: StreamBuffer,
    wall_offset_ns: int,
) -> CapturedStop:
    """Return the stop of a window of the head; its reading is the laser's mean over the same
    window, None without a beam.
    """
    made = make_stop(route, stop, signals, taken, head, wall_offset_ns)
    seen = laser.span(taken.from_ns, taken.to_ns).position_mm
    reading = (
        float(np.mean(seen))
        if len(seen) >= LEAST_SAMPLES and np.isfinite(seen).all()
        else None
    )
    return msgspec.structs.replace(made, reading_mm=reading)


def _head_means(
    head: StreamBuffer | None, taken: Taken
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the means of the 4-DOF head's channels over the window and their standard
    uncertainties; empty without a head."""
    if head is None:
        return (), ()
    span = head.span(taken.from_ns, taken.to_ns)
    if span.channels is None or len(span.channels) < LEAST_SAMPLES:
        return (), ()
    columns = [summarise(span.time_ns * 1e-9, column) for column in span.channels.T]
    return tuple(column.mean_mm for column in columns), tuple(
        column.u_um * 1e-3 for column in columns
    )
