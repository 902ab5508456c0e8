"""Converts events to the JSON messages of a log, and back.

A message contains the events of a stream over a fraction of a second, each event with its own time.
On noisy lines at 1 kHz with one chunk per line, one message per event takes 16 bytes per sample,
and batches take 10 to 12 bytes (measured). base64 adds 3 bytes per sample, because zstd then finds
no repeated digits. A binary schema saves 0.2 bytes, but is not readable. So the bytes of a chunk
are stored as a text, each byte as the character of its number (ISO 8859-1), without loss.

Every event of a log has a number, its place in the order of processing. A batch stores the numbers
of its events as runs: ``order`` is the number of the first event, followed by pairs of ``skip``
(numbers of other channels) and ``run`` (events of this channel).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import cast

import msgspec

from stepdiag.base.messages import Words, kept, of_log
from stepdiag.daq.log.reader import impossible
from stepdiag.daq.log.topics import (
    BLOCK_TOPIC,
    LINK_STATES,
    LINK_TOPICS,
    LOSS_TOPIC,
    RAW_TOPICS,
)
from stepdiag.daq.records.events import (
    Chunk,
    Event,
    Link,
    LinkEvent,
    Loss,
    ModbusBlock,
    ReadRange,
    Stream,
    is_table,
)
from stepdiag.daq.records.status import LinkState

US = 1_000
MAX_TIME_NS = 2**63
"""Latest time in ns (year 2262) of a recorder's clock."""
MOST_RANGES = 200
"""Largest number of ranges of one poll, more than all signals need."""
MOST_EVENTS = 100_000
"""Largest number of events in a message; messages are written several times a second."""
_SECOND_NS = 1_000_000_000
_STREAMS: dict[str, Stream] = {topic: stream for stream, topic in RAW_TOPICS.items()}
_LINKS: dict[str, Link] = {topic: link for link, topic in LINK_TOPICS.items()}

Numbered = tuple[int, Event]
Run = tuple[int, list[Event]]
"""A run: the number of the first event, and consecutive events from this number on."""


class _Time(msgspec.Struct):
    sec: int
    nsec: int


class _Message(msgspec.Struct):
    time: _Time
    t_mono_ns: str
    order: int


class _Batch(_Message):
    skip: list[int]
    run: list[int]


class _Bytes(_Batch):
    after_us: list[int]
    data: list[str]


class _Blocks(_Batch):
    recv_us: list[int]
    answer_us: list[int]
    ranges: str
    data: list[str]


class _LinkChange(_Message):
    state: int
    state_text: str
    detail: str
    message: str = ""
    """Detail and losses of the link as JSON; empty in an older log, which contains only a text."""


class _Lost(_Message):
    events: int
    bytes: int
    reason: str
    message: str = ""


_encode = msgspec.json.Encoder().encode
_decode_bytes = msgspec.json.Decoder(_Bytes).decode
_decode_blocks = msgspec.json.Decoder(_Blocks).decode
_decode_link = msgspec.json.Decoder(_LinkChange).decode
_decode_loss = msgspec.json.Decoder(_Lost).decode


@dataclass(frozen=True, slots=True)
class LogClock:
    """Wall time of a log: the host's clock plus the offset of the time of day at the beginning of
    the log. A later change of the time of day does not change the wall time.
    """

    offset_ns: int

    def wall_ns(self, time_ns: int) -> int:
        """Return the wall time of a time of the host's clock, both in ns."""
        return time_ns + self.offset_ns

    def stamp(self, time_ns: int) -> _Time:
        return _Time(*divmod(self.wall_ns(time_ns), _SECOND_NS))


def time_of(event: Event) -> int:
    """Return the time of the host's clock at which an event was complete."""
    match event:
        case Chunk():
            return event.arrival_ns
        case ModbusBlock():
            return event.recv_ns
        case _:
            return event.time_ns


def whole_us(event: Event) -> Event:
    """Return the event with its times rounded down to whole microseconds.

    The median delay of a time stamp is 77 us (baselines.md): nanoseconds contain no information and
    would need a byte per sample.
    """
    match event:
        case Chunk(stream, arrival_ns, data):
            return (
                event if arrival_ns % US == 0 else Chunk(stream, arrival_ns // US * US, data)
            )
        case ModbusBlock(send_ns, recv_ns, ranges, data):
            if send_ns % US == recv_ns % US == 0:
                return event
            return ModbusBlock(send_ns // US * US, recv_ns // US * US, ranges, data)
        case _:
            return event


def size_of(event: Event) -> int:
    match event:
        case Chunk():
            return 100 + len(event.data)
        case ModbusBlock():
            return 300 + sum(map(len, event.data))
        case _:
            return 200


def topic_of(event: Event) -> str:
    match event:
        case Chunk():
            return RAW_TOPICS[event.stream]
        case ModbusBlock():
            return BLOCK_TOPIC
        case LinkEvent():
            return LINK_TOPICS[event.link]
        case Loss():
            return LOSS_TOPIC


def encode(clock: LogClock, batch: Sequence[Numbered]) -> bytes:
    """Return the message for a batch of one topic: a change of a link, a loss, several chunks, or
    several blocks with equal ranges.
    """
    first = batch[0][1]
    match first:
        case Chunk():
            return _encode_chunks(clock, batch)
        case ModbusBlock():
            return _encode_blocks(clock, batch, first)
        case LinkEvent(time_ns, _, state):
            number, words = LINK_STATES.index(state), message_of_link(first)
            return _encode(
                _LinkChange(
                    clock.stamp(time_ns),
                    str(time_ns),
                    batch[0][0],
                    number,
                    state,
                    str(first.words),
                    words,
                )
            )
        case Loss(time_ns, events, count, reason):
            return _encode(
                _Lost(
                    clock.stamp(time_ns),
                    str(time_ns),
                    batch[0][0],
                    events,
                    count,
                    str(reason),
                    kept(reason),
                )
            )


def message_of_link(event: LinkEvent) -> str:
    """Return the detail and the losses of a link as JSON; empty without both."""
    return (
        msgspec.json.encode((event.detail, event.lost)).decode()
        if event.detail or event.lost
        else ""
    )


def _of_link(change: _LinkChange) -> tuple[Words, tuple[Words, ...]]:
    """Return the detail and the losses of a link. An older log contains a single text that ends
    with the losses.
    """
    if change.message:
        return msgspec.json.decode(change.message, type=tuple[Words, tuple[Words, ...]])
    detail, found, lost = change.detail.partition("bytes lost: ")
    return detail.removesuffix("; "), tuple(lost.split("; ")) if found else ()


def joins(last: Event, event: Event) -> bool:
    if isinstance(last, ModbusBlock) and isinstance(event, ModbusBlock):
        return last.ranges == event.ranges
    return isinstance(event, Chunk)


def _encode_chunks(clock: LogClock, batch: Sequence[Numbered]) -> bytes:
    chunks = [cast("Chunk", event) for _, event in batch]
    times = [chunk.arrival_ns for chunk in chunks]
    after_us = [0, *((later - earlier) // US for earlier, later in pairwise(times))]
    skip, run = _to_runs([number for number, _ in batch])
    texts = [chunk.data.decode("latin-1") for chunk in chunks]
    return _encode(
        _Bytes(clock.stamp(times[0]), str(times[0]), batch[0][0], skip, run, after_us, texts)
    )


def _encode_blocks(clock: LogClock, batch: Sequence[Numbered], first: ModbusBlock) -> bytes:
    blocks = [cast("ModbusBlock", event) for _, event in batch]
    start = first.recv_ns
    recv_us = [(block.recv_ns - start) // US for block in blocks]
    answer_us = [(block.recv_ns - block.send_ns) // US for block in blocks]
    skip, run = _to_runs([number for number, _ in batch])
    texts = ["|".join(data.hex() for data in block.data) for block in blocks]
    ranges = "|".join(
        f"{asked.table} {asked.address} {asked.count}" for asked in first.ranges
    )
    return _encode(
        _Blocks(
            clock.stamp(start),
            str(start),
            batch[0][0],
            skip,
            run,
            recv_us,
            answer_us,
            ranges,
            texts,
        )
    )


def _to_runs(numbers: Sequence[int]) -> tuple[list[int], list[int]]:
    skip, run = [0], [1]
    for earlier, later in pairwise(numbers):
        if later == earlier + 1:
            run[-1] += 1
        else:
            skip.append(later - earlier - 1)
            run.append(1)
    return skip, run


def decode(topic: str, data: bytes) -> list[Run]:
    """Return the events of a message in runs; empty for a note. A damaged message raises one of the
    errors in `daq.log.reader.DAMAGE`.
    """
    if topic in _STREAMS:
        raw = _decode_bytes(data)
        return list(_from_runs(raw, _chunks(_STREAMS[topic], raw)))
    if topic == BLOCK_TOPIC:
        polls = _decode_blocks(data)
        return list(_from_runs(polls, _blocks(polls)))
    if topic in _LINKS:
        change = _decode_link(data)
        state = cast("LinkState", LINK_STATES[LINK_STATES.index(change.state_text)])
        _require_clock(int(change.t_mono_ns), ())
        return [
            (
                change.order,
                [LinkEvent(int(change.t_mono_ns), _LINKS[topic], state, *_of_link(change))],
            )
        ]
    if topic == LOSS_TOPIC:
        lost = _decode_loss(data)
        _require_clock(int(lost.t_mono_ns), ())
        return [
            (
                lost.order,
                [
                    Loss(
                        int(lost.t_mono_ns),
                        lost.events,
                        lost.bytes,
                        of_log(lost.reason, lost.message),
                    )
                ],
            )
        ]
    return []


def _chunks(stream: Stream, raw: _Bytes) -> list[Event]:
    start = int(raw.t_mono_ns)
    _require_few(raw.after_us)
    times = list(accumulate(raw.after_us))
    _require_clock(start, times)
    return [
        Chunk(stream, start + after * US, text.encode("latin-1"))
        for after, text in zip(times, raw.data, strict=True)
    ]


def _require_few(times: Sequence[int]) -> None:
    if len(times) > MOST_EVENTS:
        raise impossible("events", len(times))


def _require_clock(start_ns: int, later_us: Sequence[int]) -> None:
    least, most = min(later_us, default=0), max(later_us, default=0)
    if not 0 <= start_ns + least * US <= start_ns + most * US < MAX_TIME_NS:
        raise impossible("t_mono_ns", start_ns)


def _blocks(polls: _Blocks) -> list[Event]:
    start = int(polls.t_mono_ns)
    _require_few(polls.recv_us)
    if polls.ranges.count("|") >= MOST_RANGES:
        raise impossible("ranges", polls.ranges.count("|") + 1)
    _require_clock(start, polls.recv_us)
    _require_clock(
        start,
        [
            received - answer
            for received, answer in zip(polls.recv_us, polls.answer_us, strict=True)
        ],
    )
    ranges = tuple(_range(text) for text in polls.ranges.split("|"))
    events: list[Event] = []
    before: str | None = None  # most polls repeat the data of the previous poll
    data: tuple[bytes, ...] = ()
    for recv_us, answer_us, text in zip(
        polls.recv_us, polls.answer_us, polls.data, strict=True
    ):
        recv_ns = start + recv_us * US
        if text != before:
            before, data = text, _answers(text, len(ranges))
        events.append(ModbusBlock(recv_ns - answer_us * US, recv_ns, ranges, data))
    return events


def _answers(text: str, requests: int) -> tuple[bytes, ...]:
    data = tuple(bytes.fromhex(part) for part in text.split("|"))
    if len(data) != requests:
        raise impossible("answers", f"{len(data)} / {requests}")
    return data


def _range(text: str) -> ReadRange:
    table, address, count = text.split(" ")
    if not is_table(table):
        raise impossible("table", table)
    return ReadRange(table, int(address), int(count))


def _from_runs(batch: _Batch, events: list[Event]) -> Iterator[Run]:
    number, place = batch.order, 0
    for skip, run in zip(batch.skip, batch.run, strict=True):
        number += skip
        yield number, events[place : place + run]
        number, place = number + run, place + run
    if (
        place != len(events)
        or min(batch.run, default=0) < 1
        or min(batch.skip, default=0) < 0
    ):
        raise impossible("run", sum(batch.run))
