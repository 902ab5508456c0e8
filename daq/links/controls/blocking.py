"""Protocols whose libraries block until an answer arrives: each connection has a thread that waits,
and the event loop awaits the result.

A library that hangs blocks only this thread. After a time limit the caller gets an error and closes
the library, which ends the thread.
"""

import asyncio
import errno
import queue
import socket
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeVar

from stepdiag.base.errors import system_words
from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.links.controls.modbus_errors import (
    LostConnectionError,
    RefusedRequestError,
    StaleAnswerError,
)
from stepdiag.daq.links.ports.lateness import Lateness
from stepdiag.daq.records.events import ModbusBlock, ReadRange
from stepdiag.daq.timing.host_clock import stamp_ns

Result = TypeVar("Result")
CONNECT_S = 5.0
"""Longest time in s for connecting, enough for a dozen requests and answers."""
_PATIENCE = 3.0
"""Longest time of a poll as a multiple of plc.timeout_s, which limits the wait for each part of a
poll.
"""


@dataclass(frozen=True, slots=True)
class _Job:
    work: Callable[[], Any]
    done: Callable[[Any], None]
    failed: Callable[[BaseException], None]


class Waiter:
    """The thread of a connection. ``hang_up`` runs in another thread and ends a running call;
    ``close`` is the last call in the thread.
    """

    def __init__(
        self, name: str, hang_up: Callable[[], None], close: Callable[[], object]
    ) -> None:
        self._hang_up = hang_up
        self._close = close
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        threading.Thread(target=self._run, name=name, daemon=True).start()

    async def call(self, work: Callable[[], Result], limit_s: float) -> Result:
        """Run ``work`` in the thread and return its result. Raises the errors of ``work``, and
        TimeoutError after ``limit_s``.
        """
        loop = asyncio.get_running_loop()
        future: asyncio.Future[Result] = loop.create_future()

        def later(settle: Callable[[Any], None], outcome: Any) -> None:
            with suppress(RuntimeError):  # the event loop may have ended
                loop.call_soon_threadsafe(lambda: None if future.done() else settle(outcome))

        self._jobs.put(
            _Job(
                work,
                lambda value: later(future.set_result, value),
                lambda error: later(future.set_exception, error),
            )
        )
        return await asyncio.wait_for(future, limit_s)

    def end(self) -> None:
        self._jobs.put(None)
        self._hang_up()

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                value = job.work()
            except Exception as error:  # noqa: BLE001 - raised where it is awaited
                job.failed(error)
            else:
                job.done(value)
        with suppress(Exception):  # no caller waits for this result
            self._close()


class BlockingLink(ABC):
    """A link over a library that blocks. A protocol defines how to read a range (`_fetch`) and how
    to write a word (`_write`).
    """

    def __init__(
        self, address: str, timeout_s: float, ranges: Sequence[ReadRange], waiter: Waiter
    ) -> None:
        self.lateness = Lateness(numbered=True)
        self.refusals: dict[ReadRange, RefusedRequestError] = {}
        self._address = address
        self._timeout_s = timeout_s
        self._ranges = tuple(ranges)
        self._waiter = waiter

    async def read(self) -> ModbusBlock:
        """Poll the ranges (`MachineLink.read`).

        Raises LostConnectionError or StaleAnswerError, and RefusedRequestError if every range is
        refused.
        """
        block = await self._within(self._read)
        if self._ranges and len(self.refusals) == len(set(self._ranges)):
            raise self.refusals[self._ranges[0]]
        return block

    async def write_word(self, table: str, address: int, value: int) -> None:
        await self._within(lambda: self._write(table, address, value % 65536))

    def close(self) -> None:
        self._waiter.end()

    @abstractmethod
    def _fetch(self, wanted: ReadRange) -> bytes:
        """Request the bytes of a range, in the thread. Raises RefusedRequestError if the control
        refuses the range.
        """

    @abstractmethod
    def _write(self, table: str, address: int, value: int) -> None:
        """Write a word into the control, in the thread."""

    def _fetch_all(self) -> list[bytes]:
        return [self._fetch_or_refuse(wanted) for wanted in self._ranges]

    def _fetch_or_refuse(self, wanted: ReadRange) -> bytes:
        try:
            data = self._fetch(wanted)
        except RefusedRequestError as refusal:
            self.refusals[wanted] = refusal
            return b""
        return self._whole(wanted, data)

    def _whole(self, wanted: ReadRange, data: bytes) -> bytes:
        if len(data) != wanted.byte_count:
            remedy = message("do-made-anew")
            found = message(
                "found-count-for", count=len(data), table=wanted.table, address=wanted.address
            )
            raise StaleAnswerError(
                self._address,
                expected=message("expects-bytes", count=wanted.byte_count),
                found=found,
                remedy=remedy,
            )
        return data

    def _read(self) -> ModbusBlock:
        self.refusals = {}
        send_ns = stamp_ns()
        data = tuple(self._fetch_all())
        return ModbusBlock(send_ns, stamp_ns(), self._ranges, data)

    async def _within(self, work: Callable[[], Result]) -> Result:
        """Run ``work`` in the thread. An incomplete answer at the time limit counts as a missing
        answer.
        """
        limit_s = _PATIENCE * self._timeout_s + 1.0
        try:
            return await self._waiter.call(work, limit_s)
        except TimeoutError as error:
            raise silent(self._address, limit_s) from error


async def opened(
    waiter: Waiter, connect: Callable[[], None], address: str, limit_s: float
) -> None:
    """Run ``connect`` in the thread. Raises the errors of ``connect``, and LostConnectionError
    after ``limit_s``; after an error the thread has ended.
    """
    try:
        await waiter.call(connect, limit_s)
    except TimeoutError as error:
        waiter.end()
        raise silent(address, limit_s) from error
    except BaseException:
        waiter.end()
        raise


def silent(address: str, waited_s: float) -> LostConnectionError:
    remedy = message("do-overloaded")
    return LostConnectionError(
        address,
        expected=message("expects-answer", seconds_s=waited_s),
        found=message("found-half"),
        remedy=remedy,
    )


def not_installed(address: str, extra: str) -> LostConnectionError:
    found = message("found-no-extra", name=extra)
    return LostConnectionError(
        address,
        expected=message("expects-library"),
        found=found,
        remedy=message("do-install", extra=extra),
    )


def hang_up(connection: socket.socket | None) -> None:
    """Close a connection for which another thread may be waiting."""
    if connection is not None:
        with suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)


def unreachable(
    error: OSError, waited_s: float, protocol: Words, firewall: Message
) -> tuple[Words, Message]:
    if isinstance(error, socket.gaierror):
        return message("found-no-name"), message("do-plc-host")
    code = errno.ETIMEDOUT if isinstance(error, TimeoutError) else error.errno or 0
    silence = message("found-silence-for", seconds_s=waited_s)
    match code:
        case errno.ECONNREFUSED:
            return system_words(code), message("do-plc-nothing-listens", protocol=protocol)
        case errno.EHOSTUNREACH:
            return system_words(code), message("do-plc-nobody")
        case errno.ENETUNREACH:
            return system_words(code), message("do-plc-no-way")
        case errno.ETIMEDOUT:
            return silence, message("do-plc-firewall", firewall=firewall)
    return system_words(code or error), message("do-plc-address")
