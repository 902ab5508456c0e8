"""`nd`: Heidenhain ND position displays over RS-232, polled (reference: instruments 1.B; manuals of
ND 287, ND 281 B, ND 720).
"""

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stepdiag.base.messages import Message, message
from stepdiag.daq.formats.framing.batch import Batch
from stepdiag.daq.formats.framing.checks import require, require_sign
from stepdiag.daq.formats.framing.lines import quote
from stepdiag.daq.timing.samples import Flag, Samples


@dataclass(frozen=True, slots=True, kw_only=True)
class NdSettings:
    """Settings of an ND display.

    ``value`` selects the current value (whole steps of ``resolution_mm``, a setting of the display)
    or the displayed value (with a decimal point, in ``unit``). ``axis`` is the number of the line
    in an answer, from 1, for displays with several axes.
    """

    value: Literal["current", "displayed"] = "current"
    axis: int = 1
    resolution_mm: float = 0.0001
    unit: Literal["mm", "inch"] = "mm"
    poll_hz: float = 20.0
    sign: int = 1
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        require(
            1 <= self.axis <= 8,
            "laser.nd.axis",
            message("whole-number-between", least=1, most=8),
            self.axis,
        )
        require(
            self.resolution_mm > 0,
            "laser.nd.resolution_mm",
            message("number-above-0"),
            self.resolution_mm,
        )
        require(
            0 < self.poll_hz <= 100,
            "laser.nd.poll_hz",
            message("number-up-to", most=100),
            self.poll_hz,
        )
        require_sign(self.sign)


ANSWER_CAP = 256
"""Longest line of an answer in bytes; the longest line in the manual is an error text of the length
of the display.
"""

_STX, _ACK, _LF, _NAK = 0x02, 0x06, 0x0A, 0x15
_REQUESTS = {"current": b"\x1bA0200\r", "displayed": b"\x1bA0100\r"}
_GRAMMAR = {
    "current": re.compile(rb"[+-][0-9]{1,9}"),  # sign and nine digits, no decimal point
    "displayed": re.compile(
        rb"[+-]?[0-9]*\.?[0-9]+"
    ),  # the displayed value: ten to thirteen characters with the decimal point
}
_MM_PER_UNIT = {"mm": 1.0, "inch": 25.4}


class NdDecoder:
    """Decoder of an ND display.

    An answer is STX, then a line per axis, ended by CR LF. NAK, or a text instead of a number,
    gives a notice and a sample with position NaN and flag DEVICE_ERROR. The host numbers the
    answers; a lost answer is not noticed.
    """

    gaps_visible = False

    def __init__(self, settings: NdSettings) -> None:
        self._settings = settings
        self._grammar = _GRAMMAR[settings.value]
        unit_mm = (
            settings.resolution_mm
            if settings.value == "current"
            else _MM_PER_UNIT[settings.unit]
        )
        self._mm = settings.sign * unit_mm
        self._line = bytearray()
        self._axis = 0
        """The axis of the next line, from 1; 0 outside an answer."""
        self._number = 0
        self.request = _REQUESTS[settings.value]
        self.poll_interval_s = 1 / settings.poll_hz
        self.nominal_rate_hz: float | None = settings.poll_hz
        self.latency_s = settings.latency_s

    def resync(self) -> None:
        self._line.clear()
        self._axis = 0

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        batch = Batch()
        for byte in chunk:
            self._take(byte, batch)
        return batch.samples(arrival_ns)

    def _take(self, byte: int, batch: Batch) -> None:
        if byte == _STX:
            self._drop_half_answer(batch)
            self._axis = 1
        elif byte == _NAK:
            self.resync()
            self._add_refusal(message("display-refuses"), batch)
        elif byte == _LF:
            line = bytes(self._line).strip()
            self._line.clear()
            if line:
                self._take_line(line, batch)
        elif byte != _ACK:
            self._line.append(byte)
            if len(self._line) > ANSWER_CAP:
                self._add_garbage(bytes(self._line), batch)
                self.resync()

    def _take_line(self, line: bytes, batch: Batch) -> None:
        if not self._axis:
            self._add_garbage(line, batch)
            return
        if self._axis == self._settings.axis:
            if self._grammar.fullmatch(line):
                self._add(float(line) * self._mm, Flag(0), batch)
            else:
                self._add_refusal(message("display-instead", quoted=quote(line)), batch)
        self._axis += 1

    def _drop_half_answer(self, batch: Batch) -> None:
        if self._line or 0 < self._axis <= self._settings.axis:
            batch.note(
                "device",
                message(
                    "answer-ended", axis=self._settings.axis, quoted=quote(bytes(self._line))
                ),
            )
        self.resync()

    def _add_garbage(self, raw: bytes, batch: Batch) -> None:
        batch.note("garbage", message("no-display-answer", quoted=quote(raw)))

    def _add_refusal(self, why: Message, batch: Batch) -> None:
        batch.note("device", why)
        self._add(float("nan"), Flag.DEVICE_ERROR, batch)

    def _add(self, position_mm: float, flag: Flag, batch: Batch) -> None:
        batch.add(
            np.array([self._number]),
            np.array([position_mm]),
            np.array([flag], dtype=np.uint16),
        )
        self._number += 1
