"""The polls of a Modbus master: if a busy computer delays the polls, a patient machine stands
longer.

On a real machine a dwell lasts seconds, and the recorder has a computer of its own. In a
demonstration or a test a dwell lasts half a second, and the shared computer can delay the recorder
for half a second. During a fault of the bench that hides the machine's state, the machine does not
wait.
"""

import threading
from collections import deque
from itertools import pairwise, takewhile

from stepdiag.virtual.base.faults import FaultBoard, FaultKind

BREAK_S = 0.1
"""Time in s between two polls above which the polling counts as interrupted."""
GONE_S = 1.0
"""Time in s after the last poll from which the machine no longer waits for the master."""
_REMEMBERED = 20_000
"""Number of stored polls: more than arrive in any dwell of a patient machine."""
_BLINDING: tuple[FaultKind, ...] = (
    "plc-silent",
    "plc-late",
    "plc-exception",
    "plc-frozen",
    "plc-reboot",
    "stop-flicker",
)


class Attention:
    """The times of the masters' polls in wall seconds; thread-safe."""

    def __init__(self, faults: FaultBoard) -> None:
        self._faults = faults
        self._lock = threading.Lock()
        self._looks_s: deque[float] = deque(maxlen=_REMEMBERED)

    def looked(self, wall_s: float) -> None:
        with self._lock:
            self._looks_s.append(wall_s)

    def lacking(self, from_s: float, wall_s: float, wanted_s: float) -> bool:
        """Return whether the machine must wait for the master: the master still polls, but the last
        unbroken series of its polls since ``from_s`` is shorter than ``wanted_s``.

        The duration of the series begins with its first poll and not at ``from_s``, because before
        a late first poll the master has not read the new state.
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
