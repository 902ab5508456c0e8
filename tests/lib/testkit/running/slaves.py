"""Peers on real loopback sockets and real ptys, for the links: they do only what a test tells
them."""

import os
import select
import socket
import struct
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from stepdiag.virtual.base.reserved import reserved_port

Answer = Callable[[bytes], bytes | None]
"""Takes the PDU of a request; returns that of the answer, None to stay silent."""


class Pty:
    """A serial line made of a pty; the test holds the far end."""

    def __init__(self) -> None:
        self.far, self._near = os.openpty()
        tty.setraw(self._near)
        self.name = os.ttyname(self._near)

    def write(self, data: bytes) -> None:
        os.write(self.far, data)

    def read(self, timeout_s: float) -> bytes:
        return (
            os.read(self.far, 4096)
            if select.select([self.far], [], [], timeout_s)[0]
            else b""
        )

    def close(self) -> None:
        for end in (self.far, self._near):
            if end >= 0:
                os.close(end)
        self.far = self._near = -1


@contextmanager
def running(work: Callable[[threading.Event], None]) -> Iterator[None]:
    """Run ``work`` in a thread for as long as the block lasts; its argument is set when it should
    end."""
    ended = threading.Event()
    thread = threading.Thread(target=work, args=(ended,))
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def crc16_modbus(frame: bytes) -> bytes:
    """Return the CRC of an RTU frame as on the wire (polynomial 0xA001, start 0xFFFF, low byte
    first)."""
    crc = 0xFFFF
    for byte in frame:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return struct.pack("<H", crc)


@contextmanager
def rtu_slave(pty: Pty, answer: Callable[[bytes], list[bytes]]) -> Iterator[None]:
    """Serve read requests (8 bytes) on the pty one after the other; ``answer`` takes the PDU of
    each and returns those to send now."""

    def work(ended: threading.Event) -> None:
        buffer = b""
        while not ended.is_set():
            buffer += pty.read(0.02)
            while len(buffer) >= 8:
                request, buffer = buffer[:8], buffer[8:]
                for pdu in answer(request[1:6]):
                    pty.write(request[:1] + pdu + crc16_modbus(request[:1] + pdu))

    with running(work):
        yield


class TcpServer:
    """A Modbus TCP server on a loopback port that stays the same when it is stopped and started
    again."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer
        self._threads: list[threading.Thread] = []
        self.port = reserved_port()
        self.start()

    def start(self) -> None:
        self._ended = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", self.port), reuse_port=False)
        self._listener.settimeout(0.02)
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def stop(self) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()
        self._listener.close()

    def _accept(self) -> None:
        while not self._ended.is_set():
            try:
                connection, _ = self._listener.accept()
            except TimeoutError:
                continue
            thread = threading.Thread(target=self._serve, args=(connection,))
            self._threads.append(thread)
            thread.start()

    def _serve(self, connection: socket.socket) -> None:
        with connection:
            connection.settimeout(0.02)
            while not self._ended.is_set():
                try:
                    request = connection.recv(300)
                except TimeoutError:
                    continue
                except ConnectionResetError:
                    return
                if not request:
                    return
                pdu = self._answer(request[7:])
                if pdu is not None:
                    connection.sendall(
                        request[:4] + struct.pack(">H", len(pdu) + 1) + request[6:7] + pdu
                    )


def wait_until(true: Callable[[], bool], timeout_s: float = 60.0) -> None:
    """Wait for a condition of another thread; fail after ``timeout_s``."""
    deadline = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.005)


def symlink(path: Path, target: str) -> None:
    """Point ``path`` to ``target``, replacing what it pointed to."""
    path.unlink(missing_ok=True)
    path.symlink_to(target)
