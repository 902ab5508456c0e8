"""From registers to signals (contract 2).

A signal is a bit, or a number of one or two registers. Controls use four byte orders for two
registers (S7: ABCD, MELSEC: CDAB; instruments.md 4.1), so the survey file contains the order of
each signal.
"""

import math
import struct
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Annotated, Literal

import msgspec
import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.daq.formats.expressions import Expression, Memory
from stepdiag.daq.records.events import (
    BIT_TABLES,
    REGISTER_TABLES,
    ModbusBlock,
    ReadRange,
    Table,
)

SignalType = Literal["bit", "uint16", "int16", "uint32", "int32", "float32"]
ByteOrder = Literal["ABCD", "CDAB", "BADC", "DCBA"]
SignalMap = Mapping[str, "SignalSpec"]

MAX_REGISTERS = 125
"""Largest number of registers in one request (Modbus application protocol V1.1b3, 6.3)."""
MAX_BITS = 2000
"""Largest number of bits in one request (Modbus application protocol V1.1b3, 6.1)."""
MAX_BYTES = 200
"""Largest number of bytes in one range of a table with byte addresses: the smallest PDU of an S7
answers 222 bytes, a TNC answers 255.
"""

_STRUCT_CODES = {
    "uint16": ">H",
    "int16": ">h",
    "uint32": ">I",
    "int32": ">i",
    "float32": ">f",
}
_PLACES: dict[str, tuple[int, ...]] = {
    "ABCD": (0, 1, 2, 3),
    "CDAB": (2, 3, 0, 1),
    "BADC": (1, 0, 3, 2),
    "DCBA": (3, 2, 1, 0),
}


class SignalSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Place and scale of a signal: value = raw * scale + offset."""

    address: Annotated[int, msgspec.Meta(ge=0, le=65535)]
    table: Table = "holding"
    type: SignalType = "uint16"
    order: ByteOrder = "ABCD"
    bit: Annotated[int, msgspec.Meta(ge=0, le=15)] = 0
    scale: float = 1.0
    offset: float = 0.0

    @property
    def in_bit_table(self) -> bool:
        return self.table in BIT_TABLES

    @property
    def in_byte_table(self) -> bool:
        """Return whether an address of the signal's table is a byte, as in a data block of an S7 or
        in a TNC's memory.
        """
        return self.table not in (*BIT_TABLES, *REGISTER_TABLES)

    @property
    def width(self) -> int:
        words = 2 if self.type in ("uint32", "int32", "float32") else 1
        return words * 2 if self.in_byte_table and self.type != "bit" else words


@dataclass(frozen=True, slots=True, kw_only=True)
class Signals:
    """The signals of one poll of the machine; None for a signal without a place, or with a refused
    request.
    """

    stopped: bool | None = None
    running: bool | None = None
    alarm: bool | None = None
    heartbeat: int | None = None
    stop_count: int | None = None
    setup: int | None = None
    x_mm: float | None = None
    y_mm: float | None = None
    z_mm: float | None = None
    material_temperature_c: float | None = None
    air_temperature_c: float | None = None
    air_pressure_hpa: float | None = None
    relative_humidity_percent: float | None = None

    @property
    def commanded_mm(self) -> tuple[float, float, float] | None:
        """Return the commanded position in mm; None unless all three axes have a place."""
        if self.x_mm is None or self.y_mm is None or self.z_mm is None:
            return None
        return self.x_mm, self.y_mm, self.z_mm

    @property
    def program_over(self) -> bool:
        """Return whether the machine shows that no program of a setup runs."""
        return self.running is False or self.setup == 0


SIGNAL_NAMES = tuple(field.name for field in fields(Signals))
COUNTED = ("heartbeat", "stop_count", "setup")
"""Signals that are whole numbers; a control that has only real numbers sends them as float32."""
SWITCHED = ("stopped", "running", "alarm")
"""Signals that are yes or no."""


CONTRACT_SIGNALS: SignalMap = {
    "heartbeat": SignalSpec(address=0),
    "stop_count": SignalSpec(address=1),
    "stopped": SignalSpec(address=2, type="bit"),
    "running": SignalSpec(address=2, type="bit", bit=1),
    "alarm": SignalSpec(address=2, type="bit", bit=2),
    "setup": SignalSpec(address=3),
    "x_mm": SignalSpec(address=4, type="int32", scale=1e-4),
    "y_mm": SignalSpec(address=6, type="int32", scale=1e-4),
    "z_mm": SignalSpec(address=8, type="int32", scale=1e-4),
    "material_temperature_c": SignalSpec(address=10, type="int16", scale=0.01),
    "air_temperature_c": SignalSpec(address=11, type="int16", scale=0.01),
    "air_pressure_hpa": SignalSpec(address=12, scale=0.1),
    "relative_humidity_percent": SignalSpec(address=13, scale=0.1),
}
"""The default places of the signals in the contract: holding registers 0 to 13, read by one
request.
"""


def plan_reads(
    signals: SignalMap, standing: Collection[str] = ("stopped",)
) -> tuple[ReadRange, ...]:
    """Return the fewest requests that read every signal. ``standing`` are the signals that show
    whether the machine stands.

    Only adjacent addresses are joined: the control may refuse an address between two signals. A
    range never exceeds the limit of one request and never splits a number. If more than one request
    is needed, the ``standing`` signals are requested first and last, because the machine may leave
    between two requests.
    """
    ranges = _read_ranges(signals)
    telling = {name: signals[name] for name in standing if name in signals}
    if not telling or len(ranges) < 2:
        return tuple(ranges)
    ranges.sort(key=lambda asked: not any(_holds(asked, spec) for spec in telling.values()))
    return (*ranges, *_read_ranges(telling))


def _read_ranges(signals: SignalMap) -> list[ReadRange]:
    ranges: list[ReadRange] = []
    for spec in sorted(signals.values(), key=lambda spec: (spec.table, spec.address)):
        last = ranges[-1] if ranges else None
        if last is not None and _joins(last, spec):
            end = max(last.address + last.count, spec.address + spec.width)
            ranges[-1] = ReadRange(last.table, last.address, end - last.address)
        else:
            ranges.append(ReadRange(spec.table, spec.address, spec.width))
    return ranges


def _holds(asked: ReadRange, spec: SignalSpec) -> bool:
    return (
        asked.table == spec.table
        and 0 <= spec.address - asked.address <= asked.count - spec.width
    )


def _joins(last: ReadRange, spec: SignalSpec) -> bool:
    limit = MAX_BYTES if spec.in_byte_table else MAX_REGISTERS
    if spec.in_bit_table:
        limit = MAX_BITS
    touches = spec.table == last.table and spec.address <= last.address + last.count
    return touches and spec.address + spec.width - last.address <= limit


class SignalDecoder:
    """Decodes the polls of a machine with one register map.

    Most polls repeat the previous poll: for an unchanged block the decoder returns the same object
    again, and a signal with unchanged bytes is not decoded again.
    """

    def __init__(
        self, signals: SignalMap, expressions: Mapping[str, Expression] = MappingProxyType({})
    ) -> None:
        """``expressions`` compute further signals from inputs. The inputs are the entries of
        ``signals`` that are not signals of the contract.
        """
        self._signals = signals
        self._expressions = expressions
        self._memory = Memory()
        self._ranges: tuple[ReadRange, ...] = ()
        self._lengths: tuple[int, ...] = ()
        self._places: dict[str, tuple[_Found, ...]] = {}
        self._kept: dict[str, tuple[list[bytes], bool | int | float | None]] = {}
        self._data: tuple[bytes, ...] | None = None
        self._decoded = Signals()

    def decode(self, block: ModbusBlock) -> Signals:
        """Return the signals of one block; a signal whose range was refused (``b""``) is None.

        Raises DataError for an answer of another length than requested, or a block that was read
        with another register map.
        """
        if block.ranges is not self._ranges:
            if block.ranges != self._ranges:
                self._places = {
                    name: _find(name, spec, block.ranges)
                    for name, spec in self._signals.items()
                }
                self._lengths = tuple(asked.byte_count for asked in block.ranges)
                self._data, self._kept = None, {}
            self._ranges = block.ranges
        if block.data != self._data:
            _check_lengths(block, self._lengths)
            values = {
                name: self._value(name, block.data)
                for name in self._signals
                if name in SIGNAL_NAMES
            }
            made = {name: self._made(name, block.data) for name in self._expressions}
            self._decoded = Signals(**values | made)  # type: ignore[arg-type]  # each is typed by its name
            self._data = block.data
        return self._decoded

    def unanswered(self, block: ModbusBlock) -> tuple[str, ...]:
        """Return the signals and inputs without a value in a decoded block, because the machine
        refused their range.
        """
        return tuple(
            name
            for name, places in self._places.items()
            if not any(block.data[answer] for answer, *_ in places)
        )

    def _value(self, name: str, data: tuple[bytes, ...]) -> bool | int | float | None:
        raw = [data[answer][cut] for answer, _, cut in self._places[name]]
        if name not in self._kept or self._kept[name][0] != raw:
            self._kept[name] = raw, self._decoded_value(name, raw)
        return self._kept[name][1]

    def _decoded_value(self, name: str, raw: list[bytes]) -> bool | int | float | None:
        spec = self._signals[name]
        numbers = [
            _raw_number(spec, own, place)
            for (_, place, _), own in zip(self._places[name], raw, strict=True)
            if own
        ]
        if not numbers:
            return None
        if name in SWITCHED:
            return all(numbers)
        return _typed(name, numbers[0] * spec.scale + spec.offset)

    def _made(self, name: str, data: tuple[bytes, ...]) -> bool | int | float | None:
        """Return the value of an expression. If a poll reads the inputs twice, the value is true
        only if both readings are true.
        """
        expression = self._expressions[name]
        first = expression.value(
            {each: self._input(each, data, 0) for each in expression.names}, self._memory
        )
        last = expression.value(
            {each: self._input(each, data, -1) for each in expression.names}, self._memory
        )
        if name in SWITCHED:
            return None if first is None or last is None else bool(first and last)
        return None if last is None else _typed(name, float(last))

    def _input(self, name: str, data: tuple[bytes, ...], which: int) -> float | None:
        spec = self._signals[name]
        answer, place, cut = self._places[name][which]
        if not data[answer]:
            return None
        value = _raw_number(spec, data[answer][cut], place) * spec.scale + spec.offset
        return value if math.isfinite(value) else None


def _typed(name: str, value: float) -> int | float | None:
    if not math.isfinite(value):
        return None
    return round(value) if name in COUNTED else float(value)


def _check_lengths(block: ModbusBlock, lengths: tuple[int, ...]) -> None:
    for asked, data, length in zip(block.ranges, block.data, lengths, strict=True):
        if data and len(data) != length:
            raise DataError(
                message("answer-for", place=f"{asked.table} {asked.address}"),
                expected=message("expects-bytes", count=length),
                found=f"{len(data)}",
                remedy=message("check-unit-gateway"),
            )


_Found = tuple[int, int, slice]
"""The index of a range that contains a signal, the position of the signal in the range, and the
slice of the answer's bytes.
"""


def _find(name: str, spec: SignalSpec, ranges: tuple[ReadRange, ...]) -> tuple[_Found, ...]:
    places = tuple(
        (index, place := spec.address - asked.address, _cut(spec, place))
        for index, asked in enumerate(ranges)
        if _holds(asked, spec)
    )
    if places:
        return places
    raise DataError(
        f"signal {name}",
        expected=message("block-with", place=describe(spec)),
        found=", ".join(f"{asked.table} {asked.address}+{asked.count}" for asked in ranges)
        or message("none"),
        remedy=message("other-register-map"),
    )


def _cut(spec: SignalSpec, place: int) -> slice:
    if spec.in_bit_table:
        return slice(place // 8, place // 8 + 1)
    unit = 1 if spec.in_byte_table else 2
    return slice(unit * place, unit * (place + spec.width))


def _raw_number(spec: SignalSpec, raw: bytes, place: int) -> float:
    if spec.in_bit_table:
        return raw[0] >> place % 8 & 1
    if spec.type == "bit":
        return int.from_bytes(raw, "big") >> spec.bit & 1
    ordered = bytes(raw[at] for at in _PLACES[spec.order] if at < len(raw))
    number: float = struct.unpack(_STRUCT_CODES[spec.type], ordered)[0]
    return number


def resolution(spec: SignalSpec, value: float) -> float:
    """Return the smallest difference from ``value`` that a signal can show: one count of a whole
    number, the last bit of a real number.
    """
    if spec.type == "float32":
        return abs(spec.scale) * float(
            np.spacing(np.float32((value - spec.offset) / spec.scale))
        )
    return abs(spec.scale)


def describe(spec: SignalSpec) -> str:
    """Return the place of a signal as text, such as ``holding 2 bit 0`` or ``input 40-41``."""
    if spec.type == "bit" and not spec.in_bit_table:
        return f"{spec.table} {spec.address} bit {spec.bit}"
    last = f"-{spec.address + spec.width - 1}" if spec.width > 1 else ""
    return f"{spec.table} {spec.address}{last}"


def registers(specs: Iterable[SignalSpec]) -> set[tuple[Table, int]]:
    return {
        (spec.table, spec.address + place) for spec in specs for place in range(spec.width)
    }
