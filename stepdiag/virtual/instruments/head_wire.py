"""The bytes of heads: `fourdof` frames (docs/fourdof-frames.md), and the messages (APT) of the
Thorlabs quadrant detector."""

import struct
from collections.abc import Callable
from typing import Literal

import numpy as np

from stepdiag.virtual.instruments.counting import Counting
from stepdiag.virtual.instruments.head import Counts
from stepdiag.virtual.physics.error_functions import Array

Look = Callable[[Array], Counts]
"""A function from wall times (N,) to x, y and sum of QD, PSD1 and PSD2, shape (N, 9)."""

_SYNC = b"\xf4\xd0"
_SATURATION_COUNTS = 8_000_000


def frame_checksum(data: bytes) -> int:
    """Return CRC-16/CCITT-FALSE: polynomial 1021h, start FFFFh, most significant bit first."""
    register = 0xFFFF
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1 ^ (0x1021 if register & 0x8000 else 0)) & 0xFFFF
    return register


class FourdofHead(Counting):
    def __init__(
        self,
        look: Look,
        *,
        rate_hz: float = 250.0,
        encoding: Literal["binary", "ascii"] = "binary",
    ) -> None:
        super().__init__()
        self.rate_hz = rate_hz
        self._look = look
        self._encoding = encoding

    def speak(self, wall_s: Array) -> bytes:
        return b"".join(self._frame(values) for values in self._look(wall_s).tolist())

    def _frame(self, values: list[int]) -> bytes:
        counter, self._counter = self._counter, (self._counter + 1) % 2**32
        status = sum(
            1 << part
            for part in range(3)
            if max(map(abs, values[3 * part : 3 * part + 3])) >= _SATURATION_COUNTS
        )
        if self._encoding == "ascii":
            text = ",".join(["4D", str(counter), str(status), *map(str, values)])
            return f"${text}*{frame_checksum(text.encode('ascii')):04X}\r\n".encode("ascii")
        body = struct.pack("<cBI9i", b"i", status, counter, *values)
        return _SYNC + body + struct.pack("<H", frame_checksum(body))


_ASK = bytes.fromhex("71 08 03 00 50 01")
_TELL = bytes.fromhex("72 08 0c 00 81 50")
_HEADER = 6
_FULL_SCALE = 32767


class QuadrantDetector:
    """A KPA101/TPA101, a head with a QD only; message 0871h reads it
    (`stepdiag.virtual.instruments.talker.Answering`).

    The full sum of the optics is 8 V of the 20 V range. The sign of x is inverted, as in the real
    units.
    """

    def __init__(self, look: Look, *, full_sum: float) -> None:
        self._look = look
        self._volts = 8.0 / full_sum
        self._pending = b""

    def requests(self, received: bytes) -> list[bytes]:
        self._pending += received
        whole = len(self._pending) // _HEADER * _HEADER
        messages = [
            self._pending[start : start + _HEADER] for start in range(0, whole, _HEADER)
        ]
        self._pending = self._pending[whole:]
        return messages

    def answer(self, request: bytes, wall_s: float) -> bytes:
        """Return the readings for the message that requests them; any other message gets no
        answer."""
        if request != _ASK:
            return b""
        x, y, total = (value * self._volts for value in self._look(np.array([wall_s]))[0, :3])
        difference = [
            int(np.clip(round(volt / 10.0 * _FULL_SCALE), -_FULL_SCALE, _FULL_SCALE))
            for volt in (-x, y)
        ]
        level = int(np.clip(round(total / 20.0 * _FULL_SCALE), 0, 0xFFFF))
        return _TELL + struct.pack("<HhhHhh", 3, *difference, level, 0, 0)

    def watch(self, wall_s: float) -> None:
        """Do nothing: the quadrant detector keeps no samples."""
