"""Privileges and processor share that a publishing program gives up for the recording beside it,
its walls, and its end.
"""

import asyncio
import os
import resource
import signal
from pathlib import Path

import structlog

from stepdiag.walls.confine import confine_publisher, readable_by_program

MOST_MEMORY = 2**30
"""Bytes of data, whatever comes from the network; a server of OPC UA takes 160 MB of memory."""
NAMES = ("/etc", "/run/systemd/resolve")
"""Files for the names of hosts, and the authorities of certificates."""
BEHIND = 5
"""Niceness of the publishing process."""

_log = structlog.get_logger("publish")


def stand_back(folder: Path, *, calls: int = 0) -> None:
    """Leave the processor to the recording if both need it, and memory too; then set up the walls
    (`stepdiag.walls.confine`).

    ``folder`` is the survey's; ``calls`` is the port of the called server, 0 for a server of its
    own. Open parts of the walls stand in the journal.
    """
    os.nice(BEHIND)
    allowed = [
        limit
        for limit in (MOST_MEMORY, *resource.getrlimit(resource.RLIMIT_DATA))
        if limit != resource.RLIM_INFINITY
    ]
    resource.setrlimit(resource.RLIMIT_DATA, (min(allowed), min(allowed)))
    still_open = confine_publisher((*readable_by_program(folder), *map(Path, NAMES)), calls=calls)
    _log.info("publish-confined", open=", ".join(still_open) or "nothing")


def stopped_by_signal() -> asyncio.Event:
    """Return what SIGTERM or SIGINT sets; only within a running loop."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(name, stop.set)
    return stop
