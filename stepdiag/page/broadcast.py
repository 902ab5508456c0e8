"""Distribution of snapshots: each snapshot is encoded once for all readers, and a slow reader gets
only the latest one."""

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Any

import msgspec

from stepdiag.daq.records.status import Snapshot
from stepdiag.page.view import SLOW_FIELDS, now_view, survey_view

RETRY_MS = 500
"""Time in ms that a browser waits after an interrupted connection before it connects again."""


def encode_event(name: str, content: dict[str, Any]) -> bytes:
    return b"event: " + name.encode() + b"\ndata: " + msgspec.json.encode(content) + b"\n\n"


class Mailbox:
    """Events that a reader has not received: at most one of each kind, the newest."""

    def __init__(self) -> None:
        self._waiting: dict[str, bytes] = {}
        self._filled = asyncio.Event()
        self._closed = False

    def put(self, kind: str, event: bytes) -> None:
        self._waiting[kind] = event
        self._filled.set()

    def close(self) -> None:
        self._closed = True
        self._filled.set()

    async def events(self) -> AsyncIterator[bytes]:
        """Yield the events since the previous yield, joined into one text, until `close`."""
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
    """The mailboxes of all readers. ``on_readers`` is called when the first reader connects and
    when the last reader leaves."""

    def __init__(self, on_readers: Callable[[bool], None]) -> None:
        self._on_readers = on_readers
        self._mailboxes: set[Mailbox] = set()
        self._newcomers: set[Mailbox] = set()
        self._slow: tuple[object, ...] = ()
        self._slow_event = b""

    async def stream(self) -> AsyncIterator[bytes]:
        """Yield the server-sent events of one reader, from the next snapshot on."""
        mailbox = Mailbox()
        self._mailboxes.add(mailbox)
        self._newcomers.add(mailbox)
        try:
            if len(self._mailboxes) == 1:
                self._on_readers(True)
            async for event in mailbox.events():
                yield event
        finally:
            self._mailboxes.discard(mailbox)
            self._newcomers.discard(mailbox)
            if not self._mailboxes:
                self._on_readers(False)

    def show(self, snapshot: Snapshot) -> None:
        """Send a snapshot to all readers. The slow parts of a snapshot are sent only after a
        change, and to new readers."""
        changed = self._refresh(snapshot)
        now = encode_event("now", now_view(snapshot))
        for mailbox in self._newcomers:
            mailbox.put("retry", b"retry: %d\n\n" % RETRY_MS)
        for mailbox in self._mailboxes if changed else self._newcomers:
            mailbox.put("survey", self._slow_event)
        for mailbox in self._mailboxes:
            mailbox.put("now", now)
        self._newcomers.clear()

    def close(self) -> None:
        for mailbox in self._mailboxes:
            mailbox.close()

    def _refresh(self, snapshot: Snapshot) -> bool:
        slow = tuple(getattr(snapshot, name) for name in SLOW_FIELDS)
        if slow == self._slow and self._slow_event:
            return False
        self._slow = slow
        self._slow_event = encode_event("survey", survey_view(snapshot))
        return True
