"""A publishing program gives priority and processor time to the recording, drops its own
privileges, and ends on a signal.
"""

import asyncio
import os
import resource
import signal
from pathlib import Path

import structlog

from stepdiag.walls.confine import confine_publisher, readable_by_program

MOST_MEMORY = 2**30
"""Largest memory in bytes of the process, whatever the network sends; a server of OPC UA needs 160
MB.
"""
NAMES = ("/etc", "/run/systemd/resolve")
"""Files that the process reads for host names and for the certificate authorities."""
BEHIND = 5
"""Niceness of the publishing process."""

_log = structlog.get_logger("publish")


def stand_back(folder: Path, *, calls: int = 0) -> None:
    """Give recording priority in processor and memory; then set up the walls
    (`stepdiag.walls.confine`).

    ``folder`` is the folder of the survey. ``calls`` is the port of the server that this program
    calls, 0 if it is a server itself. The journal names the walls that could not be set up.
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
    """Return an event that SIGTERM or SIGINT sets. The function works only within a running
    loop.
    """
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(name, stop.set)
    return stop
