"""A line on the network: ``socket://host:port`` without settings, ``rfc2217://host:port`` with the
settings of the line.

A terminal server without power sends nothing, like an instrument that is switched off. So the
kernel probes the server (keep-alive), and a line without an answer for ten seconds is lost and
opened again.
"""

import contextlib
import errno
import os
import select
import socket
import struct
import time

from stepdiag.base.errors import DeviceError, system_words
from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.links.ports.address import NetworkLine
from stepdiag.daq.links.ports.device import (
    BUSY_WAIT_S,
    LARGEST_READ,
    Device,
    LossKind,
    SerialSettings,
)
from stepdiag.daq.links.ports.rfc2217 import ComPort

CONNECT_S = 3.0
"""Longest time for connecting in s, because a firewall may drop a connection without an answer."""
AGREE_S = 2.0
"""Longest time in s until a terminal server accepts the settings of its line."""
_SHOWN = 12
"""Number of bytes outside Telnet that a message shows."""
ALIVE_AFTER_S, ALIVE_EVERY_S, ALIVE_TIMES = 4, 2, 3
"""Time in s to the first keep-alive probe, time in s between probes, and number of probes: ten
seconds in all.
"""
_REMEDIES = {
    errno.ECONNREFUSED: message("do-nothing-listens"),
    errno.EHOSTUNREACH: message("do-nobody-address"),
    errno.ENETUNREACH: message("do-no-way"),
    errno.ETIMEDOUT: message("do-firewall"),
}


def open_network(settings: SerialSettings, line: NetworkLine) -> Device:
    """Return the opened line on the network. Raises DeviceError for an absent server, or a terminal
    server that refuses the settings.
    """
    connection = _connect(settings.port, line)
    if line.scheme == "socket":
        return NetworkPort(settings.port, connection)
    try:
        return _agreed(settings, connection)
    except OSError as error:
        connection.close()
        raise _no_rfc2217(
            settings.port, message("found-connection-ended", why=system_words(error))
        ) from error
    except DeviceError:
        connection.close()
        raise


class NetworkPort:
    """A TCP connection with the unchanged bytes of the line."""

    low_latency = True

    def __init__(self, name: str, connection: socket.socket) -> None:
        self.detail = message("port-connected", port=name)
        self._connection = connection
        connection.settimeout(None)
        connection.setsockopt(
            socket.SOL_SOCKET,
            socket.SO_RCVTIMEO,
            struct.pack("ll", 0, round(BUSY_WAIT_S * 1e6)),
        )

    def fileno(self) -> int:
        return self._connection.fileno()

    def read(self, *, ready: bool) -> bytes:  # noqa: ARG002 - a connection tells its end by itself
        try:
            data = os.read(self._connection.fileno(), LARGEST_READ)
        except BlockingIOError:
            return b""
        if not data:
            raise ConnectionResetError(errno.ECONNRESET, os.strerror(errno.ECONNRESET))
        return data

    def write(self, data: bytes) -> None:
        self._connection.sendall(data)

    def lost(self) -> dict[LossKind, int]:
        """Return no counts: TCP loses no byte of an open connection, and the server does not report
        losses.
        """
        return {}

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._connection.close()


class Rfc2217Port(NetworkPort):
    """A line on the network through Telnet with the com port option."""

    def __init__(self, name: str, connection: socket.socket, codec: ComPort) -> None:
        super().__init__(name, connection)
        self.detail = message("port-agreed", port=name, settings=codec.agreed)
        self._codec = codec

    def read(self, *, ready: bool) -> bytes:
        data = self._codec.feed(super().read(ready=ready))
        if answer := self._codec.answers():
            super().write(answer)
        return data

    def write(self, data: bytes) -> None:
        super().write(self._codec.escaped(data))


def _connect(name: str, line: NetworkLine) -> socket.socket:
    try:
        connection = socket.create_connection((line.host, line.port), timeout=CONNECT_S)
    except OSError as error:
        raise _refusal(name, error) from error
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in (
        (socket.TCP_KEEPIDLE, ALIVE_AFTER_S),
        (socket.TCP_KEEPINTVL, ALIVE_EVERY_S),
        (socket.TCP_KEEPCNT, ALIVE_TIMES),
        (socket.TCP_USER_TIMEOUT, 1000 * (ALIVE_AFTER_S + ALIVE_EVERY_S * ALIVE_TIMES)),
    ):
        connection.setsockopt(socket.IPPROTO_TCP, option, value)
    return connection


def _agreed(settings: SerialSettings, connection: socket.socket) -> Rfc2217Port:
    """Return the line after the terminal server has accepted its settings. Raises DeviceError if
    the server refuses.

    Bytes of the instrument before the acceptance were received with other settings and are left
    out.
    """
    codec, other, until_s = ComPort(settings), b"", time.monotonic() + AGREE_S
    connection.sendall(codec.opening())
    while not codec.settled:
        left_s = until_s - time.monotonic()
        if left_s <= 0 or not select.select([connection], [], [], left_s)[0]:
            raise _no_rfc2217(settings.port, _heard(codec, other))
        data = connection.recv(LARGEST_READ)
        if not data:
            raise ConnectionResetError(errno.ECONNRESET, os.strerror(errno.ECONNRESET))
        other = (other + codec.feed(data))[:_SHOWN]
        if answer := codec.answers():
            connection.sendall(answer)
        if codec.refused:
            remedy = message("do-terminal-server")
            raise DeviceError(
                message("where-port", name=settings.port),
                expected=message("expects-line-settings"),
                found=codec.refused,
                remedy=remedy,
            )
    return Rfc2217Port(settings.port, connection, codec)


def _heard(codec: ComPort, other: bytes) -> Message:
    if codec.speaks:
        return message("found-no-agreement", seconds_s=AGREE_S)
    return (
        message("found-other-bytes", bytes=f"{other.hex(' ')} ...")
        if other
        else message("found-silence-for", seconds_s=AGREE_S)
    )


def _no_rfc2217(name: str, found: Words) -> DeviceError:
    remedy = message("do-socket")
    return DeviceError(
        message("where-port", name=name),
        expected=message("expects-rfc2217"),
        found=found,
        remedy=remedy,
    )


def _refusal(name: str, error: OSError) -> DeviceError:
    if isinstance(error, socket.gaierror):
        remedy = message("do-host-name")
        return DeviceError(
            message("where-port", name=name),
            expected=message("expects-host"),
            found=message("found-no-name"),
            remedy=remedy,
        )
    code = errno.ETIMEDOUT if isinstance(error, TimeoutError) else error.errno or 0
    found = (
        message("found-silence-for", seconds_s=CONNECT_S)
        if code == errno.ETIMEDOUT
        else system_words(code or error)
    )
    return DeviceError(
        message("where-port", name=name),
        expected=message("expects-connection"),
        found=found,
        remedy=_REMEDIES.get(code, message("do-host-port")),
    )
