"""The events that enter `daq.capture.capture`, live and replayed: bytes, register blocks, and
changes of the links.

The order of the events is the order of recording and of consumption; a replay passes on the same
events in the same order and so gives the same result. Every time is the recording host's clock
(`daq.timing.host_clock`) in nanoseconds. (The events are msgspec structs, because a replay creates
millions of events: a struct needs a tenth of the time of a frozen dataclass.)
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from stepdiag.base.messages import Words, joined, message
from stepdiag.daq.records.status import LinkState

Stream = Literal["laser", "head", "air"]
"""A stream of bytes: the laser, the 4-DOF head beside it, or the sensor of air and material."""
Link = Literal["laser", "head", "air", "machine"]
"""A link that can be connected or lost: a stream of bytes, or the link to the machine."""
_TABLE = r"^(?:coil|discrete|holding|input|db[1-9][0-9]{0,4}|[BMIO])\Z"
Table = Annotated[
    str,
    Meta(
        pattern=_TABLE,
        description='"coil", "discrete", "holding", "input" (Modbus), "db4900" (S7: any data '
        'block) or "B", "M", "I", "O" (LSV2)',
    ),
]
"""The places of readable values in a machine: the four Modbus tables, a data block of an S7, the
memories of a TNC's PLC (B holds words and double words too).
"""
BIT_TABLES = ("coil", "discrete")
REGISTER_TABLES = ("holding", "input")


def is_table(name: str) -> bool:
    """Return whether a table of the machine with this name exists."""
    return re.match(_TABLE, name) is not None


@dataclass(frozen=True, slots=True)
class ReadRange:
    """``count`` consecutive bits (coil, discrete), registers (holding, input) or bytes (any other
    table) from ``address``, read by one request.
    """

    table: Table
    address: int
    count: int

    @property
    def byte_count(self) -> int:
        """Return the length of the answer's data in bytes."""
        if self.table in BIT_TABLES:
            return (self.count + 7) // 8
        return 2 * self.count if self.table in REGISTER_TABLES else self.count


class Chunk(msgspec.Struct, frozen=True, gc=False):
    """Bytes of a stream, stamped right after their read; ``arrival_ns`` is a whole number of
    microseconds.
    """

    stream: Stream
    arrival_ns: int
    data: bytes


class ModbusBlock(msgspec.Struct, frozen=True, gc=False):
    """One poll of the machine: its requests and the data bytes of each answer, as on the wire.

    ``send_ns`` is stamped before the first request, ``recv_ns`` after the last answer. ``data[i]``
    answers ``ranges[i]``: registers are big-endian 16-bit words, bits are packed least significant
    first, bytes are unchanged; ``b""`` means a refused range. (The name ``ModbusBlock`` is older
    than the other protocols of a machine, and every log contains this name.)
    """

    send_ns: int
    recv_ns: int
    ranges: tuple[ReadRange, ...]
    data: tuple[bytes, ...]


class LinkEvent(msgspec.Struct, frozen=True, gc=False):
    """A link changed its state, or lost bytes. ``lost`` names the places where bytes were lost, and
    the number of bytes.
    """

    time_ns: int
    link: Link
    state: LinkState
    detail: Words = ""
    lost: tuple[Words, ...] = ()

    @property
    def words(self) -> Words:
        """Return a message with the state of the link and its lost bytes."""
        return with_lost(self.detail, self.lost)

    @property
    def interrupts(self) -> bool:
        """Return whether an incomplete text line before this event must be discarded: yes after a
        lost link, no after silence or lost bytes.
        """
        return self.state == "lost"


def with_lost(detail: Words, lost: Sequence[Words]) -> Words:
    """Return a message with the state of a link and its lost bytes."""
    return joined(
        [
            each
            for each in (detail, message("bytes-lost-at", causes=lost) if lost else "")
            if each
        ]
    )


class Loss(msgspec.Struct, frozen=True, gc=False):
    """The recorder was too slow (disk full, disk too slow): this number of events before this event
    was not stored.

    An event that was not recorded is not consumed either, so a replay gets the events of the live
    capture.
    """

    time_ns: int
    events: int
    bytes: int
    reason: Words


Event = Chunk | ModbusBlock | LinkEvent | Loss
