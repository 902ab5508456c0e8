"""A log at full rate: every sample once, at its own time, whatever the blocks and whatever the
file."""

import csv
import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest
from mcap.reader import make_reader

from stepdiag.api import read_log
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import Message, message
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.log import decoded as module
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.log.decoded import decoded
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.records.events import Chunk, LinkEvent
from stepdiag.daq.records.status import LinkState
from stepdiag.daq.survey.file import parse_survey
from testkit.cli import stepdiag
from testkit.recording import (
    START_NS,
    WALL_OFFSET_NS,
    LogHeader,
    recording,
    with_notes,
    write_log,
)

SURVEY = """[survey]
name = "s"
machine = "m"
[volume]
size_mm = [100.0, 100.0, 100.0]
increments = 2
[laser]
format = "umd"
port = "p"
[laser.umd]
phase_bits = 8
"""
SECONDS = 3


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "0001.mcap"
    header = LogHeader(survey_text=SURVEY, wall_offset_ns=WALL_OFFSET_NS, start_ns=START_NS)
    write_log(path, with_notes(recording(SECONDS, lines_per_chunk=5)), header=header)
    return path


def test_every_sample_stands_at_its_own_time(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Evenly spaced though they come in fives with jitter, at the wall time of the log; the same
    where they are handed out in blocks."""
    (whole,) = decoded(open_log(log))
    assert whole.counter.tolist() == list(range(1000 * SECONDS))
    assert np.diff(whole.time_ns) == pytest.approx(1e6, abs=30e3)
    assert whole.time_ns[0] == pytest.approx(START_NS + WALL_OFFSET_NS, abs=2e6)
    assert (whole.time_ns - whole.mono_ns == WALL_OFFSET_NS).all()
    monkeypatch.setattr(module, "AT_ONCE_NS", 500_000_000)
    blocks = list(decoded(open_log(log)))
    assert len(blocks) > 3
    assert (
        np.concatenate([block.position_mm for block in blocks]).tolist()
        == whole.position_mm.tolist()
    )
    assert np.concatenate([block.time_ns for block in blocks]) == pytest.approx(
        whole.time_ns, abs=100e3
    )


def test_a_laser_that_hangs_is_decoded_to_its_end(tmp_path: Path) -> None:
    """The same line again and again, a hundred at a time, packs like nothing else that a recorder
    writes."""
    survey = (
        SURVEY.partition("[laser]")[0]
        + '[laser]\nformat = "line"\nport = "p"\n[laser.line]\npattern = "(?P<position>[0-9.]+)"\n'
    )
    path, reads = tmp_path / "0001.mcap", 4_500
    events = [
        Chunk(
            "laser",
            START_NS + 10_000_000 * n + 90_000 * (n * 7919 % 11),
            b"123.45678\r\n" * 100,
        )
        for n in range(reads)
    ]
    write_log(
        path,
        events,
        flush_every=40,
        header=LogHeader(
            survey_text=survey, wall_offset_ns=WALL_OFFSET_NS, start_ns=START_NS
        ),
    )
    assert 100 * reads > 5 * path.stat().st_size
    assert sum(len(block.position_mm) for block in decoded(open_log(path))) == 100 * reads


@pytest.mark.parametrize(
    ("state", "lost", "kept"),
    [
        ("silent", (), True),
        ("connected", (), True),
        ("connected", (message("lost-framing", count=1),), True),
        ("lost", (), False),
    ],
)
def test_a_line_is_cut_where_the_recording_cut_it(
    tmp_path: Path, state: LinkState, lost: tuple[Message, ...], kept: bool
) -> None:
    """A link's event between two halves of a line: who decodes the log has the samples that the
    capture had, no fewer and no more."""
    chunks = [event for event in recording(1, lines_per_chunk=5) if isinstance(event, Chunk)]
    middle = chunks[100]
    halves = [
        Chunk("laser", middle.arrival_ns, middle.data[:7]),
        Chunk("laser", middle.arrival_ns, middle.data[7:]),
    ]
    events = [
        *chunks[:100],
        halves[0],
        LinkEvent(middle.arrival_ns, "laser", state, "p", lost),
        halves[1],
        *chunks[101:],
    ]
    path = tmp_path / "0001.mcap"
    header = LogHeader(
        survey_text=SURVEY,
        wall_offset_ns=WALL_OFFSET_NS,
        start_ns=START_NS,
        run={"start": '{"hints": {}}'},
    )
    write_log(path, events, header=header)
    survey = parse_survey(SURVEY, "s")
    capture = Capture(survey, PassBook(survey).start(skip_open_dwell=False))
    for event in events:
        capture.feed(event)
    (whole,) = decoded(open_log(path))
    assert len(whole.counter) == len(read_log(path).laser) == capture.laser.samples
    assert (capture.laser.samples == 1000) is kept


def test_a_log_that_is_closed_between_opening_and_decoding_is_decoded(
    log: Path, tmp_path: Path
) -> None:
    part = tmp_path / "0001.mcap.part"
    part.write_bytes(log.read_bytes())
    opened = open_log(part)
    part.rename(part.with_suffix(""))
    assert sum(len(block.counter) for block in decoded(opened)) == 1000 * SECONDS


@pytest.mark.parametrize("kind", ["csv", "parquet", "mcap"])
def test_every_form_holds_the_same_samples(log: Path, tmp_path: Path, kind: str) -> None:
    (whole,) = decoded(open_log(log))
    target = tmp_path / f"out.{kind}"
    assert "3000 samples" in stepdiag("decode", log, "--to", kind, "--out", target).out
    if kind == "csv":
        with target.open(newline="") as file:
            rows = list(csv.DictReader(file))
        times, positions = (
            [int(row["time_ns"]) for row in rows],
            [float(row["position_mm"]) for row in rows],
        )
    elif kind == "parquet":
        table = parquet.read_table(target)
        times, positions = table["time_ns"].to_pylist(), table["position_mm"].to_pylist()
        assert table.schema.metadata[b"stream"] == b"laser"
    else:
        with target.open("rb") as file:
            messages = [
                (channel.topic, json.loads(message.data))
                for _, channel, message in make_reader(file).iter_messages()
            ]
        samples = [each for topic, each in messages if topic == "/laser/decoded"]
        times = [each["time"]["sec"] * 10**9 + each["time"]["nsec"] for each in samples]
        positions = [each["position_mm"] for each in samples]
        assert {topic for topic, _ in messages} == {"/laser/decoded", "/laser/sample"}, (
            "notes are taken along, raw bytes are not"
        )
    assert positions == whole.position_mm.tolist()
    assert times == whole.time_ns.tolist()
    assert list(tmp_path.iterdir()) == [target]


def test_what_cannot_be_decoded_is_refused_and_leaves_nothing(
    log: Path, tmp_path: Path
) -> None:
    """A form or stream that is none, a file that is there, a head that the survey has not, a log
    without a sample."""
    empty = tmp_path / "0002.mcap"
    write_log(
        empty, [], header=LogHeader(survey_text=SURVEY, wall_offset_ns=0, start_ns=START_NS)
    )
    there = tmp_path / "there.csv"
    there.write_text("mine", encoding="utf-8")
    for code, arguments in (
        (2, (log, "--to", "xlsx")),
        (2, (log, "--stream", "plc")),
        (2, (log, "--stream", "head")),
        (2, (log, "--out", there)),
        (3, (empty, "--out", tmp_path / "none.csv")),
    ):
        assert stepdiag("decode", *arguments).code == code, arguments
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0002.mcap", "there.csv"]
    assert there.read_text(encoding="utf-8") == "mine"
    with pytest.raises(UsageError, match="no other stream"):
        list(decoded(open_log(log), "head"))
    with pytest.raises(DataError, match="samples of the laser"):
        list(decoded(open_log(empty)))


def test_a_survey_that_is_not_read_any_more_is_replaced(log: Path, tmp_path: Path) -> None:
    old, instead = tmp_path / "0001.mcap", tmp_path / "instead.toml"
    header = LogHeader(
        survey_text=SURVEY + "[of_old]\nkey = 1\n",
        wall_offset_ns=WALL_OFFSET_NS,
        start_ns=START_NS,
    )
    write_log(old, recording(SECONDS, lines_per_chunk=5), header=header)
    instead.write_text(SURVEY, encoding="utf-8")
    assert stepdiag("decode", old, "--out", tmp_path / "none.csv").code == 2
    assert (
        "3000 samples"
        in stepdiag("decode", old, "--survey", instead, "--out", tmp_path / "some.csv").out
    )
