"""The events that `daq.capture.capture` processes, live and replayed: bytes, register blocks, and
changes of the links.

The events are recorded in the order of processing; a replay processes the same events in the same
order and so gives the same result. Every time is the recording host's clock
(`daq.timing.host_clock`) in nanoseconds. An event is a msgspec struct, because a replay creates
millions of events: a frozen dataclass needs ten times as long.
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
"""A stream of bytes: the laser, the 4-DOF head, or the sensor of air and material."""
Link = Literal["laser", "head", "air", "machine"]
"""A link that can be connected or lost: a stream of bytes, or the machine."""
_TABLE = r"^(?:coil|discrete|holding|input|db[1-9][0-9]{0,4}|[BMIO])\Z"
Table = Annotated[
    str,
    Meta(
        pattern=_TABLE,
        description='"coil", "discrete", "holding", "input" (Modbus), "db4900" (S7: any data '
        'block) or "B", "M", "I", "O" (LSV2)',
    ),
]
"""The tables of readable values in a machine: the four Modbus tables, a data block of an S7, the
memories of a TNC's PLC (B contains words and double words, too).
"""
BIT_TABLES = ("coil", "discrete")
REGISTER_TABLES = ("holding", "input")


def is_table(name: str) -> bool:
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
    """Bytes of a stream; ``arrival_ns`` is the time right after the read, in whole microseconds."""

    stream: Stream
    arrival_ns: int
    data: bytes


class ModbusBlock(msgspec.Struct, frozen=True, gc=False):
    """One poll of the machine: its requests and the data bytes of each answer, as on the wire.

    ``send_ns`` is the time before the first request, ``recv_ns`` the time after the last answer.
    ``data[i]`` answers ``ranges[i]``: registers are big-endian 16-bit words, bits are packed with
    the least significant first, bytes are unchanged. ``b""`` means a refused range. (The struct is
    also used for S7 and LSV2; logs contain its name.)
    """

    send_ns: int
    recv_ns: int
    ranges: tuple[ReadRange, ...]
    data: tuple[bytes, ...]


class LinkEvent(msgspec.Struct, frozen=True, gc=False):
    """A change of the state of a link, or a loss of bytes. ``lost`` contains the places where bytes
    were lost, and the number of bytes.
    """

    time_ns: int
    link: Link
    state: LinkState
    detail: Words = ""
    lost: tuple[Words, ...] = ()

    @property
    def words(self) -> Words:
        return with_lost(self.detail, self.lost)

    @property
    def interrupts(self) -> bool:
        """Return whether an incomplete text line before the event must be discarded: yes for a lost
        link, no for silence or lost bytes.
        """
        return self.state == "lost"


def with_lost(detail: Words, lost: Sequence[Words]) -> Words:
    return joined(
        [
            each
            for each in (detail, message("bytes-lost-at", causes=lost) if lost else "")
            if each
        ]
    )


class Loss(msgspec.Struct, frozen=True, gc=False):
    """The number of events that the recorder could not store before this event, because the disk
    was full or too slow.

    An event that was not recorded is not processed either, so a replay processes the events of the
    live capture.
    """

    time_ns: int
    events: int
    bytes: int
    reason: Words


Event = Chunk | ModbusBlock | LinkEvent | Loss
