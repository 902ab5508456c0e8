"""A terminal server: a pty held out on a TCP port, as plain bytes or by RFC 2217 with the library's
own server side of it."""

import logging
import os
import select
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import serial
from serial.rfc2217 import PortManager

from testkit.running.slaves import running


class PtyPort(serial.Serial):
    """A port without the lines of a modem, which a pty has not."""

    cts = dsr = ri = cd = True

    def _update_dtr_state(self) -> None: ...

    def _update_rts_state(self) -> None: ...


@contextmanager
def terminal_server(
    path: str, scheme: Literal["socket", "rfc2217"], port: int = 0
) -> Iterator[str]:
    """Hold the port out while the block lasts; yield how a survey file names it."""
    with socket.create_server(("127.0.0.1", port)) as listener:
        listener.settimeout(0.05)

        def work(ended: threading.Event) -> None:
            while not ended.is_set():
                try:
                    guest, _ = listener.accept()
                except TimeoutError:
                    continue
                with guest:
                    _serve(guest, path, scheme, ended)

        with running(work):
            yield f"{scheme}://127.0.0.1:{listener.getsockname()[1]}"


def _serve(guest: socket.socket, path: str, scheme: str, ended: threading.Event) -> None:
    """Carry bytes both ways until one end is gone."""
    try:
        port = PtyPort(path, timeout=0)
    except OSError:
        return
    try:
        _carry(guest, port, _manager(port, guest) if scheme == "rfc2217" else None, ended)
    except OSError:
        return
    finally:
        port.close()


def _manager(port: serial.Serial, guest: socket.socket) -> PortManager:
    class Wire:
        write = staticmethod(guest.sendall)

    return PortManager(port, Wire(), logging.getLogger("terminal server"))


def _carry(
    guest: socket.socket,
    port: serial.Serial,
    manager: PortManager | None,
    ended: threading.Event,
) -> None:
    while not ended.is_set():
        ready, _, _ = select.select([guest, port.fileno()], [], [], 0.05)
        if guest in ready:
            data = guest.recv(4096)
            if not data:
                return
            port.write(b"".join(manager.filter(data)) if manager else data)
        if port.fileno() in ready:
            data = os.read(port.fileno(), 4096)
            if not data:
                return
            guest.sendall(b"".join(manager.escape(data)) if manager else data)
