"""Lines of instruments: a real pseudo-terminal with a stable name, like a udev link, or a real TCP
port."""

import errno
import fcntl
import os
import select
import socket
import struct
import termios
import threading
import time
import tty
from pathlib import Path
from typing import Protocol

from stepdiag.virtual.base.reserved import reserved_port

_KERNEL_BUFFER = 4095
_UNREAD_S = 0.25
"""Time in s for which a buffer is full before the line counts as a line without a reader."""


class Line(Protocol):
    """The line of an instrument. ``name`` is its address; ``fresh`` is true once after a new client
    has connected.

    A ``lossless`` line waits for its reader.
    """

    @property
    def name(self) -> str: ...

    @property
    def lossless(self) -> bool: ...

    @property
    def plugged(self) -> bool: ...

    def plug(self) -> None: ...

    def unplug(self) -> None: ...

    def end(self) -> None: ...

    def write(self, data: bytes) -> None: ...

    def read(self, timeout_s: float) -> bytes: ...


class SerialLine:
    """The device's end of a pty; while the line is plugged in, ``link`` is a symbolic link to the
    other end.

    A line without a reader discards old bytes like a closed port, so a later reader receives only
    new bytes. A ``lossless`` line (for load tests) waits for its reader instead.
    """

    def __init__(self, link: Path, *, lossless: bool = False) -> None:
        self.link = link
        self.lossless = lossless
        self._master = -1
        self._slave = -1
        self._full_since_s: float | None = None
        self._ended = threading.Event()
        self.plug()

    @property
    def name(self) -> str:
        return str(self.link)

    @property
    def plugged(self) -> bool:
        return self._master >= 0

    def plug(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        fresh = self.link.with_name(self.link.name + ".new")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(os.ttyname(self._slave))
        fresh.replace(self.link)
        self._full_since_s = None

    def unplug(self) -> None:
        """Remove the line: its reader receives a hang-up, and the link disappears."""
        if not self.plugged:
            return
        self.link.unlink(missing_ok=True)
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = -1

    def end(self) -> None:
        """End every wait for a reader; another thread may call this function."""
        self._ended.set()

    def write(self, data: bytes) -> None:
        """Write bytes. A line that is not lossless loses the bytes that do not fit into its
        buffer."""
        self._discard_unread()
        rest = memoryview(data)
        while rest and self.plugged:
            try:
                rest = rest[os.write(self._master, rest) :]
            except BlockingIOError:
                if not self.lossless or self._ended.is_set():
                    return
                select.select([], [self._master], [], 0.05)

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes received from the other end within ``timeout_s``."""
        if not self.plugged:
            time.sleep(timeout_s)
            return b""
        try:
            ready, _, _ = select.select([self._master], [], [], timeout_s)
            return os.read(self._master, 4096) if ready else b""
        except OSError as error:
            if error.errno in (errno.EIO, errno.EAGAIN):
                return b""
            raise

    def _discard_unread(self) -> None:
        if self.lossless or not self.plugged:
            return
        if self._unread() < _KERNEL_BUFFER:
            self._full_since_s = None
            return
        now = time.monotonic()
        self._full_since_s = now if self._full_since_s is None else self._full_since_s
        if now - self._full_since_s > _UNREAD_S:
            for _ in range(64):
                termios.tcflush(self._slave, termios.TCIFLUSH)
                if not self._unread():
                    break
            self._full_since_s = None

    def _unread(self) -> int:
        waiting: int = struct.unpack(
            "i", fcntl.ioctl(self._slave, termios.FIONREAD, b"\0\0\0\0")
        )[0]
        return waiting


class TcpLine:
    """An instrument's TCP port on loopback: a single client at a time, the same port after
    unplugging. Without a client, bytes are lost."""

    lossless = False

    def __init__(self) -> None:
        self._port = reserved_port()
        self._listener: socket.socket | None = None
        self._guest: socket.socket | None = None
        self.plug()

    @property
    def name(self) -> str:
        return f"socket://127.0.0.1:{self._port}"

    @property
    def plugged(self) -> bool:
        return self._listener is not None

    def plug(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", self._port))
        self._listener.setblocking(False)

    def unplug(self) -> None:
        """Disconnect the client and close the listening socket."""
        self._leave()
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def end(self) -> None:
        """Do nothing: a TCP port never waits for a reader."""

    def write(self, data: bytes) -> None:
        """Write bytes to the client. If the bytes do not fit into the buffer of the connection, the
        rest of the bytes is lost and the connection is closed."""
        self._admit()
        rest = memoryview(data)
        while rest and self._guest is not None:
            try:
                rest = rest[self._guest.send(rest) :]
            except OSError:
                self._leave()

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes received within ``timeout_s``."""
        self._admit()
        waiting = [each for each in (self._guest, self._listener) if each is not None]
        if not waiting:
            time.sleep(timeout_s)
            return b""
        ready, _, _ = select.select(waiting, [], [], timeout_s)
        if self._guest is None or self._guest not in ready:
            return b""
        try:
            data = self._guest.recv(4096)
        except OSError:
            data = b""
        if not data:
            self._leave()
        return data

    def _admit(self) -> None:
        if self._listener is None:
            return
        try:
            guest, _ = self._listener.accept()
        except BlockingIOError:
            return
        self._leave()
        guest.setblocking(False)
        guest.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._guest = guest

    def _leave(self) -> None:
        if self._guest is not None:
            self._guest.close()
            self._guest = None
