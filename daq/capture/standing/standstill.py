"""From dwells to standstills: what Modbus shows in parts the laser knows to be one.

Registers may lag behind the stop signal by some polls, and show the stop before or a place on the way; a stop signal may flicker. Both
cut one standstill into several dwells. Whether the machine moved in between the laser says.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.daq.capture.standing.certain_window import Placing
from stepdiag.daq.capture.standing.dwell import FLICKER_NS, STILL_MM, Dwell, same_stop

STRAYS = 0.1
"""So large a share of the samples between two dwells may be wrong, and the machine stood all the same."""
MOST = 0.5
"""Where no move was seen between two dwells, most of the samples of the first tell; its very first ones may still be of the move."""
LEAST_SAMPLES = 3
RECENT = 9
RECENT_MS = 50
"""The end of one dwell and the beginning of the next are compared, and all between them. The newest samples of the next may be of the move
that follows: a stop signal is as old as the PLC's scan."""
LEAST_MS = 20
"""A dwell that a single poll saw is looked at for so long, or for as many samples as tell."""
SAMPLES_MS = 500
"""How long the samples of a dwell that has just begun are waited for."""
MS = 1_000_000


@dataclass(slots=True)
class _Waiting:
    """A standstill: the dwell that it became, the end of its last part, and how long the part lasts that tells its signals."""

    dwell: Dwell
    end_ns: int
    held_ns: int


class Standstills:
    """The closed dwells that wait to be taken, in order; those that are one standstill are joined."""

    def __init__(self) -> None:
        self._waiting: list[_Waiting] = []
        self._taken: _Waiting | None = None

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, dwell: Dwell) -> None:
        """Take a dwell that was closed."""
        self._waiting.append(_alone(dwell))

    def first(self) -> Dwell:
        """Return the dwell that waits longest."""
        return self._waiting[0].dwell

    def settled(self, now_ns: int, going_on: Dwell | None, placing: Placing | None) -> bool:
        """Tell whether the first standstill is over: another one has begun, or the machine has moved for a while.

        ``placing`` is None where no stream tells whether the machine moved: a 4-DOF head does not see its travel.
        """
        while len(self._waiting) > 1:
            following = self._waiting[1].dwell
            one = _one(self._waiting[0], following, placing)
            if one is None and now_ns - following.from_ns < SAMPLES_MS * MS:
                return False
            if not one:
                return True
            self._waiting[0] = _joined(self._waiting[0], self._waiting.pop(1).dwell)
        if going_on is None:
            return now_ns - self._waiting[0].end_ns >= FLICKER_NS
        one = _one(self._waiting[0], going_on, placing)
        return now_ns - going_on.from_ns >= SAMPLES_MS * MS if one is None else not one

    def take(self) -> Dwell:
        """Return the first standstill, which waits no longer."""
        self._taken = self._waiting.pop(0)
        return self._taken.dwell

    def goes_on(self, going_on: Dwell, placing: Placing | None) -> bool:
        """Tell whether a dwell is the standstill that was taken last once more: the stop signal fell and rose, the machine did not move.

        Where no samples tell, counter and position do.
        """
        if self._taken is None:
            return False
        one = _one(self._taken, going_on, placing) if placing is not None else None
        placed = going_on.signals.stop_count is not None or going_on.signals.commanded_mm is not None
        return one if one is not None else placed and same_stop(self._taken.dwell.signals, going_on.signals)

    def are(self, going_on: Dwell, placing: Placing | None) -> bool:
        """Tell whether all that wait are earlier parts of the dwell that goes on."""
        return all(bool(_one(each, going_on, placing)) for each in self._waiting)

    def taken_early(self, dwell: Dwell) -> None:
        """Take note that a standstill was taken while it lasts; all that wait are shorter parts of it."""
        self._waiting, self._taken = [], _alone(dwell)


def _one(before: _Waiting, after: Dwell, placing: Placing | None) -> bool | None:
    """Tell whether two dwells are one standstill: no move was seen between them, or but for a moment, and the laser stood still.

    Where nobody looked for longer than a step takes, no move was seen because none could be: there the laser must have stood all the time.
    A count that was lost meanwhile may read the same after a move. None while there are too few samples to tell.
    """
    unbroken = after.not_before_ns is None or after.not_before_ns <= before.dwell.from_ns
    soon = after.from_ns - before.end_ns < FLICKER_NS
    flicker = soon and same_stop(before.dwell.signals, after.signals)
    if placing is None:
        return flicker and after.signals.stop_count is not None
    if not unbroken and (not flicker or any(before.end_ns < each.time_ns <= after.from_ns for each in placing.breaks)):
        return False
    then = _beginning_mm(after, placing)
    if len(then) < LEAST_SAMPLES:
        return None
    earlier = placing.span(max(before.dwell.from_ns, before.end_ns - RECENT_MS * MS), after.from_ns).position_mm
    strays = np.abs(earlier - np.median(then)) > STILL_MM
    return not strays.any() or bool(strays.mean() < (MOST if unbroken and soon else STRAYS))


def _beginning_mm(dwell: Dwell, placing: Placing) -> NDArray[np.float64]:
    """Return the last of the samples with which a dwell begins, in mm: of those that show it, or of the few that follow."""
    span = placing.span(dwell.from_ns, max(dwell.to_ns, dwell.from_ns + SAMPLES_MS * MS))
    shown, begun = np.searchsorted(span.time_ns, [max(dwell.to_ns, dwell.from_ns + LEAST_MS * MS), dwell.from_ns + RECENT_MS * MS])
    beginning: NDArray[np.float64] = span.position_mm[: max(LEAST_SAMPLES, min(shown, max(begun, RECENT)))]
    return beginning[-RECENT:]


def _joined(before: _Waiting, after: Dwell) -> _Waiting:
    """Return two dwells as one: all of both where no move was seen, else the longer part; the signals are those read longest."""
    lasts_ns = after.to_ns - after.from_ns
    if after.not_before_ns is not None and after.not_before_ns > before.dwell.from_ns:
        longer = after if lasts_ns >= before.dwell.to_ns - before.dwell.from_ns else before.dwell
        return replace(_alone(longer), end_ns=after.to_ns)
    longest = _alone(after) if lasts_ns >= before.held_ns else before
    whole = replace(before.dwell, to_ns=after.to_ns, signals=longest.dwell.signals, blind=before.dwell.blind or after.blind)
    return _Waiting(whole, after.to_ns, longest.held_ns)


def _alone(dwell: Dwell) -> _Waiting:
    return _Waiting(dwell, dwell.to_ns, dwell.to_ns - dwell.from_ns)
