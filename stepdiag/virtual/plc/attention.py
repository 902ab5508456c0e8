"""Attention of a master to the PLC: a machine beside a busy computer stands a little longer, if its
program requests this.

A real machine's dwells are seconds and its recorder has a computer to itself. In a demonstration or
a test a dwell is half a second, and all processes share a computer that may delay the recorder for
as long. An event hidden by a fault of the bench is not waited for.
"""

import threading
from collections import deque
from itertools import pairwise, takewhile

from stepdiag.virtual.base.faults import FaultBoard, FaultKind

BREAK_S = 0.1
"""Time between two polls above which there is a break between them."""
GONE_S = 1.0
"""Time after which an absent master is no longer waited for."""
_REMEMBERED = 20_000
"""Number of stored polls: more than any dwell of a patient machine has."""
_BLINDING: tuple[FaultKind, ...] = (
    "plc-silent",
    "plc-late",
    "plc-exception",
    "plc-frozen",
    "plc-reboot",
    "stop-flicker",
)


class Attention:
    """The polls of the masters, in wall seconds. Safe to use from several threads."""

    def __init__(self, faults: FaultBoard) -> None:
        self._faults = faults
        self._lock = threading.Lock()
        self._looks_s: deque[float] = deque(maxlen=_REMEMBERED)

    def looked(self, wall_s: float) -> None:
        """Record the arrival of a request."""
        with self._lock:
            self._looks_s.append(wall_s)

    def lacking(self, from_s: float, wall_s: float, wanted_s: float) -> bool:
        """Return whether a present master has not yet polled, for ``wanted_s`` without a break, the
        state that began at ``from_s``.

        The time counts from the first look at the state, not from its beginning: a single late look
        has seen nothing of the time before.
        """
        with self._lock:
            there = bool(self._looks_s) and wall_s - self._looks_s[-1] < GONE_S
            looks_s = (
                [*takewhile(lambda each: each >= from_s, reversed(self._looks_s))][::-1]
                if there
                else []
            )
        anew = [later for before, later in pairwise(looks_s) if later - before > BREAK_S]
        first_s = [*looks_s[:1], *anew][-1:]
        seen_s = looks_s[-1] - first_s[0] if looks_s else 0.0
        return there and seen_s < wanted_s and not self._blinded(from_s, wall_s)

    def _blinded(self, from_s: float, wall_s: float) -> bool:
        spans = (span for kind in _BLINDING for span in self._faults.spans(kind))
        return any(start_s <= wall_s and end_s >= from_s for start_s, end_s in spans)
