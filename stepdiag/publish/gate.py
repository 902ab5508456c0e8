"""Who may connect to the OPC UA server: so many, in messages of the protocol alone, and no faster than answers are fetched.

The limits hold before the library sees a byte: what it keeps of a message, it keeps of a whole one that is not longer than it may be.
"""

import asyncio
import struct
from collections import Counter, deque
from contextvars import ContextVar, copy_context
from typing import Any

Peer = tuple[str, int]
ASKING: ContextVar[Peer] = ContextVar("asking")
"""Whose request is being answered. A session may be used over another connection than it was made over."""
MOST_CONNECTIONS = 100
MOST_OF_ONE_ADDRESS = MOST_CONNECTIONS // 2
"""Nobody alone can keep all others out: of sessions, subscriptions and items too an address has half at most (`sessions`)."""
LONGEST_CHUNK = 65_536
"""Bytes of one chunk of a message."""
SHORTEST_BUFFER = 8_192
"""Bytes: what a client must be able to take at once (OPC 10000-6, 7.1.2.3). An answer in smaller pieces would be thousands of them."""
FIRST, LATER = b"HEL", (b"OPN", b"MSG", b"CLO")
"""Kinds of chunk that a client sends. The library would also take what a server sends, and have its limits changed by it."""
FETCH_S = 20.0
"""Who fetches nothing for so long is let go."""
MOST_UNFETCHED = 16_000_000
"""Bytes of answers that wait to be fetched."""
_HEAD = struct.Struct("<3scI")
_BUFFERS = struct.Struct("<II")


class Doors:
    """The connections of one server."""

    def __init__(self) -> None:
        self._open: dict[Peer, Gate] = {}
        self._held: dict[str, float] = {}
        """Until when the answers to an address are kept back, by the clock of the event loop."""

    def __contains__(self, peer: Peer) -> bool:
        """Return whether a connection is open."""
        return peer in self._open

    def admit(self, peer: Peer, gate: "Gate") -> bool:
        """Return whether there is room for one more, and keep it."""
        hosts = Counter(host for host, _ in self._open)
        if len(self._open) >= MOST_CONNECTIONS or hosts[peer[0]] >= MOST_OF_ONE_ADDRESS:
            return False
        self._open[peer] = gate
        if peer[0] in self._held:
            gate.hold(self._held[peer[0]])
        return True

    def leave(self, peer: Peer) -> None:
        """Forget a connection."""
        self._open.pop(peer, None)

    def hold(self, host: str, seconds: float) -> None:
        """Have the next answers to an address wait, and what it asks meanwhile too, over connections that it has and those to come."""
        now = asyncio.get_running_loop().time()
        self._held = {each: until for each, until in self._held.items() if until > now}
        until = self._held[host] = max(now + seconds, self._held.get(host, now))
        for peer, gate in self._open.items():
            if peer[0] == host:
                gate.hold(until)


class Gate(asyncio.Protocol):
    """One connection: hands whole chunks to the library, one at a time, and nothing while answers wait to be fetched."""

    def __init__(self, inner: asyncio.Protocol, doors: Doors) -> None:
        self._inner, self._doors = inner, doors
        self._transport: asyncio.Transport | None = None
        self._peer: Peer = ("", 0)
        self._bytes = bytearray()
        self._expected: tuple[bytes, ...] = (FIRST,)
        self._due, self._held, self._full = False, False, False
        self._release_at: asyncio.TimerHandle | None = None
        self._kept: deque[bytes] = deque()
        self._let_go_at: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Let it in, or close it where there are too many."""
        assert isinstance(transport, asyncio.Transport)
        peer = transport.get_extra_info("peername") or ("", 0)
        self._peer = (str(peer[0]), int(peer[1]))
        if not self._doors.admit(self._peer, self):
            transport.abort()
            return
        self._transport = transport
        context = copy_context()
        context.run(ASKING.set, self._peer)
        context.run(self._inner.connection_made, _Answers(transport, self))  # type: ignore[arg-type]  # it uses no more of a transport

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget what it asked."""
        for timer in (self._release_at, self._let_go_at):
            if timer is not None:
                timer.cancel()
        if self._transport is not None:
            self._transport = None
            self._bytes.clear()
            self._kept.clear()
            self._doors.leave(self._peer)
            self._inner.connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take what came; of a client that sends faster than it is answered no more is read."""
        if self._transport is not None:
            self._bytes += data
            self._go_on()

    def pause_writing(self) -> None:
        """Answer nothing more until answers are fetched."""
        self._full = True
        self._let_go_at = asyncio.get_running_loop().call_later(FETCH_S, self._let_go_if_full)

    def resume_writing(self) -> None:
        """Go on."""
        self._full = False
        if self._let_go_at is not None:
            self._let_go_at.cancel()
        self._go_on()

    def hold(self, until: float) -> None:
        """Keep answers back until then, by the clock of the event loop."""
        if self._release_at is not None:
            self._release_at.cancel()
        self._held, self._release_at = True, asyncio.get_running_loop().call_at(until, self._release)

    def answer(self, data: bytes) -> None:
        """Send, or keep, what the library answers."""
        if self._transport is None:
            return
        if self._held:
            self._kept.append(data)
        else:
            self._transport.write(data)
        if self._transport.get_write_buffer_size() + sum(map(len, self._kept)) > MOST_UNFETCHED:
            self._transport.abort()

    def _go_on(self) -> None:
        """Have the next chunk looked at in a turn of its own: the library has answered the one before by then."""
        if self._transport is None or self._transport.is_closing():
            return
        if self._held or self._full or len(self._bytes) > LONGEST_CHUNK:
            self._transport.pause_reading()
        else:
            self._transport.resume_reading()
        if not (self._due or self._held or self._full):
            self._due = True
            asyncio.get_running_loop().call_soon(self._next)

    def _next(self) -> None:
        self._due = False
        if self._transport is None or self._held or self._full or len(self._bytes) < _HEAD.size:
            return
        kind, _, size = _HEAD.unpack_from(self._bytes)
        if kind not in self._expected or not _HEAD.size <= size <= LONGEST_CHUNK:
            self._transport.abort()
            return
        if len(self._bytes) < size:
            return
        chunk = bytes(self._bytes[:size])
        del self._bytes[:size]
        if kind == FIRST and not _takes_enough(chunk):
            self._transport.abort()
            return
        self._expected = LATER
        self._inner.data_received(chunk)
        self._go_on()

    def _release(self) -> None:
        self._held, self._release_at = False, None
        while self._kept and self._transport is not None:
            self._transport.write(self._kept.popleft())
        self._go_on()

    def _let_go_if_full(self) -> None:
        if self._full and self._transport is not None:
            self._transport.abort()


class _Answers:
    """The transport as the library knows it: what it writes goes through the gate."""

    def __init__(self, transport: asyncio.Transport, gate: Gate) -> None:
        self._transport, self._gate = transport, gate

    def get_extra_info(self, name: str) -> Any:
        return self._transport.get_extra_info(name)

    def write(self, data: bytes) -> None:
        self._gate.answer(data)

    def close(self) -> None:
        self._transport.close()


class GatedLoop(asyncio.SelectorEventLoop):
    """An event loop whose servers stand behind `Gate`."""

    def __init__(self, doors: Doors) -> None:
        super().__init__()
        self._doors = doors

    async def create_server(self, protocol_factory: Any, *args: Any, **options: Any) -> asyncio.Server:
        """Listen."""
        return await super().create_server(lambda: Gate(protocol_factory(), self._doors), *args, **options)


def _takes_enough(hello: bytes) -> bool:
    """Return whether a client's buffers are as large as they must be."""
    place = _HEAD.size + 4
    return len(hello) >= place + _BUFFERS.size and min(_BUFFERS.unpack_from(hello, place)) >= SHORTEST_BUFFER
