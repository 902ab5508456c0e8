"""`frames`: any instrument that sends a binary frame of fixed size per sample; the survey file
describes the frame.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import message
from stepdiag.daq.formats.framing.batch import Batch, judge_beam, mark
from stepdiag.daq.formats.framing.checks import require, require_interferometer, require_sign
from stepdiag.daq.formats.framing.checksums import CHECKSUMS
from stepdiag.daq.formats.framing.counter import LONGEST_WRAP_GAP, CounterTrack, Wrap
from stepdiag.daq.formats.framing.frames import FrameBuffer, Frames, Junk
from stepdiag.daq.formats.framing.layout import ByteOrder, Place, read_layout
from stepdiag.daq.formats.framing.units import Unit, mm_per_unit
from stepdiag.daq.timing.samples import Flag, Samples

LARGEST_FRAME = 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class FramesSettings:
    """Format of a frame and meaning of its numbers.

    A frame is ``sync`` (hexadecimal), the numbers of ``layout`` in their order, and a checksum over
    the bytes from byte ``checksum_from`` to the checksum. Position in mm = number x ``scale`` x
    ``unit``. ``lost_bits``, ``error_bits`` and ``good_bits`` are masks of ``status``. A set bit of
    ``lost_bits`` is a lost beam. A set bit of ``error_bits`` is a fault of the instrument. A
    cleared bit of ``good_bits`` is a fault, too.
    """

    sync: str
    layout: tuple[str, ...]
    byte_order: ByteOrder = "little"
    checksum: str = "none"
    checksum_from: int = 0
    checksum_order: ByteOrder | None = None
    unit: Unit = "mm"
    scale: float = 1.0
    beam_full: float = 1.0
    beam_threshold: float = 0.2
    lost_bits: int = 0
    error_bits: int = 0
    good_bits: int = 0
    rate_hz: float | None = None
    wavelength_nm: float = 632.991
    optics: int = 1
    sign: int = 1
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        require(
            0 < len(self.sync_bytes) <= 16,
            "laser.frames.sync",
            message("sync-bytes"),
            self.sync,
        )
        places, _ = read_layout(self.layout, len(self.sync_bytes))
        require(
            "position" in places,
            "laser.frames.layout",
            message("field-position"),
            list(self.layout),
        )
        require(
            self.size <= LARGEST_FRAME,
            "laser.frames.layout",
            message("frames-at-most", count=LARGEST_FRAME),
            self.size,
        )
        require(
            self.checksum in CHECKSUMS,
            "laser.frames.checksum",
            message("one-of", names=list(CHECKSUMS)),
            self.checksum,
        )
        require(
            0 <= self.checksum_from < self.size,
            "laser.frames.checksum_from",
            message("byte-of-frame"),
            self.checksum_from,
        )
        for name in ("counter", "status"):
            require(
                name not in places or places[name].kind != "f",
                "laser.frames.layout",
                message("whole-number-for", name=name),
                list(self.layout),
            )
        for name in ("lost_bits", "error_bits", "good_bits"):
            mask = getattr(self, name)
            require(
                not mask or "status" in places,
                f"laser.frames.{name}",
                message("zero-without-status"),
                mask,
            )
            require(mask >= 0, f"laser.frames.{name}", message("mask-of-bits"), mask)
        require(self.scale != 0, "laser.frames.scale", message("number-not-zero"), self.scale)
        require(
            self.beam_full > 0,
            "laser.frames.beam_full",
            message("number-above-0"),
            self.beam_full,
        )
        require(
            0 <= self.beam_threshold < 1,
            "laser.frames.beam_threshold",
            message("number-below-1"),
            self.beam_threshold,
        )
        require(
            self.rate_hz is None or self.rate_hz > 0,
            "laser.frames.rate_hz",
            message("number-above-0"),
            self.rate_hz,
        )
        require_interferometer(self.wavelength_nm, self.optics)
        require_sign(self.sign)

    @property
    def sync_bytes(self) -> bytes:
        """Return the first bytes of every frame; empty if ``sync`` is not hexadecimal."""
        try:
            return bytes.fromhex(self.sync)
        except ValueError:
            return b""

    @property
    def places(self) -> dict[str, Place]:
        return read_layout(self.layout, len(self.sync_bytes))[0]

    @property
    def size(self) -> int:
        """Return the size of a frame in bytes."""
        return read_layout(self.layout, len(self.sync_bytes))[1] + (
            CHECKSUMS[self.checksum].size if self.checksum in CHECKSUMS else 0
        )


class FramesDecoder:
    """Decoder of frames that the survey file describes.

    Bytes outside every frame are a garbage notice that contains the first of these bytes. A
    position that is not finite becomes NaN, and its sample gets the flag DEVICE_ERROR. Without a
    counter in the frame the program numbers the frames, and a lost frame is not noticed.
    """

    def __init__(self, settings: FramesSettings) -> None:
        self._settings = settings
        self._places = settings.places
        self._checksum = CHECKSUMS[settings.checksum]
        self._frames = FrameBuffer(settings.sync_bytes, settings.size, self._is_whole)
        self._mm = (
            settings.sign
            * settings.scale
            * mm_per_unit(settings.unit, settings.wavelength_nm, settings.optics)
        )
        counter = self._places.get("counter")
        self._track = CounterTrack(_wraps(counter))
        self.repeats_after = 2.0 ** (8 * counter.size) if counter is not None else math.inf
        self._number = 0
        self.nominal_rate_hz = settings.rate_hz
        self.gaps_visible = "counter" in self._places
        self.latency_s = settings.latency_s

    def resync(self) -> None:
        self._frames.clear()

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        batch = Batch()
        for part in self._frames.feed(chunk):
            if isinstance(part, Junk):
                batch.note("garbage", part.why)
            else:
                self._add(part, batch)
        return batch.samples(arrival_ns)

    def _is_whole(self, frame: bytes) -> bool:
        checksum, settings = self._checksum, self._settings
        if not checksum.size:
            return True
        end = len(frame) - checksum.size
        checksum_sent = int.from_bytes(
            frame[end:], settings.checksum_order or settings.byte_order
        )
        return checksum_sent == checksum.of(frame[settings.checksum_from : end])

    def _add(self, frames: Frames, batch: Batch) -> None:
        settings = self._settings
        followed = self._track.follow(self._counter(frames))
        batch.remark(followed.breaks, followed.keep)
        kept = frames[followed.keep]
        position_mm = self._column(kept, "position").astype(np.float64) * self._mm
        flags = np.zeros(len(kept), dtype=np.uint16)
        wrong = ~np.isfinite(position_mm)
        position_mm[wrong] = np.nan
        mark(flags, wrong, Flag.DEVICE_ERROR)
        if "status" in self._places:
            status = self._column(kept, "status").astype(np.int64)
            mark(flags, (status & settings.lost_bits) != 0, Flag.BEAM_LOST)
            mark(
                flags,
                ((status & settings.error_bits) != 0)
                | ((status & settings.good_bits) != settings.good_bits),
                Flag.DEVICE_ERROR,
            )
        beam = None
        if "beam" in self._places:
            beam = np.clip(
                np.nan_to_num(self._column(kept, "beam").astype(np.float64))
                / settings.beam_full,
                0.0,
                1.0,
            )
            judge_beam(beam, settings.beam_threshold, flags)
        batch.add(followed.counter, position_mm, flags, beam=beam)

    def _counter(self, frames: Frames) -> NDArray[np.int64]:
        if self.gaps_visible:
            return self._column(frames, "counter").astype(np.int64)
        first, self._number = self._number, self._number + len(frames)
        return np.arange(first, self._number, dtype=np.int64)

    def _column(self, frames: Frames, name: str) -> NDArray[np.float64] | NDArray[np.int64]:
        return self._places[name].column(frames, self._settings.byte_order)


def _wraps(counter: Place | None) -> Sequence[Wrap]:
    if counter is None or counter.size == 8:
        return ()
    values = 1 << 8 * counter.size
    low = -values // 2 if counter.kind == "i" else 0
    return (Wrap(low, low + values - 1, min(values // 2, LONGEST_WRAP_GAP)),)
