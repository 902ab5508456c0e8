"""Admission of connections: their number is limited, one address can have half of this number, and
the request must arrive soon.

The limits apply before a connection uses memory or a line in a log.
"""

import asyncio
import socket
from collections import Counter
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 300
MOST_OF_ONE_ADDRESS = MOST_CONNECTIONS // 2
"""Largest number of connections of one address, so that no address excludes all others."""
HEAD_S = 10.0
"""Longest time in s for the header of a request, from the moment at which its first byte can
arrive."""
LONGEST_HEAD = 16_384


class CappedListener(socket.socket):
    """A listening socket that closes surplus connections at once."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(fileno=descriptor)
        self._open: dict[socket.socket, str] = {}
        self.refused = 0
        """Number of refused connections since the start."""

    def accept(self) -> tuple[socket.socket, tuple[str, int]]:
        """Return the next connection. Raises ConnectionAbortedError for a surplus connection, which
        asyncio treats as a client that has left."""
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
    """An event loop with the same time limit for the TLS handshake as for a request."""

    async def create_server(self, *args: Any, **options: Any) -> asyncio.Server:
        """Listen at an address; the time limit for the TLS handshake is `HEAD_S` instead of the
        library's minute."""
        if options.get("ssl") is not None:
            options |= {"ssl_handshake_timeout": HEAD_S, "ssl_shutdown_timeout": HEAD_S}
        return await super().create_server(*args, **options)


class PunctualProtocol(H11Protocol):
    """The HTTP protocol with a time limit: the header of a request must arrive within `HEAD_S`
    after the beginning of the connection or the end of the previous answer."""

    _patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._await_head()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_waiting()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        super().handle_events()
        if self.cycle is not None and not self.cycle.response_complete:
            self._stop_waiting()

    def on_response_complete(self) -> None:
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
