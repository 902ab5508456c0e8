"""While the machine is under way nobody looks at the samples: they are decoded many chunks at once,
and none is missing afterwards."""

import struct
from pathlib import Path

import numpy as np
import pytest

from stepdiag.daq.formats.instruments.umd.decoder import UmdDecoder
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import Nowhere
from stepdiag.daq.records.events import Chunk, ModbusBlock
from stepdiag.daq.survey.file import parse_survey
from stepdiag.virtual.instruments.lasers import BOARDS, UmdBoard
from testkit.exact.driven import WALL_OFFSET_NS
from testkit.recording import BLOCK
from testkit.timeline import arrival

SECONDS = 4
MS = 1_000_000
SURVEY = """
[survey]
name = "s"
machine = "m"
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 2
[laser]
format = "umd"
port = "/dev/null"
"""


def test_chunks_wait_for_their_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    """A chunk every 2 ms and a poll every 20 ms: fewer than a tenth of the chunks are decoded on
    their own."""
    calls = []
    for name in ("feed", "feed_steady"):
        original = getattr(UmdDecoder, name)
        monkeypatch.setattr(
            UmdDecoder,
            name,
            lambda self, *given, original=original: calls.append(1) or original(self, *given),
        )
    session = Session(
        parse_survey(SURVEY, "s"),
        SURVEY,
        Round(Path("nowhere"), {}),
        Nowhere(),
        on_outcome=lambda _: None,
        wall_offset_ns=lambda: WALL_OFFSET_NS,
    )
    board = UmdBoard(BOARDS["umd2"], rate_hz=500.0)
    noise = np.random.default_rng(1).normal(0.0, 2e-5, (500 * SECONDS, 1))
    chunks = [
        Chunk(
            "laser",
            (2 * number + 1) * MS,
            board.encode(100.0 + noise[number], np.ones(1, dtype=bool)),
        )
        for number in range(500 * SECONDS)
    ]
    registers = struct.pack(">HHHHiiiHHHH", 0, 0, 2, 1, 0, 0, 0, 2000, 2000, 10130, 500)
    polls = [
        ModbusBlock(20 * number * MS, 20 * number * MS + 500_000, BLOCK, (registers,))
        for number in range(1, 50 * SECONDS)
    ]
    first = len(chunks) // 4
    events = sorted([*chunks, *polls], key=arrival)
    for event in events[: len(events) // 4]:
        session.consume(event)
    calls.clear()
    for event in events[len(events) // 4 :]:
        session.consume(event)
    assert session.recording
    assert len(calls) < 0.1 * (len(chunks) - first)
    assert session.samples == len(chunks)
    assert session.strip.bins[-1][0] == chunks[-1].arrival_ns // (20 * MS)
