"""A serial port of this computer (`daq.links.ports.device.Device`).

pyserial sets the line up; reading is one read(2) here: its own ``read`` makes four calls, each of which lets go of the interpreter and
may wait for it, and costs twice the time.
"""

import errno
import fcntl
import os
import struct
import termios

import serial

from stepdiag.base.errors import DeviceError
from stepdiag.daq.links.ports.device import BUSY_WAIT_S, LARGEST_READ, SerialSettings

_REMEDIES = {
    errno.ENOENT: "check that the device is plugged in and that the survey names its port (a stable name is under /dev/serial/by-id)",
    errno.EACCES: "give the user the right to the port (group dialout, or the udev rule that comes with the program)",
    errno.EBUSY: "another program has the port open: end it",
    errno.EAGAIN: "another program has the port open: end it",
}


TIOCGICOUNT = 0x545D
"""ioctl_tty(2); not in `termios`."""
_COUNTS = struct.Struct("20i")
"""serial_icounter_struct of linux/serial.h: cts, dsr, rng, dcd, rx, tx, frame, overrun, parity, brk, buf_overrun, nine reserved."""
_LOSSES = {
    7: "the port's own buffer ran over {times}, adapter or computer were too slow",
    10: "the system's buffer ran over {times}, this program did not read in time",
    6: "framing was wrong {times}, look at baud rate, line settings and cable",
    8: "parity was wrong {times}, look at parity and cable",
    9: "the line was broken {times}, look at plug and cable",
}


class Tty:
    """An open serial port. Raises DeviceError where it does not open, or does not take the settings."""

    def __init__(self, settings: SerialSettings) -> None:
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
        self._counted = self._counts()
        latency = "low latency" if self.low_latency else "no low-latency mode"
        self.detail = f"{settings.port}, {settings.baud} baud, {latency}"

    def fileno(self) -> int:
        """Return the descriptor of the line."""
        return self._line

    def read(self, *, ready: bool) -> bytes:
        """Return what there is. A line that was ready and gives nothing is none any more."""
        data = os.read(self._line, LARGEST_READ)
        if ready and not data:
            raise OSError("it hung up")
        return data

    def write(self, data: bytes) -> None:
        """Send ``data`` and wait until it has left."""
        try:
            self._serial.write(data)
            self._serial.flush()
        except termios.error as error:
            raise OSError(str(error)) from error

    def lost(self) -> dict[str, int]:
        """Return how often the driver counted each kind of loss since the port was opened; nothing where it does not count (a pty)."""
        now = self._counts()
        more = [after - before for before, after in zip(self._counted, now, strict=True)] if len(now) == len(self._counted) else []
        return {words: more[at] for at, words in _LOSSES.items() if more and more[at] > 0}

    def _counts(self) -> tuple[int, ...]:
        try:
            return _COUNTS.unpack(fcntl.ioctl(self._line, TIOCGICOUNT, bytes(_COUNTS.size)))
        except OSError:
            return ()

    def close(self) -> None:
        """Close the port."""
        self._serial.close()


def _let_reads_wait(line: int) -> None:
    """Have a read of an empty line wait, instead of failing at once as pyserial leaves it (termios(3): in tenths of a second)."""
    attributes = termios.tcgetattr(line)
    attributes[6][termios.VMIN], attributes[6][termios.VTIME] = 0, round(BUSY_WAIT_S * 10)
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
