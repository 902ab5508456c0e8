"""The stream of a 4-DOF head: binary frames or ASCII lines (docs/fourdof-frames.md)."""

import binascii
import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import message
from stepdiag.daq.formats.framing.batch import Batch, judge_beam, mark
from stepdiag.daq.formats.framing.checks import require
from stepdiag.daq.formats.framing.counter import CounterTrack, Wrap
from stepdiag.daq.formats.framing.frames import FrameBuffer, Frames, Junk
from stepdiag.daq.formats.framing.lines import LineBuffer, quote
from stepdiag.daq.timing.samples import Flag, Samples


@dataclass(frozen=True, slots=True, kw_only=True)
class FourdofSettings:
    """Settings of the head.

    ``full_sum`` is the sum signal of QD, PSD 1 and PSD 2 at full beam, in the head's units. With
    ``full_sum`` the beam strength (0 to 1) is the weakest of the three sums divided by
    ``full_sum``. The beam is lost below ``beam_threshold``, and weak below twice
    ``beam_threshold``.
    """

    encoding: Literal["binary", "ascii"] = "binary"
    rate_hz: float | None = None
    full_sum: tuple[float, float, float] | None = None
    beam_threshold: float = 0.2
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        full = self.full_sum
        require(
            full is None or min(full) > 0, "head.full_sum", message("three-above-0"), full
        )
        require(
            0 <= self.beam_threshold < 1,
            "head.beam_threshold",
            message("number-below-1"),
            self.beam_threshold,
        )
        require(
            self.rate_hz is None or self.rate_hz > 0,
            "head.rate_hz",
            message("number-above-0"),
            self.rate_hz,
        )


SYNC = b"\xf4\xd0"
FRAME_SIZE = 46
"""Bytes of a frame: sync 2, type 1, status 1, counter 4, nine values of 4 each, CRC 2. A line of
115200 baud (ten bits a byte) carries 250 frames a second.
"""
LINE_CAP = 256
"""Longest ASCII line in bytes; whole numbers of full length need 135 bytes, real numbers up to 200.
"""

_INT32, _FLOAT32 = b"if"
_SUMS = (2, 5, 8)
_SATURATED = 0b0000_0111
"""Bits of the status: the converter of QD, PSD 1 or PSD 2 is at the end of its range."""
_HEAD_FAULT = 0b1000_0000
_NUMBER = rb"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,2})?"
_LINE = re.compile(
    rb"\$(4D,([0-9]{1,10}),([0-9]{1,3})((?:,%b){9}))\*([0-9A-Fa-f]{4})\r?" % _NUMBER
)


def crc16(data: bytes) -> int:
    """Return the CRC-16 of a frame: polynomial 0x1021, start 0xFFFF, not reflected
    (CRC-16/CCITT-FALSE).
    """
    return binascii.crc_hqx(data, 0xFFFF)


@dataclass(frozen=True, slots=True)
class _Rows:
    counter: NDArray[np.int64]
    status: NDArray[np.int64]
    channels: NDArray[np.float64]


class FourdofDecoder:
    """Decoder of a 4-DOF head.

    ``channels`` has shape (count, 9): x, y and sum of QD, PSD 1 and PSD 2 in the head's units.
    Positions are NaN. A frame with a wrong CRC is garbage. A value that is not finite becomes NaN,
    and its sample gets the flag DEVICE_ERROR.
    """

    gaps_visible = True

    def __init__(self, settings: FourdofSettings) -> None:
        self._settings = settings
        self._frames = FrameBuffer(SYNC, FRAME_SIZE, _is_whole)
        self._lines = LineBuffer(LINE_CAP)
        self._track = CounterTrack([Wrap(0, 2**32 - 1, 1_000_000)])
        self.nominal_rate_hz = settings.rate_hz
        self.latency_s = settings.latency_s

    def resync(self) -> None:
        self._frames.clear()
        self._lines.skip_line()

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        batch = Batch()
        if self._settings.encoding == "binary":
            self._feed_binary(chunk, batch)
        else:
            self._feed_ascii(chunk, batch)
        return batch.samples(arrival_ns)

    def _feed_binary(self, chunk: bytes, batch: Batch) -> None:
        for part in self._frames.feed(chunk):
            if isinstance(part, Junk):
                batch.note("garbage", part.why)
            else:
                self._add(_binary_rows(part), batch)

    def _feed_ascii(self, chunk: bytes, batch: Batch) -> None:
        for line in self._lines.feed(chunk).split(b"\n")[:-1]:
            rows = _ascii_row(line) if len(line) <= LINE_CAP else None
            if rows is not None:
                self._add(rows, batch)
            elif line.strip():
                batch.note("garbage", message("line-no-frame", quoted=quote(line)))

    def _add(self, rows: _Rows, batch: Batch) -> None:
        followed = self._track.follow(rows.counter)
        batch.remark(followed.breaks, followed.keep)
        status, channels = rows.status[followed.keep], rows.channels[followed.keep]
        flags = np.zeros(len(status), dtype=np.uint16)
        wrong = ~np.isfinite(channels)
        channels[wrong] = np.nan
        mark(flags, (status & _SATURATED) != 0, Flag.SATURATED)
        mark(flags, ((status & _HEAD_FAULT) != 0) | wrong.any(axis=1), Flag.DEVICE_ERROR)
        beam = self._beam(channels)
        judge_beam(beam, self._settings.beam_threshold, flags)
        batch.add(
            followed.counter,
            np.full(len(status), np.nan),
            flags,
            beam=beam,
            channels=channels,
        )

    def _beam(self, channels: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._settings.full_sum is None:
            return np.full(len(channels), np.nan)
        weakest: NDArray[np.float64] = np.min(
            channels[:, _SUMS] / np.array(self._settings.full_sum), axis=1
        )
        return np.clip(weakest, 0.0, 1.0)


def _is_whole(frame: bytes) -> bool:
    return frame[2] in (_INT32, _FLOAT32) and crc16(frame[2:44]) == int.from_bytes(
        frame[44:46], "little"
    )


def _binary_rows(frames: Frames) -> _Rows:
    values = np.ascontiguousarray(frames[:, 8:44])
    with np.errstate(invalid="ignore"):  # the received bytes may contain a signalling NaN
        channels = np.where(
            frames[:, 2:3] == _INT32,
            values.view("<i4").astype(np.float64),
            values.view("<f4").astype(np.float64),
        )
    counter = np.ascontiguousarray(frames[:, 4:8]).view("<u4").ravel().astype(np.int64)
    return _Rows(counter, frames[:, 3].astype(np.int64), channels)


def _ascii_row(line: bytes) -> _Rows | None:
    found = _LINE.fullmatch(line)
    if found is None or crc16(found[1]) != int(found[5], 16):
        return None
    channels = np.array([found[4][1:].split(b",")], dtype=np.float64)
    return _Rows(np.array([int(found[2])]), np.array([int(found[3])]), channels)
