"""`qudis`: quTools quDIS fibre interferometers, binary telegrams over TCP 2101.

Built from the maker's public protocol (bmonk-anl/qudisAsyn @a5cb69b, ``protocol/``), not yet tested
on the instrument. A telegram is five little-endian words (length of the rest, opcode, address,
index, correlation) and data. A reading has two words. Each word contains one half of a 48-bit
position in pm, and one half of a 14-bit counter of the edges at the marker input.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import message
from stepdiag.daq.formats.framing.batch import Batch
from stepdiag.daq.formats.framing.checks import require, require_sign
from stepdiag.daq.formats.framing.counter import CounterTrack, Wrap
from stepdiag.daq.formats.framing.frames import JUNK_CAP, Junk
from stepdiag.daq.timing.samples import Flag, Samples


@dataclass(frozen=True, slots=True, kw_only=True)
class QudisSettings:
    """Settings of a quDIS. ``axis`` counts from 1. A reading is a mean over 40 us x 2^``average``.
    ``absolute`` requests absolute distances from an instrument with this feature.
    """

    axis: Literal[1, 2, 3] = 1
    average: int = 5
    absolute: bool = False
    sign: int = 1
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        require(self.axis in (1, 2, 3), "laser.qudis.axis", "1, 2 or 3", self.axis)
        require(
            0 <= self.average <= 16,
            "laser.qudis.average",
            message("whole-number-between", least=0, most=16),
            self.average,
        )
        require_sign(self.sign)


LARGEST_TELEGRAM = 4096
_SET, _GET, _ACK, _TELL = 0, 1, 3, 4
_HEADER = struct.Struct("<5i")
_CHANNELS = 16
_TRIGGER, _SOURCE, _EVEN, _STATE = 0x0030, 0x0031, 0x0696, 0x0773
_EVENTS_ON, _DATA_ON, _AVERAGE, _MARKER_ON, _MARKER_RESET, _MARKER_TIMEOUT = (
    0x0145,
    0x0146,
    0x0771,
    0x07EB,
    0x07EC,
    0x07ED,
)
_DATA = 0x0F00
_NO_TRIGGER, _POSITIONS = 0, 2
_STATES = {0: message("wavelength-prepared"), 1: None, 2: message("wavelength-failed")}
_READY = 1
_REASONS = {
    1: message("reason-address"),
    2: message("reason-range"),
    3: message("reason-ignored"),
    4: message("reason-verify"),
    5: message("reason-type"),
}
_RATE_HZ = 25_000.0
_MM = 1e-9
_LOW24, _MARKER7, _HIGH_MARK = 0xFFFFFF, 0x7F, 1 << 31


def telegram(
    opcode: int, address: int, index: int = 0, *data: int, correlation: int = 0
) -> bytes:
    return _HEADER.pack(
        16 + 4 * len(data), opcode, address, index, correlation
    ) + struct.pack(f"<{len(data)}i", *data)


class QudisDecoder:
    """Decoder of a quDIS. ``channels``, shape (rows, 1), is the counter of the marker input: odd
    while the input is high.

    The protocol reports neither signal strength nor a lost beam: only the size of a step shows a
    lost count.
    """

    gaps_visible = True

    def __init__(self, settings: QudisSettings) -> None:
        self._settings = settings
        self._telegrams = _TelegramBuffer()
        self._track = CounterTrack(
            [Wrap(0, 2**32 - 1, 1_000_000), Wrap(0, 2**31 - 1, 1_000_000)]
        )
        self.repeats_after = 2.0**31
        self._state: int | None = None
        self._source = source = 2 * settings.axis - 1 + settings.absolute
        self._other_source = False
        self.greeting = b"".join(
            [
                *(
                    telegram(_SET, _TRIGGER, channel, _NO_TRIGGER)
                    for channel in range(_CHANNELS)
                ),
                telegram(_SET, _AVERAGE, 0, settings.average),
                *(
                    telegram(_SET, address, 0, value)
                    for address, value in (
                        (_MARKER_ON, 1),
                        (_MARKER_RESET, 1),
                        (_MARKER_TIMEOUT, 0),
                    )
                ),
                *(
                    telegram(_SET, address, 0, value)
                    for address, value in (
                        (_SOURCE, source),
                        (_EVEN, 1),
                        (_TRIGGER, _POSITIONS),
                    )
                ),
                *(telegram(_SET, address, 0, 1) for address in (_EVENTS_ON, _DATA_ON)),
                *(telegram(_GET, address, correlation=1) for address in (_STATE, _SOURCE)),
            ]
        )
        self.nominal_rate_hz: float | None = _RATE_HZ / 2**settings.average
        self.latency_s = settings.latency_s

    def resync(self) -> None:
        self._telegrams = _TelegramBuffer()

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        batch = Batch()
        for part in self._telegrams.feed(chunk):
            if isinstance(part, Junk):
                batch.note("garbage", part.why)
            else:
                self._take(part, batch)
        return batch.samples(arrival_ns)

    def _take(self, frame: bytes, batch: Batch) -> None:
        _, opcode, address, index, _ = _HEADER.unpack_from(frame)
        words = np.frombuffer(frame, dtype="<u4", offset=_HEADER.size).astype(np.int64)
        if opcode == _TELL and address == _DATA:
            self._add(index, words, batch)
        elif opcode == _TELL and _DATA < address < _DATA + _CHANNELS:
            batch.note("device", message("other-channel", channel=address - _DATA))
        elif opcode == _ACK and len(words) and words[0]:
            reason = _REASONS.get(int(words[0])) or message(
                "reason-number", number=int(words[0])
            )
            batch.note(
                "device",
                message("instrument-refuses", address=f"{address:04x}", reason=reason),
            )
        elif address == _STATE and len(words) == 1 + (opcode == _ACK):
            self._hear_state(int(words[-1]), batch)
        elif opcode == _ACK and address == _SOURCE and index == 0 and len(words) == 2:
            self._hear_source(int(words[1]), batch)

    def _hear_state(self, state: int, batch: Batch) -> None:
        if state != self._state and (
            why := _STATES.get(state, message("unknown-state", number=state))
        ):
            batch.note("device", why)
        self._state = state

    def _hear_source(self, source: int, batch: Batch) -> None:
        """Check the reported content of channel 0: an instrument without the requested axis or
        measuring mode reports another content.
        """
        self._other_source = source != self._source
        if self._other_source:
            batch.note("device", message("other-source", found=source, wanted=self._source))

    def _add(self, index: int, words: NDArray[np.int64], batch: Batch) -> None:
        low, high = words[0 : len(words) // 2 * 2 : 2], words[1::2]
        if (
            not len(high)
            or len(words) % 2
            or (low & _HIGH_MARK).any()
            or not (high & _HIGH_MARK).all()
        ):
            batch.note("garbage", message("words-unpaired", count=len(words)))
            return
        count = np.arange(len(low), dtype=np.int64) + (index & 0xFFFFFFFF)
        followed = self._track.follow(count)
        batch.remark(followed.breaks, followed.keep)
        halves = (high & _LOW24) << 24 | (low & _LOW24)
        position_mm = np.where(halves >= 1 << 47, halves - (1 << 48), halves)[
            followed.keep
        ] * (_MM * self._settings.sign)
        marker = ((low >> 24 & _MARKER7) | (high >> 24 & _MARKER7) << 7)[followed.keep]
        wrong = (
            Flag.DEVICE_ERROR
            if self._state not in (None, _READY) or self._other_source
            else Flag(0)
        )
        flags = np.full(len(position_mm), wrong, dtype=np.uint16)
        batch.add(
            followed.counter, position_mm, flags, channels=marker[:, None].astype(np.float64)
        )


class _TelegramBuffer:
    def __init__(self) -> None:
        self._held = b""
        self._junk = b""
        self._quoted = False
        self._passed = 0

    def feed(self, chunk: bytes) -> Iterator[bytes | Junk]:
        data, at = self._held + chunk, 0
        while len(data) - at >= 8:
            length, opcode = struct.unpack_from("<ii", data, at)
            if (
                not 16 <= length <= LARGEST_TELEGRAM - 4
                or length % 4
                or opcode not in (_SET, _GET, _ACK, _TELL)
            ):
                yield from self._pass_over(data[at : at + 1])
                at += 1
                continue
            if len(data) - at < 4 + length:
                break
            if self._passed:
                yield self._junk_so_far()
            self._quoted = False
            yield data[at : at + 4 + length]
            at += 4 + length
        self._held = data[at:]

    def _pass_over(self, byte: bytes) -> Iterator[Junk]:
        self._passed += 1
        if not self._quoted and len(self._junk) < 16:
            self._junk += byte
        if self._passed >= JUNK_CAP:
            yield self._junk_so_far()
            self._quoted = True

    def _junk_so_far(self) -> Junk:
        junk = Junk(self._passed, self._junk)
        self._passed, self._junk = 0, b""
        return junk
