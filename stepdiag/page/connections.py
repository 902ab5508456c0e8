"""Admission of connections: a limited number, no more than half of them for a single address, and
each must send its request soon.

The limits apply where a connection is accepted, before it uses any memory or a line in a log.
"""

import asyncio
import socket
from collections import Counter
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 300
MOST_OF_ONE_ADDRESS = MOST_CONNECTIONS // 2
"""No single address can keep all others out."""
HEAD_S = 10.0
"""Longest time for the header of a request in s, from its first possible byte."""
LONGEST_HEAD = 16_384
"""Bytes of a head."""


class CappedListener(socket.socket):
    """A listening socket that closes surplus connections at once."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(fileno=descriptor)
        self._open: dict[socket.socket, str] = {}
        self.refused = 0
        """Number of refused connections."""

    def accept(self) -> tuple[socket.socket, tuple[str, int]]:
        """Return the next connection. Raises ConnectionAbortedError for a surplus connection, which
        asyncio treats as a client that has left.
        """
        guest, address = super().accept()
        self._open = {each: host for each, host in self._open.items() if each.fileno() >= 0}
        host = str(address[0])
        if (
            len(self._open) >= MOST_CONNECTIONS
            or Counter(self._open.values())[host] >= MOST_OF_ONE_ADDRESS
        ):
            guest.close()
            self.refused += 1
            raise ConnectionAbortedError("too many connections")
        self._open[guest] = host
        return guest, address


class PunctualLoop(asyncio.SelectorEventLoop):
    """An event loop whose clients have the same time to finish the handshake of encryption as to
    send a request.
    """

    async def create_server(self, *args: Any, **options: Any) -> asyncio.Server:
        """Listen; with TLS the time limit is that of `PunctualProtocol` instead of the library's
        minute.
        """
        if options.get("ssl") is not None:
            options |= {"ssl_handshake_timeout": HEAD_S, "ssl_shutdown_timeout": HEAD_S}
        return await super().create_server(*args, **options)


class PunctualProtocol(H11Protocol):
    """HTTP whose requests must arrive within `HEAD_S`: from the beginning of the connection, or
    from the end of the previous answer.
    """

    _patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first head."""
        super().connection_made(transport)
        self._await_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        self._stop_waiting()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Process the received bytes; a complete header ends the waiting."""
        super().handle_events()
        if self.cycle is not None and not self.cycle.response_complete:
            self._stop_waiting()

    def on_response_complete(self) -> None:
        """Wait for the next head."""
        self._await_head()
        super().on_response_complete()

    def _await_head(self) -> None:
        self._stop_waiting()
        self._patience = self.loop.call_later(HEAD_S, self._lose_patience)

    def _stop_waiting(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None

    def _lose_patience(self) -> None:
        if (
            self.cycle is None
            or self.cycle.response_complete
            or self.conn.our_state is h11.ERROR
        ):
            self.transport.abort()
