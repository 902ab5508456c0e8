"""A serial port of this computer.

pyserial sets up the line, but this module reads with one read(2): pyserial's ``read`` makes four
system calls, each with a release of the interpreter lock, and needs twice the time.
"""

import errno
import fcntl
import os
import struct
import termios
from pathlib import Path

import serial
from serial.tools import list_ports

from stepdiag.base.errors import DeviceError, system_words
from stepdiag.base.messages import message
from stepdiag.daq.links.ports.device import (
    BUSY_WAIT_S,
    LARGEST_READ,
    LossKind,
    SerialSettings,
)

_REMEDIES = {
    errno.ENOENT: message("do-plugged"),
    errno.EACCES: message("do-right"),
    errno.EBUSY: message("do-other-program"),
    errno.EAGAIN: message("do-other-program"),
}


BY_ID = Path("/dev/serial/by-id")
TIOCGICOUNT = 0x545D
"""Request that reads the driver's counts (ioctl_tty(2)), which is missing in `termios`."""
_COUNTS = struct.Struct("20i")
"""serial_icounter_struct of linux/serial.h: cts, dsr, rng, dcd, rx, tx, frame, overrun, parity,
brk, buf_overrun, nine reserved.
"""
_LOSSES: dict[int, LossKind] = {
    7: "lost-port",
    10: "lost-system",
    6: "lost-framing",
    8: "lost-parity",
    9: "lost-break",
}


class Tty:
    """An open serial port. Raises DeviceError if the port does not open or does not accept the
    settings.
    """

    def __init__(self, settings: SerialSettings) -> None:
        try:
            self._serial = serial.Serial(
                baudrate=settings.baud,
                bytesize=settings.bytesize,
                parity=settings.parity,
                stopbits=settings.stopbits,
                exclusive=True,
            )
            self._serial.dtr, self._serial.rts = settings.dtr, settings.rts
            self._serial.port = settings.port
            self._serial.open()
            # pyserial then sets up the line a second time: only then does a port report settings
            # that it does not accept
            self._serial.timeout = 0.0
            self._line = self._serial.fileno()
            _let_reads_wait(self._line)
        except (OSError, ValueError, termios.error) as error:
            raise _refusal(settings.port, error) from error
        self.low_latency = _set_low_latency(self._serial)
        self._counted = self._counts()
        latency = message("low-latency") if self.low_latency else message("no-low-latency")
        self.detail = message(
            "port-settings", port=settings.port, baud=settings.baud, latency=latency
        )

    def fileno(self) -> int:
        return self._line

    def read(self, *, ready: bool) -> bytes:
        """Return the bytes that have arrived. A line that was ready and delivers no byte is
        lost.
        """
        data = os.read(self._line, LARGEST_READ)
        if ready and not data:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        return data

    def write(self, data: bytes) -> None:
        try:
            self._serial.write(data)
            self._serial.flush()
        except termios.error as error:
            raise OSError(*error.args) from error

    def lost(self) -> dict[LossKind, int]:
        """Return the driver's counts of each kind of loss since the opening of the port; empty for
        a pty, which has no counts.
        """
        now = self._counts()
        more = (
            [after - before for before, after in zip(self._counted, now, strict=True)]
            if len(now) == len(self._counted)
            else []
        )
        return {kind: more[at] for at, kind in _LOSSES.items() if more and more[at] > 0}

    def _counts(self) -> tuple[int, ...]:
        try:
            return _COUNTS.unpack(fcntl.ioctl(self._line, TIOCGICOUNT, bytes(_COUNTS.size)))
        except OSError:
            return ()

    def close(self) -> None:
        self._serial.close()


def _let_reads_wait(line: int) -> None:
    """Let a read of an empty line wait (termios(3): in tenths of a second); with pyserial's setting
    the read would fail at once.
    """
    attributes = termios.tcgetattr(line)
    attributes[6][termios.VMIN], attributes[6][termios.VTIME] = 0, round(BUSY_WAIT_S * 10)
    termios.tcsetattr(line, termios.TCSANOW, attributes)
    os.set_blocking(line, True)


def _set_low_latency(port: serial.Serial) -> bool:
    """Let the USB adapter pass bytes on sooner (FTDI: after 1 ms instead of 16 ms); return whether
    the port accepted. Many ports lack this mode.
    """
    try:
        port.set_low_latency_mode(True)
    except (ValueError, OSError, NotImplementedError):
        return False
    return True


def present_ports() -> dict[str, str]:
    """Return the serial ports of this computer with a device: the permanent name (``by-id``) if it
    exists, and the name of the adapter.
    """
    stable = {str(link.resolve()): str(link) for link in sorted(BY_ID.glob("*"))}
    return {
        stable.get(each.device, each.device): each.description
        if each.description != "n/a"
        else each.device
        for each in list_ports.comports()
    }


def _refusal(name: str, error: Exception) -> DeviceError:
    if isinstance(error, termios.error):
        return DeviceError(
            message("where-serial", name=name),
            expected=message("expects-port-settings"),
            found=str(error.args[-1]),
            remedy=message("do-port-can"),
        )
    code = error.errno if isinstance(error, OSError) else None
    remedy = _REMEDIES.get(code or 0, message("do-port-survey"))
    if code == errno.ENOENT and (present := list(present_ports())):
        remedy = message(
            "do-other-port", ports=present
        )  # an adapter that was plugged in again may have another number
    return DeviceError(
        message("where-serial", name=name),
        expected=message("expects-opens"),
        found=system_words(code or error),
        remedy=remedy,
    )
