"""Delay of late answers, measured on the bytes that arrive after the time-out."""

import time
from collections.abc import Callable

from stepdiag.base.messages import Words, message

TRANSACTIONS_KEPT = 64
"""Number of newest requests whose time is stored; the answer to an older request has no measured
delay.
"""


class Lateness:
    """Watches sent and received bytes. ``after_s`` is the time in s from a request to its answer,
    for the latest late answer; 0 without a late answer.

    Answers over TCP carry the number of their request (``numbered``). On a serial line an answer
    has no number. Bytes that arrive after the time-out belong to the previous request. An answer
    that arrives during the wait for a later answer is recognised by its length (`ModbusLink`).
    """

    def __init__(
        self, *, numbered: bool, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._numbered = numbered
        self._clock = clock
        self._asked_s: dict[bytes, float] = {}
        self._sent_s = self._missed_s = self._heard_s = 0.0
        self._awaited: bytes | None = None
        self.after_s = 0.0

    def trace(self, sending: bool, data: bytes) -> bytes:
        """Inspect sent or received bytes, and return the bytes unchanged."""
        now, number = self._clock(), data[:2] if self._numbered else b""
        if sending:
            self._sent_s, self._awaited = now, number
            self._asked_s.pop(number, None)
            self._asked_s[number] = now  # so the newest request is the last one of the dict
            if len(self._asked_s) > TRANSACTIONS_KEPT:
                del self._asked_s[next(iter(self._asked_s))]
        else:
            self._heard_s = now
            if number != self._awaited and number in self._asked_s:
                self.after_s = max(self.after_s, now - self._asked_s[number])
        return data

    def given_up(self) -> None:
        self._missed_s, self._awaited = self._sent_s, None

    def answered(self) -> None:
        self._awaited = None

    def was_of_an_earlier(self) -> None:
        if self._missed_s:
            self.after_s = max(self.after_s, self._heard_s - self._missed_s)

    @property
    def words(self) -> Words:
        return message("answers-late", after_s=self.after_s) if self.after_s else ""
