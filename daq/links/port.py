"""A serial port: its settings, opening it, and what to do when that fails.

pyserial sets the line up; waiting and reading are one poll(2) and one read(2) here, and on a busy line the read(2) alone. Its own
``read`` makes four calls of them, each of which lets go of the interpreter and may wait for it, and costs twice the time.
"""

import errno
import os
import select
import termios
import threading
import time
from dataclasses import dataclass
from typing import Literal

import serial

from stepdiag.solver.errors import DeviceError

LARGEST_READ = 65536
_BUSY_WAIT_DS = 1
"""How long (in tenths of a second, termios(3)) a read waits on a line that is expected to bring something at any moment."""
_REMEDIES = {
    errno.ENOENT: "check that the device is plugged in and that the survey names its port (a stable name is under /dev/serial/by-id)",
    errno.EACCES: "give the user the right to the port (group dialout, or the udev rule that comes with the program)",
    errno.EBUSY: "another program has the port open: end it",
    errno.EAGAIN: "another program has the port open: end it",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialSettings:
    """A port and how its line is driven. uMD boards need DTR and RTS asserted."""

    port: str
    baud: int = 115200
    bytesize: Literal[7, 8] = 8
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    dtr: bool = True
    rts: bool = True


class OpenPort:
    """An open port, used by one thread. Only ``release`` and ``hurry`` may be called from another one; every failure is a DeviceError."""

    def __init__(self, settings: SerialSettings) -> None:
        self.name = settings.port
        self.last_byte_s = time.monotonic()
        self._closing = threading.Lock()
        try:
            self._serial = serial.Serial(
                baudrate=settings.baud, bytesize=settings.bytesize, parity=settings.parity, stopbits=settings.stopbits, exclusive=True
            )
            self._serial.dtr, self._serial.rts = settings.dtr, settings.rts
            self._serial.port = settings.port
            self._serial.open()
            self._serial.timeout = 0.0  # sets the line up once more: only then a port says that it does not take these settings
            self._line = self._serial.fileno()
            _let_reads_wait(self._line)
        except (OSError, ValueError, termios.error) as error:
            raise _refusal(settings.port, error) from error
        self.low_latency = _set_low_latency(self._serial)
        self._released = threading.Event()
        self._bell = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._rang = False
        self._rung, self._either = select.poll(), select.poll()
        self._rung.register(self._bell, select.POLLIN)
        self._either.register(self._bell, select.POLLIN)
        self._either.register(self._line, select.POLLIN)

    @property
    def wanted(self) -> bool:
        """Whether nobody has released the port yet."""
        return not self._released.is_set()

    def read(self, timeout_s: float) -> bytes:
        """Return what is there, waiting for the first byte at most ``timeout_s``; nothing where none came or somebody rang."""
        ready = self._either.poll(timeout_s * 1e3)
        data = self._take() if any(descriptor == self._line for descriptor, _ in ready) else b""
        if ready and not data:
            self._hear(ready)
        return data

    def read_on(self) -> bytes:
        """Return what comes next on a line that always brings something; nothing after a tenth of a second of silence, or where somebody
        rang before.
        """
        if self._rang:
            self._quiet()
            return b""
        return self._take()

    def write(self, data: bytes) -> None:
        """Send ``data`` and wait until it has left."""
        try:
            self._serial.write(data)
            self._serial.flush()
        except (OSError, termios.error) as error:
            raise _loss(self.name, str(error)) from error

    def pause(self, seconds: float) -> None:
        """Wait, but not beyond the release of the port, nor where somebody is in a hurry."""
        if ready := self._rung.poll(max(seconds, 0.0) * 1e3):
            self._hear(ready)

    def hurry(self) -> None:
        """Say that what is there is wanted now: ends a pause and a read."""
        with self._closing:
            if self._serial.is_open:
                os.eventfd_write(self._bell, 1)
                self._rang = True

    def release(self) -> None:
        """Say that the port is not wanted any more; ends every pause and read from now on."""
        self._released.set()
        self.hurry()

    def close(self) -> None:
        """Close the port."""
        with self._closing:
            if self._serial.is_open:
                self._serial.close()
                os.close(self._bell)

    def _take(self) -> bytes:
        try:
            data = os.read(self._line, LARGEST_READ)
        except OSError as error:
            raise _loss(self.name, str(error)) from error
        if data:
            self.last_byte_s = time.monotonic()
        return data

    def _hear(self, ready: list[tuple[int, int]]) -> None:
        """Quiet the bell; a line that was ready and gave nothing is none any more."""
        if any(descriptor == self._line for descriptor, _ in ready):
            raise _loss(self.name, "it hung up")
        self._quiet()

    def _quiet(self) -> None:
        """Quiet the bell, unless it rang for good."""
        with self._closing:
            self._rang = self._released.is_set()
            if not self._rang:
                os.eventfd_read(self._bell)


def _let_reads_wait(line: int) -> None:
    """Have a read of an empty line wait, instead of failing at once as pyserial leaves it."""
    attributes = termios.tcgetattr(line)
    attributes[6][termios.VMIN], attributes[6][termios.VTIME] = 0, _BUSY_WAIT_DS
    termios.tcsetattr(line, termios.TCSANOW, attributes)
    os.set_blocking(line, True)


def _set_low_latency(port: serial.Serial) -> bool:
    """Ask the adapter not to sit on bytes (FTDI: 1 ms instead of 16); return whether it agreed. Many ports have no such mode."""
    try:
        port.set_low_latency_mode(True)
    except (ValueError, OSError, NotImplementedError):
        return False
    return True


def _refusal(name: str, error: Exception) -> DeviceError:
    if isinstance(error, termios.error):
        remedy = "check baud, bytesize, parity and stopbits in the survey against what the port can do"
        return DeviceError(f"serial port {name}", expected="a port that takes these settings", found=str(error.args[-1]), remedy=remedy)
    code = error.errno if isinstance(error, OSError) else None
    found = os.strerror(code) if code else str(error)
    remedy = _REMEDIES.get(code or 0, "check the port and its settings in the survey")
    return DeviceError(f"serial port {name}", expected="a port that opens", found=found, remedy=remedy)


def _loss(name: str, why: str) -> DeviceError:
    remedy = "check the cable; the program reconnects by itself"
    return DeviceError(f"serial port {name}", expected="a port that stays", found=f"it is gone ({why})", remedy=remedy)
