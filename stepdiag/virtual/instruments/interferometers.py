"""Lasers with a public interface, by the documents of their makers: attocube IDS3010, Lasertex
HPI-3D (uLine F1), quTools quDIS.

The code follows the public specifications in docs/lasers.md and not the decoders. The IDS3010
answers single requests; the HPI-3D and the quDIS send a stream on request.
"""

import json
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from stepdiag.virtual.instruments.lasers import Flags, Integers
from stepdiag.virtual.physics.error_functions import Array


@dataclass(frozen=True, slots=True)
class Climate:
    """A function that returns the values of air and material at a time."""

    air_c: float
    pressure_hpa: float
    humidity_percent: float
    material_c: float


AskClimate = Callable[[], Climate]


class Ids3010:
    """The JSON-RPC of the IDS3010: a request is a JSON object, an answer is a line that ends with
    CR LF; displacement in pm, contrast in per mille."""

    def __init__(self, climate: AskClimate, *, axis: int = 1, contrast: int = 800) -> None:
        self._climate = climate
        self._axis = axis
        self._contrast = contrast
        self._received = ""

    def requests(self, received: bytes) -> list[bytes]:
        """Return the complete requests in the received bytes: JSON objects need no separator."""
        self._received += received.decode("utf-8", "replace")
        complete: list[bytes] = []
        decoder = json.JSONDecoder()
        while self._received:
            try:
                _, end = decoder.raw_decode(self._received)
            except json.JSONDecodeError:
                break
            complete.append(self._received[:end].encode())
            self._received = self._received[end:].lstrip()
        return complete

    def answer(self, request: bytes, reading_mm: float, *, beam: bool) -> bytes:
        asked = json.loads(request)
        result = self._result(asked["method"], reading_mm, beam=beam)
        answer = (
            {"result": result}
            if result is not None
            else {"error": {"code": -32601, "message": "Method not found"}}
        )
        return json.dumps({"jsonrpc": "2.0", "id": asked["id"], **answer}).encode() + b"\r\n"

    def _result(self, method: str, reading_mm: float, *, beam: bool) -> list[float] | None:
        name, climate = method.rpartition(".")[2], self._climate()
        if name == "getAxesDisplacement":
            axes = [0, 0, 0]
            axes[self._axis - 1] = round(reading_mm * 1e9)
            return [0 if beam else 1 << self._axis - 1, *axes]
        table: dict[str, list[float]] = {
            "getAxisSignalQuality": [0, self._contrast if beam else 0, 500],
            "getTemperatureInDegrees": [0, climate.air_c],
            "getPressureInHPa": [0, climate.pressure_hpa],
            "getHumidityInPercent": [0, climate.humidity_percent],
        }
        return table.get(name)


def lasertex_crc(data: bytes) -> int:
    """Return the checksum of a telegram: polynomial 31h, start FFh, most significant bit first."""
    register = 0xFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = (register << 1 ^ (0x31 if register & 0x80 else 0)) & 0xFF
    return register


class Lasertex:
    """The HPI-3D: 25 readings per second when distances are switched on, and its wireless sensors
    once per second when the weather is switched on.

    After a lost signal a flag stays set until command B03Dh clears it.
    """

    rate_hz = 25.0

    def __init__(self, climate: AskClimate, *, level: int = 90) -> None:
        self._climate = climate
        self._level = level
        self._received = b""
        self._distance = self._weather = False
        self._held = False
        self._samples = 0

    def banner(self) -> bytes:
        self._distance = self._weather = self._held = False
        return b""

    def skip(self, count: int) -> None:
        self._samples += count

    def respond(self, received: bytes) -> bytes:
        """Process the received commands; return their acknowledgements."""
        self._received += received
        answer = b""
        while len(self._received) >= 8:
            frame, self._received = self._received[:8], self._received[8:]
            if frame[0] != 0xAA or lasertex_crc(frame[:7]) != frame[7]:
                continue
            self._command(int.from_bytes(frame[1:3], "big"))
            answer += self._frame(int.from_bytes(frame[1:3], "big"), bytes(12))
        return answer

    def encode(self, reading_mm: Array, beam: Flags) -> bytes:
        answer = b""
        for position_mm, present in zip(reading_mm.tolist(), beam.tolist(), strict=True):
            self._held |= not present
            if self._distance:
                state = 0x01 | (0x00 if self._held else 0x08)
                data = round(position_mm * 1e7).to_bytes(7, "big", signed=True) + bytes(
                    (0, 0, 0, state, self._level if present else 2)
                )
                answer += self._frame(0xB015, data)
            if self._weather and self._samples % 25 == 0:
                answer += b"".join(self._sensors())
            self._samples += 1
        return answer

    def _command(self, code: int) -> None:
        match code:
            case 0xB032 | 0xB033:
                self._distance = code == 0xB032
            case 0xB079 | 0xB07A:
                self._weather = code == 0xB079
            case 0xB03C:
                self._distance = self._weather = False
            case 0xB03D:
                self._held = False

    def _sensors(self) -> Iterator[bytes]:
        now = self._climate()
        air = struct.pack(
            ">BhBBBh4x",
            0,
            round(now.air_c * 100),
            round(now.humidity_percent),
            90,
            80,
            round(now.pressure_hpa * 10),
        )
        yield self._frame(0xB00A, air)
        for sensor in (1, 2):
            yield self._frame(
                0xB00A,
                struct.pack(">BhBBBh4x", sensor, round(now.material_c * 100), 0, 90, 80, 0),
            )

    def _frame(self, code: int, data: bytes) -> bytes:
        frame = b"\xaa" + code.to_bytes(2, "big") + data
        return frame + bytes((lasertex_crc(frame),))


class Qudis:
    """The quDIS: when a channel is triggered and data are switched on, it sends telegrams of a few
    readings each. The marker counts the edges of ``stopped``."""

    def __init__(self, stopped: Callable[[Array], Flags], *, axis: int = 1) -> None:
        self._stopped = stopped
        self._axis = axis
        self._received = b""
        self._values: dict[tuple[int, int], int] = {(0x0771, 0): 4}
        self._index = 0
        self._edges = 0
        self._high = False

    @property
    def rate_hz(self) -> float:
        """Return the number of readings per second. The bench has a constant rate, so the average
        that a client sets has no effect."""
        return 25_000.0 / 2**5

    def banner(self) -> bytes:
        self._values.clear()
        self._index = 0
        return b""

    def skip(self, count: int) -> None:
        self._index += count

    def respond(self, received: bytes) -> bytes:
        """Process the received settings and queries; return the answers."""
        self._received += received
        answer = b""
        while len(self._received) >= 4:
            length = int.from_bytes(self._received[:4], "little")
            if len(self._received) < 4 + length:
                break
            words = struct.unpack_from(f"<{length // 4}i", self._received, 4)
            self._received = self._received[4 + length :]
            opcode, address, index, correlation = words[:4]
            if opcode == 0 and len(words) > 4:
                self._set(address, index, words[4])
            if correlation:
                value = 1 if address == 0x0773 else self._values.get((address, index), 0)
                answer += struct.pack("<7i", 24, 3, address, index, correlation, 0, value)
        return answer

    def watch(self, wall_s: Array) -> Integers:
        counts = np.empty(len(wall_s), dtype=np.int64)
        for place, high in enumerate(self._stopped(wall_s).tolist()):
            self._edges += high != self._high
            self._high = high
            counts[place] = self._edges
        return counts

    def tell(self, reading_mm: Array, marker: Integers) -> bytes:
        """Return the telegrams with these readings, at most 32 readings in one telegram."""
        streams = self._values.get((0x0030, 0)) == 2 and self._values.get((0x0146, 0)) == 1
        wanted = self._values.get((0x0031, 0)) in (2 * self._axis - 1, 2 * self._axis)
        answer = b""
        for first in range(0, len(reading_mm), 32):
            part = slice(first, first + 32)
            words = [
                word
                for mm, edges in zip(
                    reading_mm[part].tolist(), marker[part].tolist(), strict=True
                )
                for word in _pair(mm, edges)
            ]
            if streams and wanted:
                answer += struct.pack(
                    f"<iiiii{len(words)}I",
                    16 + 4 * len(words),
                    4,
                    0x0F00,
                    _signed(self._index),
                    0,
                    *words,
                )
            self._index += len(words) // 2
        return answer

    def _set(self, address: int, index: int, value: int) -> None:
        self._values[address, index] = value
        if address == 0x07EC:
            self._edges = int(self._high)


def _pair(reading_mm: float, edges: int) -> tuple[int, int]:
    position = round(reading_mm * 1e9) & (1 << 48) - 1
    count = edges & 0x3FFF
    return position & 0xFFFFFF | (count & 0x7F) << 24, position >> 24 | (
        count >> 7
    ) << 24 | 1 << 31


def _signed(index: int) -> int:
    return (index + 2**31) % 2**32 - 2**31
