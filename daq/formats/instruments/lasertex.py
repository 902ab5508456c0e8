"""`lasertex`: Lasertex HPI-3D and Status Pro uLine F1 machine tool lasers on a USB serial line of 3
Mbaud.

Built from the public implementation l-pio/pylinef1 (@ba679cd, 2022), not yet tested on the
instrument. A frame to the device has 8 bytes: AA, two bytes of command, four zeros, CRC. A frame
from the device has 16 bytes: AA, command, twelve bytes of data, CRC. The CRC is CRC-8/NRSC-5 over
the preceding bytes of the frame.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import message
from stepdiag.daq.formats.framing.batch import Batch, judge_beam, mark
from stepdiag.daq.formats.framing.checks import require, require_sign
from stepdiag.daq.formats.framing.checksums import CHECKSUMS
from stepdiag.daq.formats.framing.frames import FrameBuffer, Frames, Junk
from stepdiag.daq.formats.framing.layout import Place
from stepdiag.daq.timing.samples import Flag, Samples


@dataclass(frozen=True, slots=True, kw_only=True)
class LasertexSettings:
    """Settings of a Lasertex laser. ``level_full`` is the signal level at full beam (a byte; the
    source has no unit). The beam is lost below ``level_full`` times ``beam_threshold``.
    """

    level_full: float = 100.0
    beam_threshold: float = 0.2
    sign: int = 1
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        require(
            0 < self.level_full <= 255,
            "laser.lasertex.level_full",
            message("number-up-to", most=255),
            self.level_full,
        )
        require(
            0 <= self.beam_threshold < 1,
            "laser.lasertex.beam_threshold",
            message("number-below-1"),
            self.beam_threshold,
        )
        require_sign(self.sign)


RATE_HZ = 25.0
_SYNC, _SIZE = b"\xaa", 16
_CRC = CHECKSUMS["crc-8/nrsc-5"]
_DISTANCE, _VELOCITY, _WEATHER = 0xB015, 0xB016, 0xB00A
_STOP_ALL, _CLEAR_SIGNAL, _CLEAR_VELOCITY, _DISTANCE_ON, _WEATHER_ON = (
    0xB03C,
    0xB03D,
    0xB03F,
    0xB032,
    0xB079,
)
_ANSWERED = range(0xB030, 0xB080)
"""Commands that the device acknowledges by repeating the command."""
_VALUE = Place(3, 7, "i")
_MM = 1e-7
"""Unit of the distance in mm: 100 pm."""
_SPEED_BYTE, _SPEED = 12, 0x08
_STATE_BYTE, _LASER_READY, _SIGNAL_GOOD = 13, 0x01, 0x08
_LEVEL_BYTE = 14
_AIR_SENSOR = 0


def command(code: int) -> bytes:
    frame = _SYNC + code.to_bytes(2, "big") + bytes(4)
    return frame + bytes((_CRC.of(frame),))


class LasertexDecoder:
    """Decoder of a Lasertex laser.

    The laser has no sample counter: the host numbers the readings, and a lost reading is not
    noticed. The values of the laser's sensors of air and material are ``environment`` notices. The
    material temperature is the mean of the last values of all material sensors.
    """

    gaps_visible = False
    greeting = b"".join(
        map(command, (_STOP_ALL, _CLEAR_SIGNAL, _CLEAR_VELOCITY, _DISTANCE_ON, _WEATHER_ON))
    )

    def __init__(self, settings: LasertexSettings) -> None:
        self._settings = settings
        self._frames = FrameBuffer(_SYNC, _SIZE, _is_whole)
        self._number = 0
        self._material_c: dict[int, float] = {}
        self.nominal_rate_hz: float | None = RATE_HZ
        self.latency_s = settings.latency_s

    def resync(self) -> None:
        self._frames.clear()

    def responder(self) -> Callable[[bytes], bytes]:
        """Return a function that computes the answer to received bytes. The laser stores the flags
        of a lost beam until a command clears the flags. If the received bytes contain such a flag,
        the answer contains this command.
        """
        frames = FrameBuffer(_SYNC, _SIZE, _is_whole)

        def respond(data: bytes) -> bytes:
            messages = [part for part in frames.feed(data) if not isinstance(part, Junk)]
            distances = [row for part in messages for row in part if _code(row) == _DISTANCE]
            if not distances:
                return b""
            last = distances[-1]
            clear_signal = (
                command(_CLEAR_SIGNAL) if not last[_STATE_BYTE] & _SIGNAL_GOOD else b""
            )
            return clear_signal + (
                command(_CLEAR_VELOCITY) if last[_SPEED_BYTE] & _SPEED else b""
            )

        return respond

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        batch = Batch()
        for part in self._frames.feed(chunk):
            if isinstance(part, Junk):
                batch.note("garbage", part.why)
                continue
            codes = part[:, 1].astype(np.int64) << 8 | part[:, 2]
            for start, end in _runs(codes):
                self._take(int(codes[start]), part[start:end], batch)
        return batch.samples(arrival_ns)

    def _take(self, code: int, frames: Frames, batch: Batch) -> None:
        if code == _DISTANCE:
            self._add(frames, batch)
        elif code == _WEATHER:
            for frame in frames:
                self._hear_weather(bytes(frame), batch)
        elif code not in _ANSWERED and code != _VELOCITY:
            batch.note("garbage", message("frame-unknown", code=f"{code:04x}"))

    def _add(self, frames: Frames, batch: Batch) -> None:
        position_mm = (
            _VALUE.column(frames, "big").astype(np.float64) * _MM * self._settings.sign
        )
        flags = np.zeros(len(frames), dtype=np.uint16)
        mark(flags, (frames[:, _SPEED_BYTE] & _SPEED) != 0, Flag.SLEW)
        mark(flags, (frames[:, _STATE_BYTE] & _LASER_READY) == 0, Flag.HEAD_ERROR)
        mark(flags, (frames[:, _STATE_BYTE] & _SIGNAL_GOOD) == 0, Flag.BEAM_LOST)
        beam = np.clip(
            frames[:, _LEVEL_BYTE].astype(np.float64) / self._settings.level_full, 0.0, 1.0
        )
        judge_beam(beam, self._settings.beam_threshold, flags)
        first, self._number = self._number, self._number + len(frames)
        batch.add(
            np.arange(first, self._number, dtype=np.int64), position_mm, flags, beam=beam
        )

    def _hear_weather(self, frame: bytes, batch: Batch) -> None:
        """Process the report of a sensor: sensor number, temperature in 0.01 C, humidity in %,
        battery, link, and pressure in 10 Pa.
        """
        sensor, temperature_c = (
            frame[3],
            int.from_bytes(frame[4:6], "big", signed=True) * 0.01,
        )
        if sensor == _AIR_SENSOR:
            pressure_hpa = int.from_bytes(frame[9:11], "big") * 0.1
            measured = {
                "air_temperature_c": temperature_c,
                "relative_humidity_percent": float(frame[6]),
                "air_pressure_hpa": pressure_hpa,
            }
        else:
            self._material_c[sensor] = temperature_c
            measured = {
                "material_temperature_c": sum(self._material_c.values())
                / len(self._material_c)
            }
        for name, value in measured.items():
            batch.note("environment", name=name, value=value)


def _is_whole(frame: bytes) -> bool:
    return _CRC.of(frame[:-1]) == frame[-1]


def _code(frame: NDArray[np.uint8]) -> int:
    return int(frame[1]) << 8 | int(frame[2])


def _runs(codes: NDArray[np.int64]) -> list[tuple[int, int]]:
    edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), len(codes)]
    return list(pairwise(edges))
