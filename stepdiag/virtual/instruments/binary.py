"""An instrument that sends binary frames, like many home-made counters.

A frame: AA 55, a 16-bit sample number, the reading in nanometres (32 bits, signed), the beam in per
mille (16 bits), a status byte whose lowest bit is a lost beam, and the CRC-16 of the Modbus line
over everything before it, low byte first. ``order`` is the byte order of the numbers.
"""

import struct
from typing import Literal

from stepdiag.virtual.instruments.counting import Counting
from stepdiag.virtual.instruments.lasers import Flags
from stepdiag.virtual.physics.error_functions import Array


def modbus_crc(data: bytes) -> int:
    """Return the CRC of the Modbus serial line: polynomial A001h, start FFFFh, least significant
    bit first."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return register


class BinaryFrames(Counting):
    def __init__(self, *, rate_hz: float, order: Literal["little", "big"] = "little") -> None:
        super().__init__()
        self.rate_hz = rate_hz
        self._pack = struct.Struct(("<" if order == "little" else ">") + "HiHB").pack

    def encode(self, reading_mm: Array, beam: Flags) -> bytes:
        frames = []
        for position_mm, present in zip(reading_mm.tolist(), beam.tolist(), strict=True):
            body = b"\xaa\x55" + self._pack(
                self._counter % 65536,
                round(position_mm * 1e6),
                1000 if present else 0,
                0 if present else 1,
            )
            frames.append(body + struct.pack("<H", modbus_crc(body)))
            self._counter += 1
        return b"".join(frames)
