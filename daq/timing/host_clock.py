"""The host's clock, which gives every time stamp, and the time of day.

A stamp is CLOCK_BOOTTIME: nothing sets this clock, and unlike CLOCK_MONOTONIC this clock continues
while the computer sleeps (clock_gettime(2)). So a sleep of the computer and a stopped process leave
the same trace in a log: a time without samples. A log contains the time of day as an offset beside
the stamps, never in the stamps.
"""

import time
from dataclasses import dataclass

LOOKS = 5
"""Number of attempts to read the host's clock and the time of day together. The quickest attempt is
used, because a slow attempt was delayed between the two readings.
"""
STEP_S = 0.5
"""Least change in s of the time of day relative to the host's clock, between two readings, that
shows that the time of day was set. A time server changes the time of day by far less between two
readings.
"""


def now_ns() -> int:
    """Return the time of the host's clock in ns."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


def stamp_ns() -> int:
    """Return the time of the host's clock in ns, rounded down to whole microseconds, the precision
    of recorded arrival times.
    """
    return now_ns() // 1_000 * 1_000


def wall_offset_ns() -> int:
    """Return the time of day minus the time of the host's clock, in ns."""
    looks = [(now_ns(), time.time_ns(), now_ns()) for _ in range(LOOKS)]
    before_ns, wall_ns, after_ns = min(looks, key=lambda look: look[2] - look[0])
    return wall_ns - (before_ns + after_ns) // 2


@dataclass(frozen=True, slots=True)
class Look:
    """Changes in s between two readings of the host's clocks: the change of the time of day (0: not
    set), the time between the readings, and the sleep of the computer.
    """

    set_by_s: float
    apart_s: float
    asleep_s: float


class ClockWatch:
    def __init__(self) -> None:
        self._seen_ns = now_ns()
        self._offset_ns = wall_offset_ns()
        self._asleep_ns = _asleep_ns()

    def look(self) -> Look:
        """Return the changes since the last call."""
        seen_ns, offset_ns, asleep_ns = now_ns(), wall_offset_ns(), _asleep_ns()
        moved_s = (offset_ns - self._offset_ns) * 1e-9
        look = Look(
            moved_s if abs(moved_s) > STEP_S else 0.0,
            (seen_ns - self._seen_ns) * 1e-9,
            (asleep_ns - self._asleep_ns) * 1e-9,
        )
        self._seen_ns, self._offset_ns, self._asleep_ns = seen_ns, offset_ns, asleep_ns
        return look


def _asleep_ns() -> int:
    """Return the time in ns for which the computer has slept since its start."""
    return now_ns() - time.monotonic_ns()
