"""`tqd`: Thorlabs KPA101 and TPA101 quadrant detectors, APT binary protocol, polled (reference:
instruments 1.C).
"""

import struct
from dataclasses import dataclass

import numpy as np

from stepdiag.base.messages import message
from stepdiag.daq.formats.framing.batch import Batch, judge_beam, mark
from stepdiag.daq.formats.framing.checks import require
from stepdiag.daq.formats.framing.frames import FrameBuffer, Frames, Junk
from stepdiag.daq.timing.samples import Flag, Samples


@dataclass(frozen=True, slots=True, kw_only=True)
class TqdSettings:
    """Settings of a quadrant detector. ``full_sum_v`` is the sum signal at full beam in volts. The
    beam is lost below ``full_sum_v`` times ``beam_threshold``, and weak below twice this limit.
    """

    poll_hz: float = 50.0
    full_sum_v: float = 10.0
    beam_threshold: float = 0.2
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        require(
            0 < self.poll_hz <= 200,
            "head.poll_hz",
            message("number-up-to", most=200),
            self.poll_hz,
        )
        require(
            0 < self.full_sum_v <= 40,
            "head.full_sum_v",
            message("number-up-to", most=40),
            self.full_sum_v,
        )
        require(
            0 <= self.beam_threshold < 1,
            "head.beam_threshold",
            message("number-below-1"),
            self.beam_threshold,
        )


_READINGS_REQUEST = struct.pack("<HBBBB", 0x0871, 0x03, 0x00, 0x50, 0x01)
"""The request for readings: message 0x0871 with parameter 3 from the host 0x01 to the unit 0x50."""
_ANSWER_BEGINS = struct.pack("<HHBBH", 0x0872, 12, 0x01 | 0x80, 0x50, 0x03)
"""Beginning of message 0x0872 with 12 bytes of data for the host; the first two data bytes repeat
the parameter.
"""
_ANSWER_SIZE = 18
_FULL_SCALE = 32767
_VOLTS_PER_COUNT = np.array([10.0, 10.0, 20.0]) / _FULL_SCALE
"""Volts per count of x difference, y difference and sum: the differences have a range of 10 V, the
sum of 20 V.
"""


class TqdDecoder:
    """Decoder of a quadrant detector.

    ``channels`` has shape (count, 3): x difference, y difference and sum in volts, with the signs
    of the unit. The unit is known to invert x; the calibration of the head finds the sign.
    Positions are NaN. The host numbers the answers.
    """

    gaps_visible = False

    def __init__(self, settings: TqdSettings) -> None:
        self._settings = settings
        self._frames = FrameBuffer(_ANSWER_BEGINS, _ANSWER_SIZE, lambda _: True)
        self._number = 0
        self.request = _READINGS_REQUEST
        self.poll_interval_s = 1 / settings.poll_hz
        self.nominal_rate_hz: float | None = settings.poll_hz
        self.latency_s = settings.latency_s

    def resync(self) -> None:
        self._frames.clear()

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        """Return the answers that ``chunk`` completes, one sample per answer. A message that is no
        answer is a garbage notice.
        """
        batch = Batch()
        for part in self._frames.feed(chunk):
            if isinstance(part, Junk):
                batch.note("garbage", message("junk-reading", count=part.count))
            else:
                self._add(part, batch)
        return batch.samples(arrival_ns)

    def _add(self, frames: Frames, batch: Batch) -> None:
        differences = np.ascontiguousarray(frames[:, 8:12]).view("<i2").astype(np.int64)
        total = np.ascontiguousarray(frames[:, 12:14]).view("<u2").astype(np.int64)
        channels = np.hstack([differences, total]) * _VOLTS_PER_COUNT
        flags = np.zeros(len(frames), dtype=np.uint16)
        mark(
            flags,
            (np.abs(differences) >= _FULL_SCALE).any(axis=1) | (total[:, 0] == 0xFFFF),
            Flag.SATURATED,
        )
        beam = np.clip(channels[:, 2] / self._settings.full_sum_v, 0.0, 1.0)
        judge_beam(beam, self._settings.beam_threshold, flags)
        counter = np.arange(self._number, self._number + len(frames), dtype=np.int64)
        self._number += len(frames)
        batch.add(counter, np.full(len(frames), np.nan), flags, beam=beam, channels=channels)
