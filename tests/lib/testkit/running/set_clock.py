"""``python set_clock.py FILE run survey.toml``: stepdiag in a process whose time of day is off by
the seconds in FILE.

Everything else is as it is: the host's own clock, the sockets, the lines. Setting the machine's
clock would hit everything that runs on it.
"""

import datetime as dt
import sys
import time
from pathlib import Path

sys.path.pop(0)  # this folder, whose names are no modules
OFF_BY = Path(sys.argv.pop(1))
true_ns, true_clock_ns = time.time_ns, time.clock_gettime_ns


def wrong_ns():
    """Return the time of day as this process is to see it."""
    return true_ns() + int(OFF_BY.read_text()) * 10**9


class WrongTime(dt.datetime):
    @classmethod
    def now(cls, tz=None):
        return cls.fromtimestamp(wrong_ns() * 1e-9, tz)


time.time_ns = wrong_ns
time.time = lambda: wrong_ns() * 1e-9
time.clock_gettime_ns = lambda clock: (
    wrong_ns() if clock == time.CLOCK_REALTIME else true_clock_ns(clock)
)
time.clock_gettime = lambda clock: time.clock_gettime_ns(clock) * 1e-9
dt.datetime = WrongTime

from stepdiag.cli.app import main  # noqa: E402 - what it imports is to see the wrong time

main()
