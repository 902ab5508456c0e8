"""An open port on any device.

A wait is one poll(2); on a busy line the read itself waits.
"""

import os
import select
import threading
import time

from stepdiag.base.errors import DeviceError, system_words
from stepdiag.base.messages import Words, message
from stepdiag.daq.links.ports.address import network_line
from stepdiag.daq.links.ports.device import Device, LossKind, SerialSettings
from stepdiag.daq.links.ports.network import open_network
from stepdiag.daq.links.ports.tty import Tty


class OpenPort:
    """An open port, used by one thread. Every failure is a DeviceError.

    Other threads may call only ``release``, ``hurry`` and ``lost``.
    """

    def __init__(self, settings: SerialSettings) -> None:
        self.name = settings.port
        self.last_byte_s = time.monotonic()
        self._closing = threading.Lock()
        self._closed = False
        self._device = _open(settings)
        self._line = self._device.fileno()
        self.low_latency, self.detail = self._device.low_latency, self._device.detail
        self._released = threading.Event()
        self._bell = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._rang = False
        self._rung, self._either = select.poll(), select.poll()
        self._rung.register(self._bell, select.POLLIN)
        self._either.register(self._bell, select.POLLIN)
        self._either.register(self._line, select.POLLIN)

    @property
    def wanted(self) -> bool:
        return not self._released.is_set()

    def read(self, timeout_s: float) -> bytes:
        """Wait at most ``timeout_s`` for the first byte and return the received bytes; empty
        without a byte or after an interruption.
        """
        ready = self._either.poll(timeout_s * 1e3)
        if any(descriptor == self._line for descriptor, _ in ready):
            return self._take(ready=True)
        if ready:
            self._quiet()
        return b""

    def read_on(self) -> bytes:
        """Return the next bytes of a busy line; empty after 0.1 s of silence or after an
        interruption.
        """
        if self._rang:
            self._quiet()
            return b""
        return self._take(ready=False)

    def write(self, data: bytes) -> None:
        """Send ``data`` and wait until the last byte is sent."""
        try:
            self._device.write(data)
        except OSError as error:
            raise _loss(self.name, system_words(error)) from error

    def pause(self, seconds: float) -> None:
        """Wait; `release` and `hurry` end the wait."""
        if self._rung.poll(max(seconds, 0.0) * 1e3):
            self._quiet()

    def hurry(self) -> None:
        """End a running pause or read at once, so that received bytes are processed now."""
        with self._closing:
            if not self._closed:
                os.eventfd_write(self._bell, 1)
                self._rang = True

    def lost(self) -> dict[LossKind, int]:
        """Return the line's counts of its losses (`Device.lost`); empty for a closed line."""
        with self._closing:
            return {} if self._closed else self._device.lost()

    def release(self) -> None:
        """Release the port: from now on every pause and read ends at once."""
        self._released.set()
        self.hurry()

    def close(self) -> None:
        """Close the port in a thread, because the kernel may need half a minute to close a line."""
        with self._closing:
            first, self._closed = not self._closed, True
            if first:
                os.close(self._bell)
        if first:
            self._device.close()

    def _take(self, *, ready: bool) -> bytes:
        try:
            data = self._device.read(ready=ready)
        except OSError as error:
            raise _loss(self.name, system_words(error)) from error
        if data:
            self.last_byte_s = time.monotonic()
        return data

    def _quiet(self) -> None:
        """Reset the interruption by `hurry`; the interruption by `release` is permanent."""
        with self._closing:
            self._rang = self._released.is_set()
            if not self._rang:
                os.eventfd_read(self._bell)


def _open(settings: SerialSettings) -> Device:
    line = network_line(settings.port)
    return Tty(settings) if line is None else open_network(settings, line)


def _loss(name: str, why: Words) -> DeviceError:
    remedy = message("do-reconnects")
    return DeviceError(
        message("where-port", name=name),
        expected=message("expects-stays"),
        found=message("found-gone", why=why),
        remedy=remedy,
    )
