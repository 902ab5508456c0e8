"""Events for logs, and a log on disk without a thread: what the tests of recorder and logs
share."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from hypothesis import strategies as st

from stepdiag.daq.log.part_file import PartFile
from stepdiag.daq.log.topics import Note, sample_note
from stepdiag.daq.log.writer import LogHeader, LogWriter
from stepdiag.daq.records.events import Chunk, Event, LinkEvent, Loss, ModbusBlock, ReadRange

SECOND_NS = 1_000_000_000
START_NS = 5_000 * SECOND_NS
WALL_OFFSET_NS = 1_800_000_000 * SECOND_NS
SURVEY = '[survey]\nname = "Prüfung"\n'
HEADER = LogHeader(
    survey_text=SURVEY,
    wall_offset_ns=WALL_OFFSET_NS,
    start_ns=START_NS,
    run={"machine": "m", "setup": "ppp"},
)
BLOCK = (ReadRange("holding", 0, 14),)
TWO_RANGES = (ReadRange("holding", 2, 1), ReadRange("coil", 3, 9))


def laser_line(number: int) -> bytes:
    """Return a line like those of a uMD2 board at rest."""
    noise = number * 7919 % 11
    return (
        f"1500 {1500 + noise % 3 - 1} {1000 + noise} {noise - 5} {number * 31 % 256} {number} 0 "
        "0\r\n"
    ).encode()


def recording(
    seconds: float, rate_hz: int = 1000, lines_per_chunk: int = 1, poll_hz: int = 50
) -> list[Event]:
    """Return what a laser and a machine give in a time: chunks with jittering stamps, polls between
    them."""
    events: list[Event] = []
    polls = 0
    for first in range(0, int(seconds * rate_hz), lines_per_chunk):
        numbers = range(first, first + lines_per_chunk)
        time_ns = (
            START_NS + numbers[-1] * 1_000_000 // rate_hz * 1000 + first * 7919 % 90 * 1000
        )
        events.append(Chunk("laser", time_ns, b"".join(map(laser_line, numbers))))
        while polls * SECOND_NS < (time_ns - START_NS) * poll_hz:
            answer_us = 200 + polls * 37 % 300
            data = (polls // 50 % 65536).to_bytes(2, "big") + bytes(26)
            events.append(ModbusBlock(time_ns - answer_us * 1000, time_ns, BLOCK, (data,)))
            polls += 1
    return events


def write_log(
    path: Path,
    items: Iterable[Event | Note],
    *,
    flush_every: int = 500,
    finish: bool = True,
    header: LogHeader = HEADER,
) -> list[int]:
    """Write a log without a thread; return the file's length after each flush."""
    file = PartFile(path)
    lengths = []
    try:
        writer = LogWriter(file, header)
        for number, item in enumerate(items, start=1):
            (writer.note if isinstance(item, Note) else writer.event)(item)  # type: ignore[arg-type]
            if number % flush_every == 0:
                writer.flush()
                lengths.append(file.tell())
        if finish:
            writer.finish("complete", "", {})
        file.drain()
        if finish:
            file.publish()
    finally:
        file.close()
    return lengths


def with_notes(events: Sequence[Event], every: int = 100) -> list[Event | Note]:
    """Return the events with a note for the eye now and then."""
    mixed: list[Event | Note] = []
    for number, event in enumerate(events):
        mixed.append(event)
        if number % every == 0:
            mixed.append(sample_note(START_NS + number, float(number), None, 0))
    return mixed


_TIMES = st.integers(0, 10**9).map(lambda microseconds: START_NS + microseconds * 1000)
_CHUNKS = st.builds(Chunk, st.sampled_from(["laser", "head"]), _TIMES, st.binary(max_size=60))
_BLOCKS = st.builds(
    lambda sent, answer_us, ranges, some: ModbusBlock(
        sent,
        sent + answer_us * 1000,
        ranges,
        tuple(bytes(one.byte_count) if some else b"" for one in ranges),
    ),
    _TIMES,
    st.integers(0, 10**6),
    st.sampled_from([BLOCK, TWO_RANGES]),
    st.booleans(),
)
_LINKS = st.builds(
    LinkEvent,
    _TIMES,
    st.sampled_from(["laser", "head", "machine"]),
    st.sampled_from(["connecting", "connected", "silent", "lost"]),
    st.text(),
)
_LOSSES = st.builds(Loss, _TIMES, st.integers(1, 10**6), st.integers(1, 10**9), st.text())
EVENTS = st.lists(st.one_of(_CHUNKS, _BLOCKS, _LINKS, _LOSSES), max_size=60)
"""Any events in any order, times with whole microseconds."""
