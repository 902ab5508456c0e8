"""A thread that works on a serial port, and its supervision by the event loop."""

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from stepdiag.base.messages import Message, message
from stepdiag.daq.links.ports.device import LossKind, SerialSettings
from stepdiag.daq.links.ports.port import OpenPort
from stepdiag.daq.links.reconnect import Report

SILENT_AFTER_S = 2.0
"""Time in s without a byte after which a line counts as silent."""
_WATCH_S = 0.25
_END_TIMEOUT_S = 2.0
"""Longest wait in s for a thread that hangs in the kernel; after this time the daemon thread is
abandoned.
"""
EVERY_S = 60.0
"""Least time in s between two reports of a line with steady losses; a report contains all losses
since the previous report.
"""


_T = TypeVar("_T")


class Losses:
    """The losses of a line since the last report. The line counts its losses since its opening."""

    def __init__(self) -> None:
        self._reported: dict[LossKind, int] = {}
        self._rests_until_s = 0.0

    def news(self, counted: Mapping[LossKind, int], now_s: float) -> tuple[Message, ...]:
        """Return the losses since the last report: the first losses at once, later losses at most
        every `EVERY_S`.

        ``counted`` is the number of losses of each kind since the opening of the line.
        """
        more = {
            kind: count - self._reported.get(kind, 0)
            for kind, count in counted.items()
            if count > self._reported.get(kind, 0)
        }
        if not more or now_s < self._rests_until_s:
            return ()
        self._reported |= counted
        self._rests_until_s = now_s + EVERY_S
        return tuple(message(kind, count=count) for kind, count in more.items())


class PortThread:
    """Opens a port, works on it and closes it, all in a separate thread. Each object runs once.

    The thread cannot end unnoticed: when ``work`` ends, ``serve`` ends with the same exception.
    """

    def __init__(self, settings: SerialSettings, work: Callable[[OpenPort], None]) -> None:
        self._settings = settings
        self._work = work
        self._unwanted = threading.Event()
        self._loop = asyncio.get_running_loop()
        self._opened: asyncio.Future[OpenPort] = self._loop.create_future()
        self._ended: asyncio.Future[Exception | None] = self._loop.create_future()

    async def serve(self, report: Report) -> None:
        """Run the thread until it ends; report an open line, a silent line, and new bytes. Raises
        the exception that ended the thread.
        """
        thread = threading.Thread(
            target=self._main, name=f"serial {self._settings.port}", daemon=True
        )
        thread.start()
        try:
            either: set[asyncio.Future[Any]] = {self._opened, self._ended}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            if self._opened.done():
                await self._watch(self._opened.result(), report)
            failure = await self._ended
        finally:
            await self._end(thread)
        if failure is not None:
            raise failure

    async def _watch(self, port: OpenPort, report: Report) -> None:
        report("connected", port.detail)
        losses = Losses()
        while not self._ended.done():
            await asyncio.wait({self._ended}, timeout=_WATCH_S)
            silent_s = time.monotonic() - port.last_byte_s
            lost = losses.news(port.lost(), time.monotonic())
            if silent_s > SILENT_AFTER_S:
                report(
                    "silent",
                    message("no-byte", port=port.name, seconds_s=SILENT_AFTER_S),
                    lost,
                )
            else:
                report("connected", port.detail, lost)

    async def _end(self, thread: threading.Thread) -> None:
        self._unwanted.set()
        if self._opened.done():
            self._opened.result().release()
        await asyncio.wait({self._ended}, timeout=_END_TIMEOUT_S)
        if self._ended.done():
            thread.join()

    def _main(self) -> None:
        failure: Exception | None = None
        try:
            self._live()
        except Exception as error:  # noqa: BLE001 - handed to `serve`, which raises it
            failure = error
        self._tell(self._ended, failure)

    def _live(self) -> None:
        port = OpenPort(self._settings)
        try:
            self._tell(self._opened, port)
            if not self._unwanted.is_set():
                self._work(port)
        finally:
            port.close()

    def _tell(self, future: asyncio.Future[_T], value: _T) -> None:
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(future.set_result, value)
