"""One encoding of each snapshot for everyone who looks on; a slow reader gets the latest, never a backlog."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import suppress

import msgspec

from stepdiag.daq.records.status import Snapshot, StatusSource

SHORTEST_S = 0.1
"""No more than ten pictures a second."""
HEARTBEAT_S = 0.25
"""At least four a second, so that a reader who hears nothing for 0.8 s knows that something is wrong."""
RETRY_MS = 500
"""How soon a browser knocks again after the line broke."""
SLOW_FIELDS = (
    "survey",
    "machine",
    "operator",
    "workpiece",
    "setups",
    "stops",
    "findings",
    "origin_mm",
    "size_mm",
    "increments",
    "result_ready",
    "prediction",
)
"""What changes with a stop or a setup; all the rest goes out with every picture."""
FAST_FIELDS = tuple(name for name in Snapshot.__struct_fields__ if name not in SLOW_FIELDS)


def encode_event(name: str, snapshot: Snapshot, fields: tuple[str, ...]) -> bytes:
    """Return some fields of a snapshot as one server-sent event."""
    body = msgspec.json.encode({field: getattr(snapshot, field) for field in fields})
    return b"event: " + name.encode() + b"\ndata: " + body + b"\n\n"


class Mailbox:
    """What one reader has not fetched yet: at most one event of each kind, the newest."""

    def __init__(self) -> None:
        self._waiting: dict[str, bytes] = {}
        self._filled = asyncio.Event()
        self._closed = False

    def put(self, kind: str, event: bytes) -> None:
        """Replace the waiting event of this kind."""
        self._waiting[kind] = event
        self._filled.set()

    def close(self) -> None:
        """End the stream after what is waiting."""
        self._closed = True
        self._filled.set()

    async def events(self) -> AsyncIterator[bytes]:
        """Yield what came since the last time, joined, until `close`."""
        while True:
            await self._filled.wait()
            self._filled.clear()
            if self._waiting:
                joined = b"".join(self._waiting.values())
                self._waiting.clear()
                yield joined
            if self._closed:
                return


class Broadcaster:
    """Watches the source while anybody looks on and fills every reader's mailbox."""

    def __init__(self, source: StatusSource) -> None:
        self._source = source
        self._mailboxes: set[Mailbox] = set()
        self._task: asyncio.Task[None] | None = None
        self._slow: tuple[object, ...] = ()
        self._slow_event = b""

    @property
    def readers(self) -> int:
        """Return how many look on."""
        return len(self._mailboxes)

    async def stream(self) -> AsyncIterator[bytes]:
        """Yield the server-sent events of one reader until the page closes or the reader goes."""
        mailbox = Mailbox()
        self._mailboxes.add(mailbox)
        snapshot = self._source.snapshot()
        self._refresh(snapshot)
        mailbox.put("retry", b"retry: %d\n\n" % RETRY_MS)
        mailbox.put("survey", self._slow_event)
        mailbox.put("now", encode_event("now", snapshot, FAST_FIELDS))
        self._wake()
        try:
            async for event in mailbox.events():
                yield event
        finally:
            self._mailboxes.discard(mailbox)
            if not self._mailboxes:
                self._rest()

    async def close(self) -> None:
        """End all streams and stop watching."""
        for mailbox in self._mailboxes:
            mailbox.close()
        task = self._task
        self._rest()
        if task is not None:
            with suppress(asyncio.CancelledError):
                await task

    def _wake(self) -> None:
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._watch(), name="page broadcaster")

    def _rest(self) -> None:
        if self._task is not None:
            self._task.cancel()
            self._task = None

    def _refresh(self, snapshot: Snapshot) -> bool:
        """Encode the slow fields again where they changed; return whether they did."""
        slow = tuple(getattr(snapshot, name) for name in SLOW_FIELDS)
        if slow == self._slow and self._slow_event:
            return False
        self._slow = slow
        self._slow_event = encode_event("survey", snapshot, SLOW_FIELDS)
        return True

    async def _watch(self) -> None:
        """Fill the mailboxes; whatever ends this ends the streams too, and the browsers knock again."""
        try:
            while True:
                await self._picture()
        finally:
            for mailbox in self._mailboxes:
                mailbox.close()

    async def _picture(self) -> None:
        snapshot = self._source.snapshot()
        changed = self._refresh(snapshot)
        now = encode_event("now", snapshot, FAST_FIELDS)
        for mailbox in self._mailboxes:
            if changed:
                mailbox.put("survey", self._slow_event)
            mailbox.put("now", now)
        await asyncio.sleep(SHORTEST_S)
        with suppress(TimeoutError):
            async with asyncio.timeout(HEARTBEAT_S - SHORTEST_S):
                await self._source.changed(snapshot.sequence)
