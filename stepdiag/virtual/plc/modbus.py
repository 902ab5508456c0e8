"""A Modbus slave written from the specification (Modbus Application Protocol V1.1b3; Serial Line
V1.02).

The slave does not use the client's library, whose errors it would share. The slave can answer late,
and then answers the requests in their order, as a real PLC does.
"""

import struct
from collections.abc import Sequence
from typing import Protocol

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
GATEWAY_TARGET_FAILED = 11
_BIT_TABLES = {1: "coil", 2: "discrete"}
_REGISTER_TABLES = {3: "holding", 4: "input"}


class ModbusError(Exception):
    """Raised where the slave answers with the exception ``code``."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


class Memory(Protocol):
    """The memory of a slave. Both methods raise `ModbusError`."""

    def read(self, table: str, address: int, count: int) -> Sequence[int]:
        """Return the values of registers (0..65535) of ``holding`` or ``input``, or of bits (0, 1)
        of ``coil`` or ``discrete``."""
        ...

    def write(self, table: str, address: int, values: Sequence[int]) -> None:
        """Store values in registers of ``holding`` or bits of ``coil``."""
        ...


def respond(memory: Memory, request: bytes) -> bytes:
    """Return the response PDU to a request PDU (function code and data, without unit and
    checksum)."""
    function = request[0]
    try:
        return bytes([function]) + _execute(memory, function, request[1:])
    except ModbusError as refusal:
        return bytes([function | 0x80, refusal.code])
    except struct.error:
        return bytes([function | 0x80, ILLEGAL_VALUE])


def _execute(memory: Memory, function: int, data: bytes) -> bytes:
    if function in _BIT_TABLES:
        address, count = _range(data, 2000)
        return _counted(_pack_bits(memory.read(_BIT_TABLES[function], address, count)))
    if function in _REGISTER_TABLES:
        address, count = _range(data, 125)
        return _counted(
            _pack_registers(memory.read(_REGISTER_TABLES[function], address, count))
        )
    if function == 5:
        address, value = struct.unpack(">HH", data)
        memory.write("coil", address, [1 if value == 0xFF00 else 0])
        return data
    if function == 6:
        address, value = struct.unpack(">HH", data)
        memory.write("holding", address, [value])
        return data
    if function == 16:
        memory.write("holding", *_registers_to_write(data))
        return data[:4]
    if function == 23:
        address, count = _range(data[:4], 125)
        memory.write("holding", *_registers_to_write(data[4:]))
        return _counted(_pack_registers(memory.read("holding", address, count)))
    raise ModbusError(ILLEGAL_FUNCTION)


def _range(data: bytes, maximum: int) -> tuple[int, int]:
    address, count = struct.unpack(">HH", data)
    if not 1 <= count <= maximum:
        raise ModbusError(ILLEGAL_VALUE)
    return address, count


def _registers_to_write(data: bytes) -> tuple[int, list[int]]:
    address, count, size = struct.unpack(">HHB", data[:5])
    if size != 2 * count or len(data) != 5 + size:
        raise ModbusError(ILLEGAL_VALUE)
    return address, list(struct.unpack(f">{count}H", data[5:]))


def _counted(data: bytes) -> bytes:
    return bytes([len(data)]) + data


def _pack_registers(values: Sequence[int]) -> bytes:
    return struct.pack(f">{len(values)}H", *values)


def _pack_bits(values: Sequence[int]) -> bytes:
    packed = bytearray((len(values) + 7) // 8)
    for number, value in enumerate(values):
        packed[number // 8] |= (value & 1) << number % 8
    return bytes(packed)


def checksum(frame: bytes) -> bytes:
    """Return the CRC-16 of an RTU frame, low byte first (polynomial A001h, start FFFFh)."""
    register = 0xFFFF
    for byte in frame:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return struct.pack("<H", register)


def frame_length(start: bytes) -> int | None:
    """Return the length of the RTU request that begins with ``start``, or None while ``start`` is
    too short to contain this length."""
    if len(start) < 2:
        return None
    function = start[1]
    count_at = {15: 6, 16: 6, 23: 10}.get(function)
    if count_at is None:
        return 8
    return None if len(start) <= count_at else count_at + 1 + start[count_at] + 2
