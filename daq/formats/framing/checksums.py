"""Checksums of binary frames by their names in the catalogue of CRC algorithms
(reveng.sourceforge.io/crc-catalogue).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from operator import xor


@dataclass(frozen=True, slots=True, kw_only=True)
class Crc:
    """A CRC of 8 or 16 bits; a ``reflected`` CRC processes the least significant bit first."""

    width: int
    polynomial: int
    start: int = 0
    reflected: bool = False


@dataclass(frozen=True, slots=True)
class Checksum:
    size: int
    of: Callable[[bytes], int]


_CRCS: Mapping[str, Crc] = {
    "crc-8": Crc(width=8, polynomial=0x07),
    "crc-8/maxim": Crc(width=8, polynomial=0x31, reflected=True),
    "crc-8/nrsc-5": Crc(width=8, polynomial=0x31, start=0xFF),
    "crc-16/ccitt-false": Crc(width=16, polynomial=0x1021, start=0xFFFF),
    "crc-16/xmodem": Crc(width=16, polynomial=0x1021),
    "crc-16/kermit": Crc(width=16, polynomial=0x1021, reflected=True),
    "crc-16/modbus": Crc(width=16, polynomial=0x8005, start=0xFFFF, reflected=True),
    "crc-16/arc": Crc(width=16, polynomial=0x8005, reflected=True),
}

_EVERY_BYTE = bytes(range(256))


def _crc_table(crc: Crc) -> tuple[int, ...]:
    mask, top = (1 << crc.width) - 1, 1 << crc.width - 1
    if crc.reflected:
        polynomial = int(f"{crc.polynomial:0{crc.width}b}"[::-1], 2)
        return tuple(
            reduce(
                lambda register, _: register >> 1 ^ polynomial * (register & 1),
                range(8),
                byte,
            )
            for byte in _EVERY_BYTE
        )
    return tuple(
        reduce(
            lambda register, _: (
                (register << 1 ^ crc.polynomial * (register & top != 0)) & mask
            ),
            range(8),
            byte << crc.width - 8,
        )
        for byte in _EVERY_BYTE
    )


def checksum(crc: Crc) -> Checksum:
    table, start, mask, shift = (
        _crc_table(crc),
        crc.start,
        (1 << crc.width) - 1,
        crc.width - 8,
    )

    def reflected(data: bytes) -> int:
        register = start
        for byte in data:
            register = register >> 8 ^ table[register & 0xFF ^ byte]
        return register

    def plain(data: bytes) -> int:
        register = start
        for byte in data:
            register = register << 8 & mask ^ table[register >> shift ^ byte]
        return register

    return Checksum(crc.width // 8, reflected if crc.reflected else plain)


CHECKSUMS: Mapping[str, Checksum] = {
    "none": Checksum(0, lambda _: 0),
    "sum-8": Checksum(1, lambda data: sum(data) % 256),
    "xor-8": Checksum(1, lambda data: reduce(xor, data, 0)),
    **{name: checksum(crc) for name, crc in _CRCS.items()},
}
"""The checksums that the survey file may select for a frame."""
