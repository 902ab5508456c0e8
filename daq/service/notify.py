"""Notices to systemd (sd_notify(3))."""

import os
import socket


class Notifier:
    """Sends datagrams to the socket of NOTIFY_SOCKET; does nothing without this variable."""

    def __init__(self) -> None:
        self._address = os.environ.get("NOTIFY_SOCKET", "")
        self._shown = ""

    @property
    def watchdog_s(self) -> float | None:
        """Return the period in s in which systemd expects signs of life (sd_watchdog_enabled(3));
        None without a watchdog.
        """
        wanted = os.environ.get("WATCHDOG_USEC", "")
        meant_for = os.environ.get("WATCHDOG_PID", str(os.getpid()))
        return (
            int(wanted) * 1e-6 if wanted.isdigit() and meant_for == str(os.getpid()) else None
        )

    def ready(self) -> None:
        self._send("READY=1")

    def status(self, text: str) -> None:
        """Report the present work of the daemon in words; a repetition is not sent."""
        if text != self._shown:
            self._shown = text
            self._send(f"STATUS={text}")

    def alive(self) -> None:
        """Feed the watchdog. Call this only after every worker has given a sign of life."""
        self._send("WATCHDOG=1")

    def stopping(self) -> None:
        self._send("STOPPING=1")

    def _send(self, message: str) -> None:
        if not self._address:
            return
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sock:
            try:
                sock.sendto(message.encode(), address)
            except OSError:
                self._address = ""
