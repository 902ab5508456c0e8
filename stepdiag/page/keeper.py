"""The part of the daemon that sends snapshots to the page and receives its commands.

As a service, the page is a systemd unit with its own account. Systemd starts this unit for the
first visitor, and the unit connects by a Unix socket. The kernel identifies the connecting account
(SO_PEERCRED, unix(7)), and every account except the page's account is refused. Without the service,
the daemon opens the address of the page and starts a process for it, connected by a pair of
sockets.

The daemon trusts the messages of the page as little as those of a browser: it checks them and
limits their size and number. Messages that the page does not receive in time are omitted. No
failure of this module ends the daemon.
"""

import asyncio
import os
import socket
import struct
import sys
import time
from asyncio.subprocess import PIPE
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import structlog

from stepdiag.base.errors import DeviceError, UsageError, system_words
from stepdiag.base.messages import Words, message
from stepdiag.daq.records.status import StatusSource
from stepdiag.daq.service.metrics import Figures
from stepdiag.daq.survey.models import Metrics, Page
from stepdiag.page.messages import (
    LENGTH_BYTES,
    LONGEST_REQUEST,
    Answer,
    Count,
    Counted,
    Fault,
    Guesses,
    Order,
    PageSettings,
    Picture,
    Ready,
    Request,
    Watch,
    framed,
    request_decoder,
)

SHORTEST_S = 0.1
"""Shortest time in s between two snapshots."""
HEARTBEAT_S = 0.25
"""Longest time in s between two snapshots; a reader reports a fault after 0.8 s without a
snapshot."""
REQUEST_S = 0.01
"""Shortest time in s between two requests of the page."""
MOST_UNREAD = 1_000_000
"""Number of unreceived bytes above which the page is restarted."""
AGAIN_S = (0.2, 1.0, 5.0, 30.0)
"""Times in s before the second start of the page, the third, and so on. After the page has run for
`LIVED_S`, the first time is used again."""
LIVED_S = 60.0
GRACE_S = 1.0
"""Time in s in which the page can finish its streams and downloads at the end of the daemon."""
BACKLOG = 128
LAST_WORDS = 2000
"""Largest number of characters of a failure in the log: the rest of a traceback adds no
information."""
_ENVIRONMENT = ("PATH", "LANG", "LC_ALL", "TZ", "PYTHONPATH", "PYTHONDONTWRITEBYTECODE")
_log = structlog.get_logger("page")


@dataclass(frozen=True, slots=True, kw_only=True)
class Listeners:
    """The listening sockets of page and metrics. A service that is off has None instead of a
    socket."""

    page: socket.socket | None = None
    metrics: socket.socket | None = None

    @classmethod
    def opened(cls, page: Page, metrics: Metrics) -> "Listeners":
        """Return the listening sockets for the addresses in a survey file. Raises DeviceError for
        an address that cannot be opened."""
        shown = open_listener(page.host, page.port, "page") if page.enabled else None
        try:
            return cls(
                page=shown,
                metrics=open_listener(metrics.host, metrics.port, "metrics")
                if metrics.enabled
                else None,
            )
        except DeviceError:
            if shown is not None:
                shown.close()
            raise

    @property
    def descriptors(self) -> tuple[str, str]:
        """Return the descriptors of page and metrics as arguments of the page's process, ``-`` for
        a service that is off."""
        return _descriptor(self.page), _descriptor(self.metrics)

    @property
    def open(self) -> tuple[int, ...]:
        """Return the descriptors that the page's process inherits."""
        return tuple(each.fileno() for each in (self.page, self.metrics) if each is not None)

    def close(self) -> None:
        for each in (self.page, self.metrics):
            if each is not None:
                each.close()


def open_listener(host: str, port: int, section: str) -> socket.socket:
    """Return a listening socket. Port 0 uses any free port; ``section`` is the section of the
    address in the survey file. Raises DeviceError for an address that is in use, or that does not
    belong to this computer."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(BACKLOG)
    except OSError as why:
        listener.close()
        raise DeviceError(
            f"{section}.host, {section}.port",
            expected=message("free-address", address=f"{host}:{port}"),
            found=system_words(why),
            remedy=message("choose-other-port"),
        ) from why
    return listener


@asynccontextmanager
async def page_served(
    path: Path, account: int, source: StatusSource, figures: Callable[[], Figures]
) -> AsyncIterator[None]:
    """Serve a page that runs under another account, by a Unix socket, while the block runs. A new
    connection of the page replaces the previous connection."""
    visits: set[asyncio.Task[None]] = set()

    async def welcome(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        caller = struct.unpack(
            "3i",
            writer.get_extra_info("socket").getsockopt(
                socket.SOL_SOCKET, socket.SO_PEERCRED, 12
            ),
        )[1]
        if caller != account:
            _log.error("page-stranger", account=caller, expected=account)
            writer.transport.abort()
            return
        for earlier in visits:
            earlier.cancel()
        task = asyncio.current_task()
        assert task is not None
        visits.add(task)
        visit = _Visit(source, _Line(writer.transport), figures)
        try:
            await visit.hear(reader)
        except Exception as error:  # noqa: BLE001 - whatever it is, the page comes back and the recording goes on
            _log.error("page-ended", words=f"{type(error).__name__}: {error}"[:LAST_WORDS])
        finally:
            visits.discard(task)
            visit.close()
            writer.transport.abort()

    server = await asyncio.start_unix_server(
        welcome, path, limit=LONGEST_REQUEST + LENGTH_BYTES
    )
    os.chmod(path, 0o660)  # noqa: PTH101  # to connect is to write; the group is that of who reads the survey, and the account is asked for
    async with server:
        yield
        for each in visits:
            each.cancel()


@asynccontextmanager
async def page_kept(
    source: StatusSource,
    settings: PageSettings,
    listeners: Listeners,
    figures: Callable[[], Figures] | None = None,
) -> AsyncIterator[None]:
    """Run the page's process while the block runs; close the listeners at its end."""
    keeper = PageKeeper(source, settings, listeners, figures)
    task = asyncio.create_task(keeper.run(), name="page keeper")
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        listeners.close()


class PageKeeper:
    """Runs the page's process, restarts the process whenever it ends, and serves its requests."""

    def __init__(
        self,
        source: StatusSource,
        settings: PageSettings,
        listeners: Listeners,
        figures: Callable[[], Figures] | None = None,
    ) -> None:
        self._source = source
        self._settings = settings
        self._listeners = listeners
        self._figures = figures

    async def run(self) -> None:
        failures = 0
        while True:
            began_s = time.monotonic()
            try:
                last_words = await self._one_life()
            except Exception as error:  # noqa: BLE001 - whatever it is, the page comes back and the recording goes on
                last_words = f"{type(error).__name__}: {error}"[:LAST_WORDS]
            failures = 1 if time.monotonic() - began_s > LIVED_S else failures + 1
            wait_s = AGAIN_S[min(failures, len(AGAIN_S)) - 1]
            _log.error("page-ended", words=last_words, again_in_s=wait_s)
            await asyncio.sleep(wait_s)

    async def _one_life(self) -> str:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            try:
                child = await asyncio.create_subprocess_exec(
                    sys.executable,
                    "-P",
                    "-m",
                    "stepdiag.page.process",
                    *self._listeners.descriptors,
                    stdin=theirs.fileno(),
                    stdout=theirs.fileno(),
                    stderr=PIPE,
                    pass_fds=self._listeners.open,
                    env={
                        name: os.environ[name] for name in _ENVIRONMENT if name in os.environ
                    },
                )
            except OSError as error:
                return str(error)
            theirs.close()
            return await self._serve(child, ours)

    async def _serve(self, child: asyncio.subprocess.Process, ours: socket.socket) -> str:
        reader, writer = await asyncio.open_connection(
            sock=ours, limit=LONGEST_REQUEST + LENGTH_BYTES
        )
        line = _Line(writer.transport)
        words = asyncio.create_task(_last_words(child), name="page's last words")
        visit = _Visit(self._source, line, self._figures)
        serving = asyncio.create_task(visit.hear(reader), name="page's requests")
        line.send(self._settings)
        failure = ""
        try:
            await asyncio.wait({serving, words}, return_when=asyncio.FIRST_COMPLETED)
            if serving.done() and (error := serving.exception()) is not None:
                failure = f"{type(error).__name__}: {error}"[:LAST_WORDS]
        finally:
            serving.cancel()
            visit.close()
            line.close()
            await _ended(child)
            await asyncio.gather(serving, return_exceptions=True)
        return failure or await words or f"nothing; it ended with {child.returncode}"


class _Line:
    """The connection to the page. A snapshot that the page does not receive is omitted; too many
    bytes of other data end the connection."""

    def __init__(self, transport: asyncio.WriteTransport) -> None:
        self._transport = transport

    @property
    def clear(self) -> bool:
        """Whether all data have been passed to the operating system."""
        return self._transport.get_write_buffer_size() == 0

    def send(self, sent: object) -> None:
        if self._transport.get_write_buffer_size() > MOST_UNREAD:
            raise ConnectionError(message("answers-not-fetched"))
        self._transport.write(framed(sent))

    def close(self) -> None:
        if not self._transport.is_closing():
            self._transport.abort()


class _Visit:
    def __init__(
        self, source: StatusSource, line: _Line, figures: Callable[[], Figures] | None
    ) -> None:
        self._source = source
        self._line = line
        self._figures = figures
        self._pictures: asyncio.Task[None] | None = None
        self._faults = 0

    async def hear(self, reader: asyncio.StreamReader) -> None:
        with suppress(asyncio.IncompleteReadError):
            while True:
                length = int.from_bytes(await reader.readexactly(LENGTH_BYTES), "big")
                if length > LONGEST_REQUEST:
                    raise ConnectionError(message("request-of-bytes", count=length))
                await self._do(request_decoder.decode(await reader.readexactly(length)))
                await asyncio.sleep(REQUEST_S)

    def close(self) -> None:
        if self._pictures is not None:
            self._pictures.cancel()
            self._pictures = None

    async def _do(self, request: Request) -> None:
        match request:
            case Watch():
                self._watch(on=request.on)
            case Order():
                self._line.send(
                    Answer(number=request.number, refusal=await self._obey(request))
                )
            case Count():
                if self._figures is not None:
                    self._line.send(Counted(number=request.number, figures=self._figures()))
            case Guesses():
                _log.warning(
                    "wrong-tokens", address=request.address[:100], count=request.count
                )
                self._source.token_guessed(request.address[:100], request.count)
            case Fault():
                self._say_fault(request.text)
            case Ready():
                _log.info(
                    "page-confined", open=", ".join(request.open)[:LAST_WORDS] or "nothing"
                )

    def _say_fault(self, text: str) -> None:
        self._faults += 1
        if str(self._faults).strip("0") == "1":
            _log.error("page-fault", words=text[:LAST_WORDS], count=self._faults)

    async def _obey(self, order: Order) -> Words:
        with structlog.contextvars.bound_contextvars(address=order.address[:100]):
            try:
                await self._source.command(order.name, order.arguments)
            except UsageError as why:
                return why.message
        return ""

    def _watch(self, *, on: bool) -> None:
        if on and (self._pictures is None or self._pictures.done()):
            self._pictures = asyncio.create_task(
                self._send_pictures(), name="page's pictures"
            )
        elif not on:
            self.close()
            self._send_picture()

    async def _send_pictures(self) -> None:
        while True:
            sequence = self._send_picture()
            await asyncio.sleep(SHORTEST_S)
            with suppress(TimeoutError):
                async with asyncio.timeout(HEARTBEAT_S - SHORTEST_S):
                    await self._source.changed(sequence)

    def _send_picture(self) -> int:
        snapshot = self._source.snapshot()
        if self._line.clear:
            result = self._source.result_file()
            folder = self._source.folder()
            self._line.send(
                Picture(
                    snapshot=snapshot,
                    folder=str(folder),
                    result="" if result is None else str(result),
                )
            )
        return snapshot.sequence


async def _ended(child: asyncio.subprocess.Process) -> None:
    try:
        async with asyncio.timeout(GRACE_S):
            await child.wait()
    except TimeoutError:
        with suppress(ProcessLookupError):
            child.kill()
        await child.wait()


async def _last_words(child: asyncio.subprocess.Process) -> str:
    assert child.stderr is not None
    kept = b""
    while part := await child.stderr.read(LAST_WORDS):
        kept = (kept + part)[-LAST_WORDS:]
        await asyncio.sleep(SHORTEST_S)
    lines = kept.decode("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else ""


def address_of(listener: socket.socket, scheme: str = "http") -> str:
    """Return the URL of a listening socket (``http://127.0.0.1:8420``)."""
    host, port = listener.getsockname()[:2]
    return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"


def _descriptor(listener: socket.socket | None) -> str:
    return "-" if listener is None else str(listener.fileno())
