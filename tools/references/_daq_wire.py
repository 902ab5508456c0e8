"""Inputs of the reference cases of daq/formats: bytes as the instruments send them, and the steps
that feed them."""

import binascii
import json
import struct
from typing import Any

Case = tuple[str, str, Any]


def hexed(data: bytes) -> dict[str, Any]:
    """Return bytes as they stand in a reference file."""
    if len(data) > 40 and len(set(data)) == 1:
        return {"hex": data[:1].hex(), "times": len(data)}
    return {"hex": data.hex()}


def fed(*chunks: Any) -> list[Any]:
    """Return the steps of a decoder: bytes are fed, all else is as it is."""
    return [
        ["feed", hexed(each)]
        if isinstance(each, bytes)
        else ["feed", each]
        if isinstance(each, str)
        else each
        for each in chunks
    ]


def streamed(name: str, fmt: str, steps: list[Any], **settings: Any) -> Case:
    return name, "decoder", {"format": fmt, "settings": settings, "steps": steps}


def umd_line(
    seq: int,
    *,
    ref: int = 2000,
    meas: int = 2100,
    at: int = 0,
    velocity: int = 5,
    phase: int = 0,
    code: int = 0,
    data: int = 0,
) -> str:
    return f"{ref} {meas} {at} {velocity} {phase} {seq} {code} {data}\r\n"


def umd_three(seq: int, code: int = 0, data: int = 0, *, phase: int = 0) -> str:
    second, third = (
        f"{2200 + seq} {30 * seq} 6 {phase}",
        f"{2300 + seq} {-40 * seq} 7 {2 * phase}",
    )
    return f"2000 {2100 + seq} {10 * seq} 5 {3 * phase} {seq} {code} {data} {second} {third} \r\n"


def qudis(
    opcode: int, address: int, index: int = 0, *data: int, correlation: int = 0
) -> bytes:
    return struct.pack(
        "<5i", 16 + 4 * len(data), opcode, address, index, correlation
    ) + b"".join(struct.pack("<I", each & 0xFFFFFFFF) for each in data)


def qudis_pair(position_pm: int, marker: int = 0) -> tuple[int, int]:
    raw = position_pm & (1 << 48) - 1
    return raw & 0xFFFFFF | (marker & 0x7F) << 24, raw >> 24 | (
        marker >> 7 & 0x7F
    ) << 24 | 1 << 31


def qudis_data(index: int, *positions: int, marker: int = 0) -> bytes:
    words = [
        word
        for k, position in enumerate(positions)
        for word in qudis_pair(position, marker + k)
    ]
    return qudis(4, 0x0F00, index, *words)


def lasertex(code: int, data: bytes) -> bytes:
    body = b"\xaa" + code.to_bytes(2, "big") + data
    return body + bytes((crc8_nrsc5(body),))


def crc8_nrsc5(data: bytes) -> int:
    register = 0xFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = (register << 1 ^ (0x31 if register & 0x80 else 0)) & 0xFF
    return register


def lasertex_distance(
    steps: int, *, speed: int = 0, state: int = 9, level: int = 80
) -> bytes:
    return lasertex(
        0xB015,
        (steps & (1 << 56) - 1).to_bytes(7, "big") + bytes((0x31, 0x00, speed, state, level)),
    )


def fourdof(
    counter: int,
    kind: bytes = b"i",
    status: int = 0,
    values: tuple[Any, ...] = (10, -20, 900, 30, -40, 800, 50, -60, 700),
) -> bytes:
    body = struct.pack(
        "<cBI" + ("9i" if kind == b"i" else "9f"), kind, status, counter, *values
    )
    return b"\xf4\xd0" + body + struct.pack("<H", binascii.crc_hqx(body, 0xFFFF))


def fourdof_line(
    counter: int,
    status: int = 0,
    values: tuple[Any, ...] = (10, -20, 900, 30, -40, 800, 50, -60, 700),
) -> str:
    body = f"4D,{counter},{status}," + ",".join(map(str, values))
    return f"${body}*{binascii.crc_hqx(body.encode('latin-1'), 0xFFFF):04X}\r\n"


def answer(number: int, *result: float, **more: Any) -> str:
    return json.dumps({"jsonrpc": "2.0", "id": number, "result": list(result)} | more) + "\n"
