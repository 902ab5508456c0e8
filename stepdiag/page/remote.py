"""The daemon for the page's process: snapshots arrive by one pipe, requests leave by another
pipe."""

import asyncio
import itertools
import os
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import BinaryIO

from stepdiag.base.errors import DeviceError
from stepdiag.base.messages import Words, message
from stepdiag.daq.records.status import CommandName
from stepdiag.daq.service.metrics import Figures
from stepdiag.page.messages import (
    LENGTH_BYTES,
    LONGEST_MESSAGE,
    Answer,
    Count,
    Counted,
    Fault,
    Guesses,
    Order,
    Picture,
    Ready,
    Request,
    Watch,
    framed,
    incoming_decoder,
)

ANSWER_S = 3.0
"""Longest time in s for an answer of the daemon."""
FRESH_S = 0.5
"""Largest age in s at which a snapshot counts as the present state."""


class RemoteDaemon:
    """The connection of the page to the daemon. ``on_picture`` is called with every snapshot,
    ``on_end`` after the last one."""

    def __init__(self, asks: BinaryIO) -> None:
        self._asks = asks
        self._numbers = itertools.count(1)
        self._awaited: dict[int, asyncio.Future[Answer | Counted]] = {}
        self._picture: Picture | None = None
        self._picture_s = 0.0
        self._new_picture = asyncio.Condition()
        self._watching = False
        self.on_picture: Callable[[Picture], None] = lambda _: None
        self.on_end: Callable[[], None] = lambda: None

    async def hear(self, hears: BinaryIO) -> None:
        """Process the daemon's messages until it closes the pipe."""
        reader = asyncio.StreamReader()
        loop = asyncio.get_running_loop()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), hears)
        try:
            while True:
                length = int.from_bytes(await reader.readexactly(LENGTH_BYTES), "big")
                if length > LONGEST_MESSAGE:
                    raise ConnectionError(message("message-of-bytes", count=length))
                await self._take(incoming_decoder.decode(await reader.readexactly(length)))
        except asyncio.IncompleteReadError:
            return

    def watch(self, *, on: bool) -> None:
        """Start or stop the snapshots of the daemon."""
        self._watching = on
        with suppress(DeviceError):  # a client that waits sees that no snapshot comes
            self._ask(Watch(on=on))

    def say_ready(self, still_open: tuple[str, ...]) -> None:
        self._ask(Ready(open=still_open))

    def say_guesses(self, address: str, count: int) -> None:
        self._ask(Guesses(address=address, count=count))

    def say_fault(self, why: object) -> None:
        """Report the place and the reason of a fault of this program to the daemon."""
        place = (
            traceback.extract_tb(why.__traceback__)[-1:] if isinstance(why, Exception) else []
        )
        with suppress(DeviceError):
            self._ask(Fault(text=f"{why!r} in {place}"[:1000]))

    async def picture(self) -> Picture:
        """Return the present snapshot. Raises DeviceError for a silent daemon."""
        if self._picture is not None and time.monotonic() - self._picture_s < FRESH_S:
            return self._picture
        before_s = self._picture_s
        if not self._watching:
            self._ask(Watch(on=False))
        try:
            async with asyncio.timeout(ANSWER_S), self._new_picture:
                await self._new_picture.wait_for(lambda: self._picture_s > before_s)
        except TimeoutError as why:
            raise _silent() from why
        assert self._picture is not None
        return self._picture

    async def order(
        self, name: CommandName, arguments: dict[str, str], address: str
    ) -> Words:
        """Request a command; return the reason of a refusal, empty after execution. Raises
        DeviceError for a silent daemon."""
        number = next(self._numbers)
        answer = await self._answer(
            number, Order(number=number, name=name, arguments=arguments, address=address)
        )
        assert isinstance(answer, Answer)
        return answer.refusal

    async def figures(self) -> Figures:
        """Return the daemon's counters and measures for Prometheus. Raises DeviceError for a silent
        daemon."""
        number = next(self._numbers)
        answer = await self._answer(number, Count(number=number))
        assert isinstance(answer, Counted)
        return answer.figures

    async def _answer(self, number: int, request: Request) -> Answer | Counted:
        future: asyncio.Future[Answer | Counted] = asyncio.get_running_loop().create_future()
        self._awaited[number] = future
        try:
            self._ask(request)
            async with asyncio.timeout(ANSWER_S):
                return await future
        except TimeoutError as why:
            raise _silent() from why
        finally:
            del self._awaited[number]

    def _ask(self, request: Request) -> None:
        try:
            os.write(self._asks.fileno(), framed(request))
        except (BlockingIOError, BrokenPipeError) as why:
            raise _silent() from why

    async def _take(self, incoming: Picture | Answer | Counted) -> None:
        if not isinstance(incoming, Picture):
            awaited = self._awaited.get(incoming.number)
            if awaited is not None and not awaited.done():
                awaited.set_result(incoming)
            return
        self._picture, self._picture_s = incoming, time.monotonic()
        self.on_picture(incoming)
        async with self._new_picture:
            self._new_picture.notify_all()


def _silent() -> DeviceError:
    return DeviceError(
        message("where-recorder"),
        expected=message("expects-answer", seconds_s=ANSWER_S),
        found=message("none"),
        remedy=message("try-again"),
    )
