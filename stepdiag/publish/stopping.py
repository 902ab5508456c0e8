"""How a program that publishes is ended."""

import asyncio
import signal


def stopped_by_signal() -> asyncio.Event:
    """Return what SIGTERM or SIGINT sets; only within a running loop."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(name, stop.set)
    return stop
