"""Low priority of a computing process relative to the recording process. The module imports no
other module, because it must act before numpy is loaded.
"""

import os
from contextlib import suppress

from stepdiag.base.disk.system import nice

GIVE_WAY = 5
"""Increase of the nice value (nice(2)) of a computing process: below the recording, but not below
all other work of a busy computer.
"""


def lower_priority() -> None:
    """Give the recording process priority over this process, because a survey may be recorded while
    this process computes.

    The kernel lets a computing thread finish its slice of a millisecond or more, so a low priority
    is not enough: one processor is left free. The threads of numpy stay on their first processors,
    so this call must precede the import of numpy.
    """
    nice(GIVE_WAY)
    with suppress(OSError, AttributeError):
        first, *others = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, others or [first])
