"""Sensors of air and material on a separate line: a transmitter that answers requests, and a logger
that sends without requests."""

from stepdiag.virtual.instruments.counting import Counting
from stepdiag.virtual.instruments.interferometers import AskClimate
from stepdiag.virtual.physics.error_functions import Array


class Transmitter:
    """A PTU300 with echo and prompt: it answers each ``SEND`` with a line
    (`stepdiag.virtual.instruments.talker.Answering`)."""

    def __init__(self, climate: AskClimate) -> None:
        self._climate = climate
        self._held = b""

    def requests(self, received: bytes) -> list[bytes]:
        *whole, self._held = (self._held + received).split(b"\r")
        return whole

    def answer(self, request: bytes, wall_s: float) -> bytes:  # noqa: ARG002 - the air of now
        """Return the answer to a command: the echo, the values and a prompt."""
        if request.strip().upper() != b"SEND":
            return request + b"\r\nUnknown command\r\n>"
        now = self._climate()
        values = (
            f"P= {now.pressure_hpa:7.2f} hPa T={now.air_c:6.2f} 'C "
            f"RH={now.humidity_percent:6.2f} %RH"
        )
        return request + b"\r\n" + values.encode("ascii") + b"\r\n>"

    def watch(self, wall_s: float) -> None:
        """Do nothing: an unrequested measurement has no effect."""


class Logger(Counting):
    """A logger that sends four lines per second: temperature, pressure in kPa, humidity, and the
    value of a probe on the machine (`Talking`)."""

    def __init__(self, climate: AskClimate) -> None:
        super().__init__()
        self.rate_hz = 4.0
        self._climate = climate

    def speak(self, wall_s: Array) -> bytes:
        now = self._climate()
        line = (
            f"{now.air_c:+.2f};{now.pressure_hpa / 10.0:.4f};{now.humidity_percent:.1f};"
            f"{now.material_c:+.3f}\r\n"
        )
        return line.encode("ascii") * len(wall_s)
