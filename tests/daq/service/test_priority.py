"""A computing process stands back for the one that records."""

import os
import subprocess
import sys

from stepdiag.daq.service.priority import GIVE_WAY

LAST = 19
"""The last place there is (nice(2))."""

STANDS_BACK = """
import os
from pathlib import Path
from stepdiag.daq.service.priority import lower_priority
lower_priority()
import numpy as np
np.ones((500, 500)) @ np.ones((500, 500))
allowed = set()
for thread in Path("/proc/self/task").iterdir():
    allowed |= os.sched_getaffinity(int(thread.name))
print(os.nice(0), *sorted(allowed))
"""


def test_one_processor_is_left_alone_by_every_thread():
    """numpy starts threads of its own as soon as it is loaded; on a box of two processors they
    would take both."""
    done = subprocess.run(
        [sys.executable, "-c", STANDS_BACK],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    niceness, *processors = map(int, done.stdout.split())
    assert niceness == min(os.nice(0) + GIVE_WAY, LAST)
    first, *others = sorted(os.sched_getaffinity(0))
    assert set(processors) == set(others or [first])
