"""The handshake: the answer to the machine that a stop is captured, and the alarm for a machine
that waits too long.
"""

from collections.abc import Callable

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.formats.signals import Signals

LEAST_PATIENCE_S = 1.0
"""Least time in s before an answer is repeated: a stop needs its window and a few polls, even if
the dwell of the plan is shorter.
"""
MOST_TIMES = 3
"""Number of unread answers after which a finding reports a machine that has never moved after an
answer.
"""


class Handshake:
    """Compares ``stop_count`` with ``captured``. A machine that waits longer than a dwell gets the
    answer again, or a finding reports the machine.

    ``tell`` writes a stop count to the machine. ``owed`` is the count of the last stop in the logs,
    because an earlier daemon may have ended before it wrote this count. ``alarm`` is the message
    about a machine that waits too long; empty otherwise.
    """

    def __init__(self, tell: Callable[[int], None], owed: int | None, dwell_s: float) -> None:
        self._tell = tell
        self._written = owed
        self._written_ns: int | None = None
        self._patience_ns = int(max(dwell_s, LEAST_PATIENCE_S) * 1e9)
        self._waits_at: int | None = None
        self._since_ns = 0
        self._written_times = 0
        self._worked = False
        self._refused: Words = ""
        self.alarm: Words = ""

    def captured(self, stop: CapturedStop) -> None:
        """Process a captured stop. A recovered stop has no answer, because the machine has
        left it.
        """
        if stop.stop_count is not None and not stop.recovered:
            self._written, self._written_ns = stop.stop_count, self._since_ns
            self._tell(stop.stop_count)

    def let_go(self, signals: Signals | None, owed: int | None, now_ns: int) -> None:
        """Answer a machine whose program continues after its survey is complete. The machine waits
        at each stop although no pass needs the stop. The stop count ``owed`` is not answered here,
        because this answer follows when the stop is safe in the log.
        """
        count = signals.stop_count if signals is not None and _waits(signals) else None
        if count is not None and count not in (self._written, owed):
            self._written, self._written_ns = count, now_ns
            self._tell(count)

    def written(self, refused: Words) -> Finding | None:
        """Record why the machine refused a written value (empty: accepted); return the finding of
        the first refusal.
        """
        before, self._refused = self._refused, refused
        if not refused or before:
            return None
        text = message("handshake-waits.refused", why=refused)
        return finding("error", text)

    def look(
        self, signals: Signals | None, now_ns: int, waits_for: Callable[[], Words]
    ) -> Finding | None:
        """Process a poll: write an unread answer again, and return the finding about a machine that
        waits too long.
        """
        count = signals.stop_count if signals is not None and _waits(signals) else None
        if count != self._waits_at:
            self._worked = self._worked or (
                self._waits_at is not None and self._waits_at == self._written
            )
            self._waits_at, self._since_ns, self._written_times, self.alarm = (
                count,
                now_ns,
                0,
                "",
            )
        if count is None:
            return None
        if count == self._written:
            self._tell_again(count, now_ns)
        if self.alarm or not self._in_vain(count, now_ns):
            return None
        self.alarm = waits = self._in_words(count, now_ns, waits_for())
        return finding("error", waits)

    def _tell_again(self, count: int, now_ns: int) -> None:
        """Answer a machine that still stands, because the PLC may have restarted, or the last
        daemon may have ended before its answer.
        """
        if self._written_ns is None or now_ns - self._written_ns > self._patience_ns:
            self._written_ns = now_ns
            self._written_times += 1
            self._tell(count)

    def _in_vain(self, count: int, now_ns: int) -> bool:
        """Return whether the machine waits too long: the answer cannot be written, or the machine
        does not read the answer. A machine that has read an earlier answer may stand still for
        another reason.
        """
        if count == self._written:
            return bool(self._refused) or (
                not self._worked and self._written_times >= MOST_TIMES
            )
        return now_ns - self._since_ns > self._patience_ns

    def _in_words(self, count: int, now_ns: int, waits_for: Words) -> Message:
        waited_s, written = (
            (now_ns - self._since_ns) * 1e-9,
            message("nothing") if self._written is None else str(self._written),
        )
        if self._refused:
            return message(
                "handshake-waits.not-taken",
                waited_s=waited_s,
                count=count,
                written=written,
                why=self._refused,
            )
        if count == self._written:
            return message(
                "handshake-waits.elsewhere", waited_s=waited_s, count=count, written=written
            )
        return message(
            "handshake-waits", waited_s=waited_s, count=count, written=written, why=waits_for
        )


def _waits(signals: Signals) -> bool:
    return (
        bool(signals.stopped) and signals.stop_count is not None and not signals.program_over
    )
