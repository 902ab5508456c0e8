"""How fast the logs of a long survey are replayed, in how much memory, beside reading and splitting
the same bytes."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.stand import SURVEY, peak_mb
from benchmarks.table import Row
from stepdiag.daq.log.part_file import PartFile
from stepdiag.daq.log.writer import LogHeader, LogWriter
from stepdiag.daq.records.events import Chunk, Event, ModbusBlock, ReadRange
from stepdiag.virtual.instruments.lasers import BOARDS, UmdBoard

RATE_HZ, POLL_HZ = 1000, 50
LINES_A_CHUNK = 25
"""What the reading thread gathers in a fiftieth of a second and a little."""
SECOND_NS = 1_000_000_000
BLOCK = (ReadRange("holding", 0, 14),)
WALL_OFFSET_NS = 1_700_000_000 * SECOND_NS
START = {
    "hints": {name: {} for name in ("ppp", "npp", "pnp", "ppn")},
    "wall_offset_ns": WALL_OFFSET_NS,
}


def rows(hours: float) -> list[Row]:
    """Return the rows of a replay of a survey of so many hours in one log."""
    with tempfile.TemporaryDirectory() as name:
        log = Path(name) / "0001.mcap"
        write(log, int(hours * 3600))
        floor_s, _ = measured("floor", log)
        replay_s, resident_mb = measured("replay", log)
    samples = hours * 3600 * RATE_HZ
    rate, ratio = samples / replay_s, replay_s / floor_s
    return [
        Row(
            f"replay of {hours:g} hours, {samples / 1e6:.1f} million samples",
            f"{rate / 1e6:.2f} million samples/s",
            f"read and split the log: {samples / floor_s / 1e6:.2f} million/s",
            f"{ratio:.1f}",
            "ratio 3",
            ratio <= 3,
        ),
        Row(
            "the same: resident memory",
            f"{resident_mb:.0f} MB",
            goal="150 MB",
            met=resident_mb <= 150,
        ),
    ]


def write(path: Path, seconds: int) -> None:
    """Write a log of a board at rest and a program that runs, as the daemon would have done."""
    file = PartFile(path)
    survey = SURVEY.format(laser="/dev/ttyUSB0", plc_port=502, page="false", page_port=8420)
    run = {"machine": "bench", "start": msgspec.json.encode(START).decode()}
    writer = LogWriter(
        file,
        LogHeader(
            survey_text=survey, wall_offset_ns=WALL_OFFSET_NS, start_ns=SECOND_NS, run=run
        ),
    )
    for second in _seconds(seconds):
        for event in second:
            writer.event(event)
        writer.flush()
        file.drain()
    writer.finish("complete", "", {"lost_events": 0})
    file.drain()
    file.publish()
    file.close()


def _seconds(count: int) -> Iterator[list[Event]]:
    """Yield the events of each second in order."""
    board = UmdBoard(BOARDS["umd2"], rate_hz=RATE_HZ)
    noise = np.random.default_rng(1)
    for second in range(count):
        begin = (second + 1) * SECOND_NS
        lines = board.encode(
            100.0 + noise.normal(0.0, 2e-5, RATE_HZ), np.ones(RATE_HZ, dtype=bool)
        ).splitlines(keepends=True)
        late_us = noise.integers(0, 300, RATE_HZ).tolist()
        events: list[Event] = [
            Chunk(
                "laser",
                begin + (at + LINES_A_CHUNK - 1) * 1_000_000 + late_us[at] * 1000,
                b"".join(lines[at : at + LINES_A_CHUNK]),
            )
            for at in range(0, RATE_HZ, LINES_A_CHUNK)
        ]
        for poll in range(POLL_HZ):
            at = begin + poll * SECOND_NS // POLL_HZ
            words = [second & 0xFFFF, 0, 2, 1, *[0] * 6, 2000, 2000, 10130, 500]
            events.append(
                ModbusBlock(
                    at,
                    at + 400_000,
                    BLOCK,
                    (b"".join(word.to_bytes(2, "big") for word in words),),
                )
            )
        yield sorted(
            events,
            key=lambda event: event.arrival_ns if isinstance(event, Chunk) else event.recv_ns,  # type: ignore[union-attr]
        )


def measured(what: str, log: Path) -> tuple[float, float]:
    """Return (processor seconds, peak memory in MB) of a process that reads or replays a log;
    importing is not counted."""
    said = subprocess.run(
        [sys.executable, "-m", "benchmarks.bench_replay", what, log],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    seconds, memory = said.split()
    return float(seconds), float(memory)


def floor(log: Path) -> None:
    """Read the log's messages and split the bytes of the laser into lines and fields."""
    from mcap.records import Message

    from stepdiag.daq.log.reader import RecordReader

    for record in RecordReader(log):
        if isinstance(record, Message):
            for line in record.data.split(b"\\r\\n"):
                line.split()


def main() -> None:
    """Do one thing and print its processor time and peak memory."""
    what, log = sys.argv[1], Path(sys.argv[2])
    from stepdiag.daq.replay import replay

    began = time.process_time()
    if what == "floor":
        floor(log)
    else:
        replay([log])
    sys.stdout.write(f"{time.process_time() - began} {peak_mb()}\n")


if __name__ == "__main__":
    main()
