"""Low priority of a computing process beside the recording process. Loads nothing: it must be
called before numpy is.
"""

import os
from contextlib import suppress

from stepdiag.base.disk.system import nice

GIVE_WAY = 5
"""By how much (nice(2)) a computing process stands back: behind the recording, but not behind
everything else that a busy box does."""


def lower_priority() -> None:
    """Let the recording process go first: another survey may be under way while this process
    computes.

    A kernel lets a computing thread finish its slice of a millisecond or more whatever else wakes
    up, so being less important is not enough: one processor is left alone. numpy's threads stay
    where they were born, so this comes before it is loaded.
    """
    nice(GIVE_WAY)
    with suppress(OSError, AttributeError):
        first, *others = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, others or [first])
