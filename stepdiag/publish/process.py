"""What a program that publishes gives up for the recording beside it, and how it is ended."""

import asyncio
import os
import resource
import signal

MOST_MEMORY = 2**30
"""Bytes of data, whatever comes from the network; a server of OPC UA takes 140 MB of memory."""
BEHIND = 5
"""How much it stands back (nice)."""


def stand_back() -> None:
    """Leave the processor to the recording where both want it, and memory too."""
    os.nice(BEHIND)
    allowed = [limit for limit in (MOST_MEMORY, *resource.getrlimit(resource.RLIMIT_DATA)) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min(allowed), min(allowed)))


def stopped_by_signal() -> asyncio.Event:
    """Return what SIGTERM or SIGINT sets; only within a running loop."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(name, stop.set)
    return stop
