"""From polls to dwells: the machine's standstills by its signals only.

When a poll that reports a standing machine is answered, the machine may already be moving again;
and it may have stood since just after the previous poll. The machine stood for certain only between
two times: the answer of the first poll that reports a standing machine, and the request of the last
such poll.

- A moving machine closes the open dwell.
- A machine at the same stop extends the open dwell. Without an open dwell, the poll opens a dwell.
- A machine at a new stop closes the open dwell and opens another.

A poll without an answer changes nothing: the next answer decides.

Registers may lag behind the stop signal by some polls and then show the previous stop or a position
on the way. A stop signal may flicker. A lag and a flicker both cut one standstill into several
dwells. The laser shows whether the machine moved between two dwells (`Standstills`).
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.daq.capture.noise import (
    FLICKER_NS,
    LAG_NS,
    LEAST_SAMPLES,
    MAJORITY,
    MOMENT_NS,
    PLACED_MM,
    SERIES,
    STILL_MM,
)
from stepdiag.daq.capture.standing.window import (
    BIN_NS,
    EDGE_NS,
    LEAVING_SHARE,
    Placing,
)
from stepdiag.daq.formats.signals import Signals

COUNT_MODULUS = 65536
MOST_PLACES = 256
"""Largest number of different positions stored for a standstill: enough for the median, and bounded
for a machine that stands for hours.
"""
Observation = Literal["moving", "same", "new"]
Place = tuple[float, float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Dwell:
    """A standstill by the machine's signals.

    The machine stood for certain from ``from_ns`` to ``to_ns`` (equal after a single poll); it
    cannot have stopped before ``not_before_ns`` (the request of the last moving poll). ``signals``
    contain the position that was read for the longest time.
    """

    from_ns: int
    to_ns: int
    not_before_ns: int | None
    signals: Signals


class DwellTracker:
    """Follows the polls of one log and returns each dwell when it closes; the open dwell can be
    read at any time.
    """

    def __init__(self) -> None:
        self.open: Dwell | None = None
        self._last: Dwell | None = None
        self._last_moving_ns: int | None = None
        self._held_ns: Counter[Place] = Counter()

    def poll(self, signals: Signals, send_ns: int, recv_ns: int) -> Dwell | None:
        """Process a poll; return the dwell that the poll closes, if any."""
        observation, closed = self._observe(signals), None
        if observation != "same":
            closed, self._last, self.open = self.open, self.open or self._last, None
        if observation == "moving":
            self._last_moving_ns = send_ns
        elif self.open is not None:
            self.open = self._with(self.open, signals, max(send_ns, self.open.from_ns))
        else:
            self._held_ns = Counter()
            self.open = Dwell(
                from_ns=recv_ns,
                to_ns=recv_ns,
                not_before_ns=self._last_moving_ns,
                signals=signals,
            )
        return closed

    def _with(self, dwell: Dwell, signals: Signals, to_ns: int) -> Dwell:
        """Return the open dwell extended by a poll, with the position that was read for the longest
        time, because the register may still be settling.

        The number of polls is not used, because a delayed poller may have polled often only while
        the register was settling. If the register flickers, as actual positions do, the median in
        time is used.
        """
        if len(self._held_ns) < MOST_PLACES or signals.commanded_mm in self._held_ns:
            self._held_ns[signals.commanded_mm] += to_ns - dwell.to_ns
        place = self._place(dwell.signals.commanded_mm)
        if place == dwell.signals.commanded_mm:
            return replace(dwell, to_ns=to_ns)
        if place is None or place == signals.commanded_mm:
            return replace(dwell, to_ns=to_ns, signals=signals)
        return replace(
            dwell,
            to_ns=to_ns,
            signals=replace(dwell.signals, x_mm=place[0], y_mm=place[1], z_mm=place[2]),
        )

    def _place(self, before: Place) -> Place:
        """Return the position that was read for the longest time, or the median if no position was
        read for half of the time. Of two positions with equal times the earlier is returned.
        """
        longest = max(
            self._held_ns, key=lambda place: (self._held_ns[place], place == before)
        )
        flickers = (
            None not in self._held_ns and 2 * self._held_ns[longest] < self._held_ns.total()
        )
        return _median_place(self._held_ns) if flickers else longest

    def stale(self, since_ns: int) -> None:
        """Record that the values of the polls are not newer than ``since_ns``: the open dwell is
        certain only until this time.
        """
        if self.open is not None:
            self.open = replace(
                self.open, to_ns=max(self.open.from_ns, min(self.open.to_ns, since_ns))
            )

    def _observe(self, signals: Signals) -> Observation:
        if not signals.stopped:
            return "moving"
        reference = self.open or self._last
        return "same" if reference is None or same_stop(reference.signals, signals) else "new"


def _median_place(held_ns: Mapping[Place, int]) -> Place:
    """Return, for each axis, the median of the read positions; the weight of a position is the time
    for which it was read.
    """
    places = np.array([place for place in held_ns if place is not None])
    weight = np.array(
        [ns for place, ns in held_ns.items() if place is not None], dtype=np.float64
    )
    order = np.argsort(places, axis=0)
    share = np.cumsum(weight[order], axis=0) / weight.sum()
    middle = np.argmax(share >= 0.5, axis=0)
    x_mm, y_mm, z_mm = (
        float(places[order[row, axis], axis]) for axis, row in enumerate(middle)
    )
    return x_mm, y_mm, z_mm


def same_stop(one: Signals, other: Signals) -> bool:
    """Return whether two polls belong to the same stop, by stop counter and commanded position;
    without both signals, every standstill counts as the same stop.
    """
    if one.stop_count != other.stop_count:
        return False
    if one.commanded_mm is None or other.commanded_mm is None:
        return True
    return all(
        abs(a - b) <= PLACED_MM
        for a, b in zip(one.commanded_mm, other.commanded_mm, strict=True)
    )


def count_steps(before: int, after: int) -> int:
    """Return the increase of a stop counter, across its wrap: 1 means the next stop, 0 the same
    stop; an increase of more than half the range is a decrease.
    """
    return (after - before) % COUNT_MODULUS


@dataclass(slots=True)
class _Waiting:
    """A standstill: its dwell, the end of its last part, and the length of the part whose signals
    the dwell has.
    """

    dwell: Dwell
    end_ns: int
    held_ns: int


class Standstills:
    """The standstills that wait for capture, in order; closed dwells of the same standstill are
    joined.
    """

    def __init__(self) -> None:
        self._waiting: list[_Waiting] = []
        self._taken: _Waiting | None = None

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, dwell: Dwell) -> None:
        self._waiting.append(_alone(dwell))

    def first(self) -> Dwell:
        """Return the dwell of the first waiting standstill."""
        return self._waiting[0].dwell

    def settled(self, now_ns: int, going_on: Dwell | None, placing: Placing | None) -> bool:
        """Return whether the first waiting standstill is over: another standstill has begun, or the
        machine has moved for a while.

        ``placing`` is None without a stream that shows the machine's travel, as in a run of the
        4-DOF head.
        """
        while len(self._waiting) > 1:
            following = self._waiting[1].dwell
            one = _one(self._waiting[0], following, placing)
            if one is None and now_ns - following.from_ns < LAG_NS:
                return False
            if not one:
                return True
            self._waiting[0] = _single_dwell(self._waiting[0], self._waiting.pop(1).dwell)
        if going_on is None:
            return now_ns - self._waiting[0].end_ns >= FLICKER_NS
        one = _one(self._waiting[0], going_on, placing)
        return now_ns - going_on.from_ns >= LAG_NS if one is None else not one

    def take(self) -> Dwell:
        """Return the first waiting standstill and remove it."""
        self._taken = self._waiting.pop(0)
        return self._taken.dwell

    def goes_on(self, going_on: Dwell, placing: Placing | None) -> bool:
        """Return whether a dwell continues the standstill captured last: the stop signal fell and
        rose, but the machine did not move.

        Without samples, stop counter and position decide.
        """
        if self._taken is None:
            return False
        one = _one(self._taken, going_on, placing) if placing is not None else None
        placed = (
            going_on.signals.stop_count is not None
            or going_on.signals.commanded_mm is not None
        )
        return (
            one
            if one is not None
            else placed and same_stop(self._taken.dwell.signals, going_on.signals)
        )

    def are(self, going_on: Dwell, placing: Placing | None) -> bool:
        """Return whether all waiting dwells are earlier parts of the standstill of an open
        dwell.
        """
        return all(bool(_one(each, going_on, placing)) for each in self._waiting)

    def taken_early(self, dwell: Dwell) -> None:
        """Record that a standstill was captured before its end; all waiting dwells are shorter
        parts of it.
        """
        self._waiting, self._taken = [], _alone(dwell)


def _one(before: _Waiting, after: Dwell, placing: Placing | None) -> bool | None:
    """Return whether two dwells are a single standstill: at most a short move was observed in
    between, and the laser stood still.

    The polls can miss a move if the time between two polls is longer than a step; the laser's
    samples must then be constant for the whole time. After a loss of the count in a move, an equal
    reading is no evidence of a standstill. A short dwell while the machine was still arriving is
    part of the next dwell: its position register lagged behind. None if there are too few samples.
    """
    unbroken = after.not_before_ns is None or after.not_before_ns <= before.dwell.from_ns
    soon = after.from_ns - before.end_ns < FLICKER_NS
    flicker = soon and same_stop(before.dwell.signals, after.signals)
    count = after.signals.stop_count
    if placing is None:
        return flicker and count is not None
    if (
        unbroken
        and count is not None
        and count == before.dwell.signals.stop_count
        and after.from_ns - before.dwell.from_ns < FLICKER_NS
    ):
        # The position register lags behind counter and stop signal.
        # The time between both dwells is too short for a move.
        return True
    if not unbroken and (
        not flicker
        or any(before.end_ns < each.time_ns <= after.from_ns for each in placing.breaks)
    ):
        return False
    then = _beginning_mm(after, placing)
    if len(then) < LEAST_SAMPLES:
        return None
    from_ns = before.dwell.from_ns
    if unbroken and soon and before.end_ns - from_ns < MOMENT_NS:
        begun = placing.span(from_ns - EDGE_NS, after.from_ns).position_mm[:LEAST_SAMPLES]
        if len(begun) == LEAST_SAMPLES and np.ptp(begun) > STILL_MM:
            return True
    earlier = placing.span(max(from_ns, before.end_ns - EDGE_NS), after.from_ns).position_mm
    strays = np.abs(earlier - np.median(then)) > STILL_MM
    # If no move was observed between the dwells, the first samples may be from an earlier move.
    wrong = MAJORITY if unbroken and soon else LEAVING_SHARE
    return not strays.any() or bool(strays.mean() < wrong)


def _beginning_mm(dwell: Dwell, placing: Placing) -> NDArray[np.float64]:
    """Return the last samples at the beginning of a dwell, in mm. A dwell with a single poll has
    few samples; its beginning then includes samples after the poll.
    """
    span = placing.span(dwell.from_ns, max(dwell.to_ns, dwell.from_ns + LAG_NS))
    shown, begun = np.searchsorted(
        span.time_ns,
        [max(dwell.to_ns, dwell.from_ns + BIN_NS), dwell.from_ns + EDGE_NS],
    )
    beginning: NDArray[np.float64] = span.position_mm[
        : max(LEAST_SAMPLES, min(shown, max(begun, SERIES)))
    ]
    return beginning[-SERIES:]


def _single_dwell(before: _Waiting, after: Dwell) -> _Waiting:
    """Return a single dwell for two dwells, with the signals of the longer dwell. The single dwell
    covers both dwells if no move was observed between them, otherwise only the longer dwell.
    """
    lasts_ns = after.to_ns - after.from_ns
    if after.not_before_ns is not None and after.not_before_ns > before.dwell.from_ns:
        longer = (
            after if lasts_ns >= before.dwell.to_ns - before.dwell.from_ns else before.dwell
        )
        return replace(_alone(longer), end_ns=after.to_ns)
    longest = _alone(after) if lasts_ns >= before.held_ns else before
    whole = replace(
        before.dwell,
        to_ns=after.to_ns,
        signals=longest.dwell.signals,
    )
    return _Waiting(whole, after.to_ns, longest.held_ns)


def _alone(dwell: Dwell) -> _Waiting:
    return _Waiting(dwell, dwell.to_ns, dwell.to_ns - dwell.from_ns)
