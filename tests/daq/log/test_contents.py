"""Logs: what is read back is what was captured, up to the first byte that is damaged."""

import io
import json
import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import Message, message
from stepdiag.daq.log.contents import LogEnd, open_log
from stepdiag.daq.log.recovery import log_info, recover
from stepdiag.daq.log.topics import CHANNELS, SAMPLE_TOPIC
from stepdiag.daq.log.writer import RUN, LogHeader, LogWriter
from stepdiag.daq.records.events import Chunk, Event, LinkEvent
from testkit.recording import (
    EVENTS,
    HEADER,
    START_NS,
    SURVEY,
    WALL_OFFSET_NS,
    recording,
    with_notes,
    write_log,
)

SHORT = recording(1.5)


def read(path: Path) -> tuple[list[Event], LogEnd]:
    log = open_log(path)
    events = list(log.events())
    assert log.end is not None
    return events, log.end


def test_events_come_back_in_the_order_of_their_capture(tmp_path: Path) -> None:
    write_log(tmp_path / "a.mcap", with_notes(SHORT))
    events, end = read(tmp_path / "a.mcap")
    assert events == SHORT
    assert end.whole
    assert end.run_stop["exit_status"] == "complete"
    assert end.messages[SAMPLE_TOPIC] == len(SHORT) // 100 + 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


@given(events=EVENTS, flush_every=st.integers(1, 70))
def test_any_events_in_any_order_come_back(
    tmp_path_factory: pytest.TempPathFactory, events: list[Event], flush_every: int
) -> None:
    """Whatever the bytes, the order of streams, equal or backward times, and wherever the log was
    flushed."""
    path = tmp_path_factory.mktemp("log") / "a.mcap"
    write_log(path, events, flush_every=flush_every)
    assert read(path)[0] == events


def test_header_and_survey_come_back(tmp_path: Path) -> None:
    write_log(tmp_path / "a.mcap", SHORT[:10])
    header = open_log(tmp_path / "a.mcap").header
    assert header.survey_text == SURVEY
    assert (header.wall_offset_ns, header.start_ns) == (WALL_OFFSET_NS, START_NS)
    assert header.run["setup"] == "ppp"
    assert header.run["log_version"] == "1"


def test_a_log_is_as_viewers_want_it(tmp_path: Path) -> None:
    """acquisition.md B2, rules 3, 5, 7, 9: schema on every channel, log time never backwards,
    sequences without a gap, metadata."""
    write_log(tmp_path / "a.mcap", with_notes(SHORT))
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert {channel.topic for channel in summary.channels.values()} == {
            channel.topic for channel in CHANNELS
        }
        assert all(
            summary.schemas[channel.schema_id].encoding == "jsonschema"
            for channel in summary.channels.values()
        )
        assert {index.compression for index in summary.chunk_indexes} == {"zstd"}
        assert {record.name for record in reader.iter_metadata()} == {
            RUN,
            "stepdiag.clock",
            "foxglove",
            "stepdiag.run_stop",
        }
        (attachment,) = reader.iter_attachments()
        assert (attachment.name, attachment.media_type, attachment.data) == (
            "survey.toml",
            "text/plain",
            SURVEY.encode(),
        )
        last = WALL_OFFSET_NS
        sequences: dict[str, int] = {}
        for _schema, channel, message in reader.iter_messages(log_time_order=False):
            assert message.log_time >= last
            assert message.sequence == sequences.get(channel.topic, 0)
            last, sequences[channel.topic] = message.log_time, message.sequence + 1
            fields = json.loads(message.data)
            assert (
                fields["time"]["sec"] * 10**9 + fields["time"]["nsec"]
                == message.publish_time
                == int(fields["t_mono_ns"]) + WALL_OFFSET_NS
            )


@pytest.mark.parametrize(
    ("lines_per_chunk", "rate_hz"), [(1, 1000), (5, 1000), (600, 100_000)]
)
def test_lines_of_an_interferometer_take_at_most_twelve_bytes(
    tmp_path: Path, lines_per_chunk: int, rate_hz: int
) -> None:
    """The promise for a log at rest, polls of the machine at 50 Hz included, flushed as the
    recorder flushes (0.4 s)."""
    seconds = 12_000 / rate_hz
    events = recording(seconds, rate_hz, lines_per_chunk)
    write_log(
        tmp_path / "a.mcap", events, flush_every=max(1, int(0.4 * len(events) / seconds))
    )
    assert (tmp_path / "a.mcap").stat().st_size / 12_000 < 12.0


def test_a_log_cut_off_anywhere_gives_what_was_flushed_before(tmp_path: Path) -> None:
    """Power loss: at every cut the events read are the first ones, and none that was flushed before
    the cut is missing."""
    lengths = write_log(tmp_path / "a.mcap", SHORT, flush_every=300)
    whole = (tmp_path / "a.mcap").read_bytes()
    cut = tmp_path / "cut.mcap.part"
    random.seed(4)
    for length in {
        *range(lengths[-2], lengths[-1], 97),
        *random.sample(range(lengths[0], len(whole)), 120),
    }:
        cut.write_bytes(whole[:length])
        events, end = read(cut)
        flushed = 300 * sum(each <= length for each in lengths)
        assert events == SHORT[: len(events)]
        assert len(events) >= flushed
        assert not end.whole


def test_a_log_that_is_closed_while_it_is_read_is_read_to_its_end(tmp_path: Path) -> None:
    """Whoever listed it under the name that it had while it was written finds it: before it was
    opened, and between two readings."""
    write_log(tmp_path / "a.mcap", SHORT, flush_every=300)
    part = (tmp_path / "a.mcap").rename(tmp_path / "a.mcap.part")
    log = open_log(part)
    part.rename(tmp_path / "a.mcap")
    assert list(log.events()) == SHORT
    again = open_log(part)
    assert list(again.events()) == SHORT
    assert again.path == tmp_path / "a.mcap"
    assert again.end is not None
    assert again.end.whole
    with pytest.raises(DataError, match="No such file"):
        open_log(tmp_path / "b.mcap.part")


def test_a_log_cut_off_in_its_header_is_refused(tmp_path: Path) -> None:
    (first,) = write_log(tmp_path / "a.mcap", SHORT[:2], flush_every=2)
    whole = (tmp_path / "a.mcap").read_bytes()
    cut = tmp_path / "cut.mcap.part"
    survey_end = whole.index(SURVEY.encode()) + len(SURVEY.encode())
    for length in range(min(survey_end, first)):
        cut.write_bytes(whole[:length])
        with pytest.raises(DataError, match=r"cut\.mcap\.part: expected "):
            open_log(cut)


def test_a_flipped_bit_is_found_and_nothing_after_it_is_used(tmp_path: Path) -> None:
    """A flip is a refusal, an early end named as damage, or lies where nothing is read from
    (indexes)."""
    write_log(tmp_path / "a.mcap", SHORT[:400], flush_every=100)
    whole = bytearray((tmp_path / "a.mcap").read_bytes())
    flipped = tmp_path / "flipped.mcap"
    random.seed(5)
    for place in random.sample(range(len(whole)), 400):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << random.randrange(8)
        flipped.write_bytes(damaged)
        try:
            events, end = read(flipped)
        except DataError:
            continue
        assert events == SHORT[: len(events)]
        assert len(events) == 400 or end.damage


@given(data=st.binary(max_size=400), keep=st.integers(0, 4000))
def test_a_foreign_bytes_are_at_worst_refused(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, keep: int
) -> None:
    path = tmp_path_factory.mktemp("log") / "a.mcap"
    stream = io.BytesIO()
    writer = LogWriter(stream, HEADER)
    writer.flush()
    path.write_bytes(stream.getvalue()[:keep] + data)
    try:
        _, end = read(path)
    except DataError as refused:
        assert "a.mcap: expected" in str(refused)  # noqa: PT017 - either outcome is right
    else:
        assert not end.whole


def foreign(path: Path, library: str, version: str = "1") -> Path:
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(library=library)
        writer.add_metadata(RUN, {"log_version": version})
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("library", "version", "message"),
    [
        ("rosbag2", "1", "expected a log of stepdiag \\(MCAP\\), found a file of rosbag2"),
        ("", "1", "found a file of an unnamed program"),
        (
            "stepdiag 9.0",
            "2",
            (
                "expected log version 1, found 2; read the log with the version of stepdiag that "
                "wrote it"
            ),
        ),
        (
            "stepdiag 0.1",
            "1",
            "expected the start of a log: run, clock and survey, found another order of records",
        ),
    ],
)
def test_logs_of_others_and_of_the_future_are_refused(
    tmp_path: Path, library: str, version: str, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        open_log(foreign(tmp_path / "a.mcap", library, version))


@pytest.mark.parametrize(
    ("content", "found"),
    [(b"", "found nothing"), (b"setup,pass,stop\n", "not a valid MCAP file")],
)
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes, found: str) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(DataError, match=found):
        open_log(tmp_path / "a.mcap")


def test_a_log_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        DataError,
        match=r"none\.mcap: expected a log of stepdiag \(MCAP\), found No such file",
    ):
        open_log(tmp_path / "none.mcap")


def chunk_log(
    path: Path,
    message: bytes,
    chunk_size: int = 100,
    compression: CompressionType = CompressionType.ZSTD,
) -> Path:
    """A log of ours by its header whose only message on the laser's channel is ``message``."""
    stream = io.BytesIO()
    LogWriter(stream, HEADER).flush()
    with path.open("wb") as file:
        file.write(stream.getvalue())
        writer = Writer(file, chunk_size=chunk_size, compression=compression)
        schema = writer.register_schema("x", "jsonschema", b"{}")
        writer.register_channel("/laser/raw", "json", schema)
        writer.add_message(1, 1, message, 1)
        writer.finish()
    return path


GOOD = {
    "time": {"sec": 1, "nsec": 0},
    "t_mono_ns": "5",
    "order": 0,
    "skip": [0],
    "run": [1],
    "after_us": [0],
    "data": ["a"],
}


def test_a_message_of_ours_by_hand_is_read(tmp_path: Path) -> None:
    events, _ = read(chunk_log(tmp_path / "a.mcap", json.dumps(GOOD).encode()))
    assert events == [Chunk("laser", 5, b"a")]


@pytest.mark.parametrize(
    "change",
    [
        {"run": [2]},
        {"run": [0, 1], "skip": [0, 0]},
        {"skip": [-1]},
        {"skip": []},
        {"data": ["€"]},
        {"after_us": [0, 1]},
        {"t_mono_ns": "x"},
        {"order": "0"},
    ],
)
def test_a_message_that_contradicts_itself_is_damage(
    tmp_path: Path, change: dict[str, object]
) -> None:
    events, end = read(chunk_log(tmp_path / "a.mcap", json.dumps(GOOD | change).encode()))
    assert events == []
    assert isinstance(end.damage, Message)
    assert end.damage.key in (
        "log-impossible",
        "log-event-twice",
        "log-event-missing",
        "log-unreadable",
    )


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    """A chunk of a few kilobytes that unpacks to a hundred megabytes is refused before it is
    unpacked."""
    path = chunk_log(tmp_path / "a.mcap", bytes(100_000_000))
    assert path.stat().st_size < 100_000
    _, end = read(path)
    assert "uncompressed_size" in str(end.damage)


def test_other_compressions_are_not_ours(tmp_path: Path) -> None:
    _, end = read(
        chunk_log(
            tmp_path / "a.mcap", json.dumps(GOOD).encode(), compression=CompressionType.LZ4
        )
    )
    assert end.damage == message("log-impossible", field="chunk.compression", value="'lz4'")


def test_recovery_keeps_every_event_and_leaves_the_damaged_log(tmp_path: Path) -> None:
    lengths = write_log(tmp_path / "a.mcap", with_notes(SHORT), flush_every=200)
    damaged = tmp_path / "0001.mcap.part"
    damaged.write_bytes((tmp_path / "a.mcap").read_bytes()[: lengths[-2] + 500])
    before = damaged.read_bytes()
    done = recover(damaged)
    assert done.target == tmp_path / "0001.mcap"
    assert damaged.read_bytes() == before
    kept, end = read(done.target)
    assert kept == read(damaged)[0]
    assert len(kept) == done.end.events > 1000
    assert end.whole
    assert end.run_stop["exit_status"] == "interrupted"
    assert end.run_stop["recovered_from"] == "0001.mcap.part"
    with done.target.open("rb") as file:
        assert sum(1 for _ in make_reader(file).iter_messages()) == done.messages
    assert not list(tmp_path.glob("*.recovering"))


def test_recovery_of_any_cut_reads_back_the_same(tmp_path: Path) -> None:
    lengths = write_log(tmp_path / "a.mcap", with_notes(SHORT[:600], 50), flush_every=150)
    whole = (tmp_path / "a.mcap").read_bytes()
    for length in range(lengths[1], len(whole), 701):
        damaged = tmp_path / f"{length}.mcap.part"
        damaged.write_bytes(whole[:length])
        assert read(recover(damaged).target)[0] == read(damaged)[0]


def test_recovery_overwrites_nothing_and_mends_only_what_is_broken(tmp_path: Path) -> None:
    write_log(tmp_path / "a.mcap", SHORT[:100])
    with pytest.raises(
        DataError, match="expected a log that was cut off, found an undamaged log"
    ):
        recover(tmp_path / "a.mcap")
    part = tmp_path / "a.mcap.part"
    part.write_bytes((tmp_path / "a.mcap").read_bytes()[:-50])
    with pytest.raises(
        DataError, match=r"a\.mcap: expected a new file, found a file that already exists"
    ):
        recover(part)
    with pytest.raises(UsageError, match="expected a file that can be written"):
        recover(part, tmp_path / "no-folder" / "b.mcap")


def test_recovery_begins_again_where_it_was_killed(tmp_path: Path) -> None:
    write_log(tmp_path / "a.mcap", SHORT[:100])
    part = tmp_path / "b.mcap.part"
    part.write_bytes((tmp_path / "a.mcap").read_bytes()[:-50])
    (tmp_path / "b.mcap.recovering").write_bytes(b"half")
    assert read(recover(part).target)[0] == SHORT[:100]


def test_info_counts_what_is_there(tmp_path: Path) -> None:
    write_log(
        tmp_path / "a.mcap",
        [*SHORT, LinkEvent(START_NS + 2 * 10**9, "laser", "lost", "unplugged")],
    )
    info = log_info(tmp_path / "a.mcap")
    assert info.stream_bytes == {
        "laser": sum(len(event.data) for event in SHORT if isinstance(event, Chunk))
    }
    assert info.polls == sum(not isinstance(event, Chunk) for event in SHORT)
    assert info.seconds == pytest.approx(2.0)
    assert info.begin_wall_ns == START_NS + WALL_OFFSET_NS
    assert info.end.whole


def test_a_survey_that_is_not_as_it_was_recorded_is_refused(tmp_path: Path) -> None:
    write_log(tmp_path / "a.mcap", SHORT[:10])
    whole = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "b.mcap").write_bytes(whole.replace(b"name = ", b"nane = ", 1))
    with pytest.raises(
        DataError,
        match="expected the survey file as it was recorded, found different content",
    ):
        open_log(tmp_path / "b.mcap")


def test_an_impossible_clock_is_refused(tmp_path: Path) -> None:
    stream = io.BytesIO()
    LogWriter(
        stream,
        LogHeader(
            survey_text="", wall_offset_ns=0, start_ns=0, clock={"start_mono_ns": str(2**70)}
        ),
    ).flush()
    (tmp_path / "a.mcap").write_bytes(stream.getvalue())
    with pytest.raises(DataError, match="expected a log with its clock and its survey file"):
        open_log(tmp_path / "a.mcap")
