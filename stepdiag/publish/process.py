"""The process of a publishing program: low priority, few rights, and its end by a signal."""

import asyncio
import os
import resource
import signal
from pathlib import Path

import structlog

from stepdiag.walls.confine import confine_publisher, readable_by_program

MOST_MEMORY = 2**30
"""Largest memory in bytes of the process, whatever the network sends; an OPC UA server needs 160
MB."""
NAMES = ("/etc", "/run/systemd/resolve")
"""Files that the process reads for host names and for the certificate authorities."""
BEHIND = 5

_log = structlog.get_logger("publish")


def stand_back(folder: Path, *, calls: int = 0) -> None:
    """Lower the priority and the memory limit of this process in favour of the recording; then set
    up the walls (`stepdiag.walls.confine`).

    ``folder`` is the folder of the survey. ``calls`` is the port of the server that this program
    calls, 0 if it is a server itself. The journal contains the walls that could not be set up.
    """
    os.nice(BEHIND)
    allowed = [
        limit
        for limit in (MOST_MEMORY, *resource.getrlimit(resource.RLIMIT_DATA))
        if limit != resource.RLIM_INFINITY
    ]
    resource.setrlimit(resource.RLIMIT_DATA, (min(allowed), min(allowed)))
    still_open = confine_publisher(
        (*readable_by_program(folder), *map(Path, NAMES)), calls=calls
    )
    _log.info("publish-confined", open=", ".join(still_open) or "nothing")


def stopped_by_signal() -> asyncio.Event:
    """Return an event that SIGTERM or SIGINT sets. The function requires a running event loop."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(name, stop.set)
    return stop
