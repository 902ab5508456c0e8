"""One cause over a whole pass: the one wrong statement of the survey file that makes the machine's stops and the laser's steps plausible.

Theory of operation
-------------------
A wrong line of the survey file spoils every stop in the same way. Judged stop by stop it gives a hundred findings, none of which names the
line. So the standstills of a pass are judged together, before any of them is reported.

Observations. Standstill i of a pass shows a setup code c, decoded positions p_i (mm, three axes, or none) and the laser's reading r_i (mm,
while its count is unbroken). The laser does not pass through the control: its steps are an independent witness of where the machine went.

Hypotheses. The pass starts at the first stop of a route (setup, direction, axis order, box); stop i has the planned position x_i and the
nominal reading n_i. A cause changes exactly one statement:

    positions    p = k x + c per axis      offset, sign, factor, permutation, diameter, a register that is not the commanded position
    laser        r_i - r_(i-1) = f (n_i - n_(i-1))          sign, optics factor, unit
    time         the laser's move begins and ends later or earlier than the signals' move: latency of the laser or of the control (both
                 edges alike), a stop bit that comes before the machine rests (the second edge alone). The steps are then those of the
                 moves at that time: a window between late signals may hold the reading of the next stop
    route        another axis order, another setup than the code states, another box. Orders that nothing tells apart, because two axes
                 make the same step, are one hypothesis with two values

Likelihood. Every coordinate scatters by `BESIDE_MM` about its hypothesis, or is an outlier with probability `OUTLIER`, spread over
`RANGE_MM`; every step of the laser likewise, by `STEP_MM` and `STEP_SHARE` of the step. A free number that is fitted to the standstills
(an offset, a length) costs ln(RANGE_MM / BESIDE_MM), which it needs to be found (Occam's factor, MacKay 2003, chapter 28); a cause costs
`CAUSE`, the prior odds against a wrong statement. "The file is right" costs nothing; at each
standstill that is not the next stop (a feed hold, a stop driven twice or not seen) it costs `SINGLE`, over the best path of stops: one odd
standstill is no cause over a whole pass, two or three that one line explains are.

Decision. From the third standstill on, a cause is named when it is e^`SURE` times as likely as the file being right and as every cause
that changes another line, and when the laser has confirmed two steps of it. Where two causes fit alike nothing is named: the next
standstill, of another axis, separates them. A pass whose steps fit the file is not judged again; after `LAST` standstills no pass is.

What a named cause explains is not raised at single stops (`EXPLAINED`). The machine's signals, not this module, name the stops: they
are named again from the logs when the file is corrected.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Message, Place, message
from stepdiag.base.names import AXES, SETUP_NUMBERS
from stepdiag.base.readings.runs import Plan
from stepdiag.base.setups import setup_of
from stepdiag.daq.capture.log_start import PassHint
from stepdiag.daq.capture.place.route import Route, agrees, route_of
from stepdiag.daq.capture.standing.dwell import Dwell
from stepdiag.daq.capture.standing.window import find_plateaus
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.stream import StreamBuffer

BESIDE_MM, RANGE_MM = 0.1, 1000.0
STEP_MM, STEP_SHARE = 0.02, 0.01
"""A step of the laser is off by settling and rounded positions, and by a mirror that leans: the cosine of a bad alignment is 1e-3."""
OUTLIER = 1e-3
CAUSE, SURE = 6.0, 7.0
"""One survey in four hundred has a certain wrong line; one name in a thousand may be wrong."""
SINGLE = 8.0
"""One standstill in three thousand is a feed hold, a stop driven twice or one that was not seen."""
MOVES = {1: 0.0, 0: SINGLE, 2: SINGLE, 3: SINGLE}
FIRST, LAST = 3, 8
FACTORS = (25.4, 1 / 25.4, 10.0, 0.1, 2.0, 0.5)
CONFIRMED = 2
FREE = math.log(RANGE_MM / BESIDE_MM)
ON_TIME = (0.0, 0.0)
EDGE_S, RANGE_S, PLATEAU_S = 0.03, 2.0, 0.1
"""An edge of a plateau is known to its bins; a machine comes to rest within the same time."""
LEAST_MOVE_MM = 1.0
LEAST_LATE_S, MOST_LATE_S = 0.08, 1.0

HELD = frozenset(
    ["unexpected-position", "wrong-laser-sign", "wrong-axis-order", "wrong-direction", "step-mismatch", "laser-reset", "no-move",
     "stop-missing", "stop-missed", "stop-lost", "stop-without-reading", "count-disagrees", "count-stuck", "unplanned-setup", "window-step",
     "stop-doubtful", "reading-differs"]
)  # fmt: skip
"""What is not raised before the third standstill: one cause may explain it."""
EXPLAINED = HELD | {
    "position-differs", "place-unknown", "between-stops", "stop-recovered", "other-side", "turned-round", "count-slip", "beam-lost"
}  # fmt: skip
"""What is not raised once a cause is named: the logs are read anew by the corrected file, which raises what is left."""

Code = Literal["unexpected-position.cause", "wrong-laser-sign.cause", "wrong-axis-order.cause", "step-mismatch.cause"]
CODES: Mapping[str, Code] = {
    "laser.sign": "wrong-laser-sign.cause",
    "volume.axis_order": "wrong-axis-order.cause",
    "laser.optics": "step-mismatch.cause",
    "laser.line.scale": "step-mismatch.cause",
    "laser.frames.scale": "step-mismatch.cause",
}
_NAMING = frozenset([*CODES.values(), "unexpected-position.cause", "unexpected-position.cause-left-out"])
Matrix = NDArray[np.float64]
Change = tuple[str, str]
"""A line of the survey file as a dotted name, and its new value."""


@dataclass(frozen=True, slots=True)
class Move:
    """A move that the laser saw: how much later than the signals it left the standstill before and came to this one, in s, and its length.

    ``u_s`` is the standard uncertainty of both times: the bins of the plateaus and the pace of the polls.
    """

    left_s: float
    came_s: float
    step_mm: float
    u_s: float

    def fits(self, late_s: tuple[float, float]) -> float:
        """Return the logarithm of the likelihood of both times where the laser is so much later than the signals."""
        off = np.array([self.left_s - late_s[0], self.came_s - late_s[1]])
        return float(np.sum(_log_likelihood(off, np.full(2, self.u_s), RANGE_S)))


@dataclass(frozen=True, slots=True)
class Stand:
    """One standstill: the signals as decoded, what the laser reads (None: nothing), and how often its count was lost until then.

    ``moves`` are those of the laser that may be the one to this standstill; none where no plateaus were seen.
    """

    signals: Signals
    reading_mm: float | None
    losses: int = 0
    moves: tuple[Move, ...] = ()

    def move(self, late_s: tuple[float, float]) -> Move | None:
        """Return the move to this standstill where the laser is so much later than the signals; None where none was seen."""
        return max(self.moves, key=lambda move: move.fits(late_s), default=None)


def moves_between(laser: StreamBuffer, before: Dwell, dwell: Dwell) -> tuple[Move, ...]:
    """Return the moves of the laser about two dwells in a row: from any plateau to any later one.

    The moments of the signals lie between two polls; those of the laser are the edges of its plateaus.
    """
    poll_ns = dwell.from_ns - (dwell.not_before_ns or dwell.from_ns)
    span = laser.span(before.from_ns - MOST_LATE_S * 1e9, math.inf)
    levels = find_plateaus(span.time_ns, span.position_mm, PLATEAU_S)
    u_s = math.hypot(EDGE_S, poll_ns * 1e-9 / math.sqrt(12))
    moves = (
        Move(
            (level.to_ns - before.to_ns - poll_ns / 2) * 1e-9, (after.from_ns - dwell.from_ns + poll_ns / 2) * 1e-9,
            after.level_mm - level.level_mm, u_s,
        )
        for number, level in enumerate(levels)
        for after in levels[number + 1 :]
    )  # fmt: skip
    return tuple(
        each for each in moves if abs(each.left_s) < MOST_LATE_S and abs(each.came_s) < MOST_LATE_S and abs(each.step_mm) > LEAST_MOVE_MM
    )


@dataclass(frozen=True, slots=True)
class Cause:
    """A hypothesis: where the machine drives, what the control shows of it, what the laser reads of it, and the lines to change.

    ``factors`` and ``shifts_mm`` map planned positions to those shown, whose axes are taken in the order ``axes``. ``free`` is the number
    of fitted numbers.
    """

    route: Route
    axes: tuple[int, ...] = (0, 1, 2)
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    shifts_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    laser: float = 1.0
    late_s: tuple[float, float] = ON_TIME
    free: int = 0
    kind: str = ""
    what: Message | None = None
    changes: tuple[Change, ...] = ()

    def shown_mm(self, count: int) -> Matrix:
        """Return what the control shows at the first standstills, shape (count, 3)."""
        stops = self.route.stops_mm[:count][:, list(self.axes)]
        shown: Matrix = stops * self.factors + self.shifts_mm
        return shown

    def steps_mm(self, count: int) -> Matrix:
        """Return the laser's steps between the first standstills, shape (count - 1,)."""
        steps: Matrix = self.laser * np.diff(self.route.nominal_mm[:count])
        return steps


@dataclass(slots=True)
class CauseFinder:
    """Follows the first standstills of a log. ``named`` are the lines that earlier logs have named: then no line is."""

    survey: Survey
    hints: Mapping[str, PassHint]
    named: tuple[str, ...] = ()
    stands: list[Stand] = field(default_factory=list)
    held: list[Finding] = field(default_factory=list)
    found: Cause | None = None
    over: bool = False
    plain: bool = False
    """Whether the file as it is fits the standstills."""

    def take(self, stand: Stand, setup: str | None, expected: int) -> list[Finding]:
        """Take the next standstill of the setup that the signals state, ``expected`` to be a certain stop.

        Return the cause's finding once it is sure, and what was held back where there is none.
        """
        if self.over:
            return []
        if self.stands and (stand.reading_mm is None or stand.losses != self.stands[-1].losses):
            self.over = True  # the beam was cut on the way: the steps before and after it are of different counts
            return self.released()
        if not self.stands and expected:
            return self.leave()
        self.stands.append(stand)
        if len(self.stands) < FIRST:
            return []
        causes = sorted(self._scored(setup), key=lambda each: -each[0])
        best, cause = causes[0] if causes else (0.0, None)
        others = [score for score, other in causes[1:] if cause is None or other.kind != cause.kind]
        sure = best - max(others, default=-math.inf) > SURE
        self.plain = cause is not None and not cause.changes and sure and self._goes_on(cause.route)
        if cause is not None and cause.changes and sure and self._confirmed(cause):
            self.found, self.over, self.held = cause, True, []
            return [] if self.named else [self._finding(cause)]  # until the named line is corrected, later passes show its consequences
        self.over = self.plain or len(self.stands) >= LAST
        return self.released() if self.over else []

    def leave(self) -> list[Finding]:
        """Judge nothing more of this pass: it shows no laser's steps, or goes on from a log that has been judged."""
        self.over, self.plain = True, not self.named
        return self.released()

    def heed(self, found: Finding) -> list[Finding]:
        """Return a finding as far as it is raised now: one that a cause may explain waits for the third standstill, or falls away."""
        if found.code not in EXPLAINED or found.severity == "info" or line_named(found):
            return [found]
        if self.found is not None or (self.named and self.over and not self.plain):
            return []
        if self.over or found.code not in HELD:
            return [found]
        self.held.append(found)
        return []

    def released(self) -> list[Finding]:
        """Return what was held back: nothing explains it. Once a line is named, only a pass that fits the file shows other faults."""
        held, self.held = self.held, []
        return held if self.plain or not self.named else []

    def _confirmed(self, cause: Cause) -> bool:
        """Tell whether the laser has confirmed enough steps, or enough moves in time, and no position contradicts."""
        shown = self._shown_mm()
        if shown is not None and np.abs(shown - cause.shown_mm(len(shown))).max() > 4 * BESIDE_MM:
            return False
        if cause.late_s != ON_TIME:
            seen = [(move, cause.late_s) for each in self.stands if (move := each.move(cause.late_s)) is not None]
            alike = [abs(move.left_s - left) < 4 * move.u_s and abs(move.came_s - came) < 4 * move.u_s for move, (left, came) in seen]
            return sum(alike) >= CONFIRMED and self._agreeing(cause) >= CONFIRMED
        return self._agreeing(cause) >= CONFIRMED

    def _goes_on(self, route: Route) -> bool:
        """Tell whether every standstill is the next stop of the route, from its first or its second on, by position and by the laser."""
        steps, shown, count = self._steps_mm(), self._shown_mm(), len(self.stands)
        for begin in (0, 1):
            places, wanted = route.stops_mm[begin : begin + count], np.diff(route.nominal_mm[begin : begin + count])
            there = len(places) == count and (shown is None or bool(np.abs(shown - places).max() <= 4 * BESIDE_MM))
            if there and bool(np.all(_agrees(steps, wanted))):
                return True
        return False

    def _agreeing(self, cause: Cause) -> int:
        """Return how many steps of the laser are those of a hypothesis."""
        wanted = cause.steps_mm(len(self.stands))
        return int(np.count_nonzero(_agrees(self._steps_mm(cause.late_s), wanted)))

    def _steps_mm(self, late_s: tuple[float, float] = ON_TIME) -> Matrix:
        """Return the laser's steps between the standstills; where it is late against the signals, those of the moves that it made then."""
        readings = [math.nan if each.reading_mm is None else each.reading_mm for each in self.stands]
        steps: Matrix = np.diff(np.array(readings))
        if late_s != ON_TIME:
            moves = [each.move(late_s) for each in self.stands[1:]]
            steps = np.array([step if move is None else move.step_mm for step, move in zip(steps, moves, strict=True)])
        return steps

    def _shown_mm(self) -> Matrix | None:
        places = [each.signals.commanded_mm for each in self.stands]
        return None if None in places else np.array(places, dtype=np.float64)

    def _scored(self, setup: str | None) -> Iterator[tuple[float, Cause]]:
        """Yield every hypothesis with the logarithm of its likelihood and prior."""
        shown, count = self._shown_mm(), len(self.stands)
        for outward in (True, False) if setup is not None else ():
            plain = Cause(self._route(setup or "", outward=outward))
            yield self._as_stated(plain.route, shown) + self._in_time(plain), plain
        for cause in self._hypotheses(setup, shown, self._steps_mm()):
            if count > len(cause.route):
                continue
            score = -CAUSE * bool(cause.changes) - FREE * cause.free
            wanted = cause.steps_mm(count)
            steps = self._steps_mm(cause.late_s)
            score += float(np.nansum(_log_likelihood(steps - wanted, STEP_MM + STEP_SHARE * np.abs(wanted))))
            if shown is not None:
                score += float(np.sum(_log_likelihood(shown - cause.shown_mm(count), np.full(shown.shape, BESIDE_MM))))
            yield score + self._in_time(cause), cause

    def _as_stated(self, route: Route, shown: Matrix | None) -> float:
        """Return the best logarithm of the likelihood of the file as it is, over the ways in which a pass goes wrong at single stops.

        A standstill is the next stop, or for `SINGLE` each the same one again, one or two further on, or no stop at all: then it lies
        anywhere on the way. Its step counts from the last standstill that is a stop.
        """
        usual_mm = STEP_MM + STEP_SHARE * float(np.median(np.abs(np.diff(route.nominal_mm))))
        alike = float(_log_likelihood(np.zeros(1), np.array([usual_mm]))[0])
        placed = 3 * float(_log_likelihood(np.zeros(1), np.array([BESIDE_MM]))[0])
        paths: dict[tuple[int, int], float] = {(-1, -1): 0.0}
        for number, stand in enumerate(self.stands):
            following: dict[tuple[int, int], float] = {}

            def reach(key: tuple[int, int], score: float, following: dict[tuple[int, int], float] = following) -> None:
                following[key] = max(following.get(key, -math.inf), score)

            for (stop, base), score in paths.items():
                nowhere = score - SINGLE - math.log(RANGE_MM)
                nowhere += 2 / 3 * placed + (alike if number else 0.0) if shown is not None else 0.0
                reach((stop, base), nowhere)
                for onward, cost in MOVES.items():
                    there = stop + onward
                    if not 0 <= there < len(route):
                        continue
                    turned = stop == -1 and there == 1  # the machine turned at its first stop, which the pass before holds
                    found = score - (1.0 if turned else cost)
                    if shown is not None:
                        found += float(np.sum(_log_likelihood(shown[number] - route.stops_mm[there], np.full(3, BESIDE_MM))))
                    before = self.stands[base].reading_mm if base >= 0 else None
                    if before is not None and stand.reading_mm is not None:
                        wanted = route.step_mm(stop, there)
                        off = np.array([stand.reading_mm - before - wanted])
                        found += float(_log_likelihood(off, np.array([STEP_MM + STEP_SHARE * abs(wanted)]))[0])
                    elif number:
                        found += alike
                    reach((there, number), found)
            paths = following
        return max(paths.values())

    def _in_time(self, cause: Cause) -> float:
        """Return the logarithm of the likelihood of the edges of the moves."""
        return sum(move.fits(cause.late_s) for each in self.stands if (move := each.move(cause.late_s)) is not None)

    def _hypotheses(self, setup: str | None, shown: Matrix | None, steps: Matrix) -> Iterator[Cause]:
        if setup is not None:
            route = self._route(setup)
            yield from self._laser_causes(route)
            yield from self._time_causes(route)
            if setup_of(setup).is_diagonal:
                yield from self._order_causes(setup, shown)
            yield from self._box_causes(setup, shown, steps)
            if shown is not None:
                yield from self._map_causes(route, shown)
        if self.stands[0].signals.setup is not None and shown is not None:
            yield from self._code_causes(setup)

    def _laser_causes(self, route: Route) -> Iterator[Cause]:
        laser = self.survey.laser
        yield Cause(route, laser=-1.0, kind="laser.sign", what=message("cause-laser-sign"), changes=(("laser.sign", f"{-laser.sign}"),))
        wanted, seen = np.diff(route.nominal_mm[: len(self.stands)]), self._steps_mm()[: len(route) - 1]
        fitted = float(f"{np.nansum(seen * wanted) / np.sum(wanted**2):.4g}")
        for factor in dict.fromkeys((*FACTORS, 4.0, 0.25, fitted)):
            free = int(factor == fitted and factor not in FACTORS)
            yield Cause(route, laser=factor, free=free, kind="laser.factor", what=message("cause-laser-factor", factor=factor),
                        changes=(laser_change(self.survey, factor),))  # fmt: skip

    def _time_causes(self, route: Route) -> Iterator[Cause]:
        """Yield a laser or a control that is late, and a stop bit that is early, by as much as any move shows."""
        laser_s, plc_s, settle_s = self.survey.laser.latency_s, self.survey.plc.latency_s, self.survey.stop.settle_s
        for both in self._seen_s(lambda move: 0.5 * (move.left_s + move.came_s), lambda move: move.left_s - move.came_s):
            if both > 0:
                what, change = message("cause-laser-late", late_s=both), ("laser.latency_s", f"{laser_s + both:.2f}")
            else:
                what, change = message("cause-plc-late", late_s=-both), ("plc.latency_s", f"{plc_s - both:.2f}")
            yield Cause(route, late_s=(both, both), free=1, kind=change[0], what=what, changes=(change,))
        for came in self._seen_s(lambda move: move.came_s, lambda move: move.left_s):
            if came > 0:
                yield Cause(route, late_s=(0.0, came), free=1, kind="bit early", what=message("cause-bit-early", early_s=came),
                            changes=(("stop.settle_s", f"{settle_s + came:.2f}"),))  # fmt: skip

    def _seen_s(self, late_s: Callable[[Move], float], off_s: Callable[[Move], float]) -> list[float]:
        """Return by how much moves are late, each value once: the mean of those that agree; ``off_s`` is zero where a move is so late."""
        seen = sorted(
            late_s(move) for each in self.stands for move in each.moves
            if abs(off_s(move)) < 4 * move.u_s and abs(late_s(move)) > LEAST_LATE_S
        )  # fmt: skip
        groups: list[list[float]] = []
        for value in seen:
            if groups and value - groups[-1][-1] < EDGE_S:
                groups[-1].append(value)
            else:
                groups.append([value])
        return [round(float(np.median(group)), 2) for group in groups if len(group) >= CONFIRMED]

    def _order_causes(self, setup: str, shown: Matrix | None) -> Iterator[Cause]:
        """Yield every other order of the axes; those that nothing tells apart, because two axes make the same step, as one."""
        alike: dict[bytes, tuple[list[str], Route]] = {}
        for order in map("".join, permutations(AXES)):
            route = self._route(setup, replace(self.survey.planned, axis_order=order))
            seen = route.nominal_mm if shown is None else route.stops_mm
            alike.setdefault(np.round(seen, 3).tobytes(), ([], route))[0].append(order)
        for orders, route in alike.values():
            if self.survey.axis_order not in orders:
                value = " or ".join(f'"{order}"' for order in orders)
                yield Cause(route, kind=f"order {value}", what=message("cause-axis-order", orders=orders),
                            changes=(("volume.axis_order", value),))  # fmt: skip

    def _box_causes(self, setup: str, shown: Matrix | None, steps: Matrix) -> Iterator[Cause]:
        """Yield a box with another length of one axis, as the positions show it, else as the steps do."""
        for axis in range(3):
            for length_mm in self._lengths_mm(axis, shown, steps, setup):
                plan = _resized(self.survey.planned, axis, length_mm)
                route = self._route(setup, plan)
                yield Cause(route, free=1, kind=f"box {axis}", what=message("cause-box", axis=AXES[axis].upper(), length_mm=length_mm),
                            changes=(("volume.size_mm", str([round(value, 4) for value in plan.volume.size_mm])),))  # fmt: skip

    def _lengths_mm(self, axis: int, shown: Matrix | None, steps: Matrix, setup: str) -> list[float]:
        increments, size = self.survey.volume.increments, self.survey.volume.size_mm[axis]
        if shown is not None:
            moved = float(np.max(np.abs(np.diff(shown[:, axis])), initial=0.0)) * increments
            lengths = [moved, float(np.max(np.abs(shown[:, axis] - self.survey.volume.origin_mm[axis])))]
        else:
            lengths = [self._length_by_laser(setup, axis, steps)]
        return [round(each, 3) for each in lengths if each > 1.0 and abs(each - size) > BESIDE_MM]

    def _length_by_laser(self, setup: str, axis: int, steps: Matrix) -> float:
        """Return the length of one axis at which the steps fit best, in mm: on a grid, then between its neighbours."""
        plan, count = self.survey.planned, len(steps) + 1

        def misfit(length_mm: float) -> float:
            route = self._route(setup, _resized(plan, axis, length_mm))
            return float(np.nansum((steps - np.diff(route.nominal_mm[:count])) ** 2)) if len(route) >= count else math.inf

        low, high = 0.2 * plan.volume.size_mm[axis], 4.0 * plan.volume.size_mm[axis]
        for _ in range(6):
            grid = np.linspace(low, high, 25)
            best = int(np.argmin([misfit(float(each)) for each in grid]))
            low, high = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, 24)])
        return 0.5 * (low + high)

    def _route(self, setup: str, plan: Plan | None = None, *, outward: bool = True) -> Route:
        """Return the route of the next pass of a setup, of the survey's plan or of another."""
        out, back = self.hints[setup].numbers if setup in self.hints else (1, 2)
        return route_of(plan or self.survey.planned, setup, out if outward else back)

    def _map_causes(self, route: Route, shown: Matrix) -> Iterator[Cause]:
        """Yield every map of positions on the route that the file states."""
        first = shown[0]
        start = route.stops_mm[0]
        for axis in range(3):
            moved = float(first[axis] - start[axis])
            yield self._mapped(route, "offset", [axis], shifts={axis: moved}, free=1)
            turned = float(first[axis] + start[axis])
            yield self._mapped(route, "sign", [axis], factors={axis: -1.0})
            yield self._mapped(route, "sign-offset", [axis], factors={axis: -1.0}, shifts={axis: turned}, free=1)
            for factor in FACTORS:
                yield self._mapped(route, "factor", [axis], factors={axis: factor})
        yield self._mapped(route, "offset", [0, 1, 2], shifts=dict(enumerate((first - start).tolist())), free=3)
        for factor in (*FACTORS, -1.0):
            yield self._mapped(route, "factor", [0, 1, 2], factors=dict.fromkeys(range(3), factor))
        for axes in permutations(range(3)):
            if axes != (0, 1, 2):
                yield self._permuted(route, axes)
        if np.ptp(shown, axis=0).max() <= BESIDE_MM:
            lines = tuple((f"plc.signals.{axis}_mm", "") for axis in AXES)
            yield Cause(route, factors=(0.0, 0.0, 0.0), shifts_mm=tuple(first.tolist()), kind="standing",
                        free=0 if np.abs(first).max() <= BESIDE_MM else 3, what=message("cause-not-commanded"), changes=lines)  # fmt: skip

    def _mapped(
        self, route: Route, key: str, axes: Sequence[int], *, factors: dict[int, float] | None = None,
        shifts: dict[int, float] | None = None, free: int = 0
    ) -> Cause:  # fmt: skip
        k = np.array([(factors or {}).get(axis, 1.0) for axis in range(3)])
        c = np.array([(shifts or {}).get(axis, 0.0) for axis in range(3)])
        changes: list[Change] = []
        for axis in axes:
            spec = self.survey.plc.signals.get(f"{AXES[axis]}_mm")
            if spec is None:
                continue
            name = f"plc.signals.{AXES[axis]}_mm"
            if k[axis] != 1.0:
                changes.append((f"{name}.scale", f"{spec.scale / k[axis]:.9g}"))
            if abs(c[axis]) > BESIDE_MM:
                changes.append((f"{name}.offset", f"{round((spec.offset - c[axis]) / k[axis], 4):.9g}"))
        named = ", ".join(AXES[axis].upper() for axis in axes)
        what = message("cause-map", axes=named, factor=float(k[axes[0]]), shift_mm=float(c[axes[0]]))
        return Cause(route, factors=tuple(k.tolist()), shifts_mm=tuple(c.tolist()), free=free, kind=f"{key} {named}",
                     what=what, changes=tuple(changes))  # fmt: skip

    def _permuted(self, route: Route, axes: tuple[int, ...]) -> Cause:
        specs = [self.survey.plc.signals.get(f"{axis}_mm") for axis in AXES]
        changes = tuple(
            (f"plc.signals.{AXES[shows]}_mm.address", str(spec.address))
            for at, shows in enumerate(axes)
            if at != shows and (spec := specs[at]) is not None
        )
        shows = "".join(AXES[axis].upper() for axis in axes)
        return Cause(route, axes=axes, kind=f"permuted {axes}", what=message("cause-permuted", shows=shows), changes=changes)

    def _code_causes(self, setup: str | None) -> Iterator[Cause]:
        """Yield every other setup of the plan: the machine drives it, the code states another one."""
        code = self.stands[0].signals.setup
        for name in self.hints:
            number = next((number for number, base in SETUP_NUMBERS.items() if base == setup_of(name).base), None)
            if name == setup or number is None or code is None or setup_of(name).is_fourdof:
                continue
            route = self._route(name)
            what = message("cause-setup-code", code=code, stated=setup or message("unknown-setup"), driven=name)
            yield Cause(route, kind=f"setup {name}", what=what, changes=(("plc.signals.setup.offset", str(number - code)),))

    def _finding(self, cause: Cause) -> Finding:
        (line, value), *others = cause.changes
        more = [f"{name} = {to}" if to else name for name, to in others]
        what, stops = cause.what or "", len(self.stands)
        code = CODES.get(line, "unexpected-position.cause")
        if code == "unexpected-position.cause" and not value:
            words = message("unexpected-position.cause-left-out", what=what, stops=stops, line=line, others=more)
        else:
            words = message(code, what=what, stops=stops, line=line, value="; ".join([value, *more]))
        return finding("error", words, Place(setup=cause.route.setup))


def line_named(found: Finding) -> str:
    """Return the line of the survey file that a finding names as the one cause; empty for another finding."""
    named = found.message is not None and found.message.key in _NAMING
    return str(found.message.arguments["line"]) if named and found.message is not None else ""


def _agrees(steps: Matrix, wanted: Matrix) -> NDArray[np.bool_]:
    """Tell which steps are those wanted, by the measure of a single step (`place.route.agrees`)."""
    return np.array([agrees(step, nominal) for step, nominal in zip(steps.tolist(), wanted.tolist(), strict=True)])


def _log_likelihood(off: Matrix, scatter: Matrix, within: float = RANGE_MM) -> Matrix:
    """Return the logarithm of the density of residuals: a normal one, or an outlier anywhere in the range; NaN where unknown."""
    normal = np.exp(-0.5 * (off / scatter) ** 2) / (scatter * math.sqrt(2 * math.pi))
    density: Matrix = np.log((1 - OUTLIER) * normal + OUTLIER / within)
    return density


def laser_change(survey: Survey, factor: float) -> Change:
    """Return the line that makes the laser read ``1 / factor`` times as much."""
    laser = survey.laser
    if laser.format == "line" and laser.line is not None:
        return "laser.line.scale", f"{laser.line.scale / factor:.9g}"
    if laser.format == "frames" and laser.frames is not None:
        return "laser.frames.scale", f"{laser.frames.scale / factor:.9g}"
    if (optics := laser.optics * factor) in (1, 2, 4):
        return "laser.optics", f"{optics:g}"
    return "laser.wavelength_nm", f"{laser.wavelength_nm / factor:.7g}"


def _resized(plan: Plan, axis: int, length_mm: float) -> Plan:
    """Return the plan with another length of one axis of its box."""
    x_mm, y_mm, z_mm = (length_mm if each == axis else value for each, value in enumerate(plan.volume.size_mm))
    return replace(plan, volume=replace(plan.volume, size_mm=(x_mm, y_mm, z_mm)))
