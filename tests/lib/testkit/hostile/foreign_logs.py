"""A log whose checksums are right and whose contents are a foreign: the first line of defence has
been passed.

A changed log is caught by its checksums (target ``log``), so nothing behind them would ever be
tried. Here the contents stand as text, one record a line, and a writer of ours makes a whole log of
whatever is left of them.
"""

import json
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path

import msgspec
from mcap.records import Channel, Message

from stepdiag.base.errors import StepdiagError
from stepdiag.completion.completion import complete
from stepdiag.daemon.survey_state import standing_of
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.log.reader import RecordReader
from stepdiag.daq.log.recovery import log_info, recover
from stepdiag.daq.log.topics import stop_note
from stepdiag.daq.log.writer import LogHeader, LogWriter
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.recording.rounds import latest_round
from stepdiag.daq.replay import replay
from stepdiag.daq.survey.bundle import bundle_to_run
from stepdiag.daq.survey.file import parse_survey
from stepdiag.fourdof.record import head_of_log
from testkit.exact.machines import profile_text
from testkit.hostile.foreign_base import Target, refusing
from testkit.timeline import Timeline, diagonal, survey_text

WALL_OFFSET_NS = 1_800_000_000 * 10**9
RATE_HZ = 100.0
SURVEY = survey_text(setups=("ppp",), n=1, dwell=0.5).replace(
    "rate_hz = 250.0", f"rate_hz = {RATE_HZ}"
)
SURVEY += (
    '[[export]]\ncontroller = "neutral"\nprofile = "p.toml"\n[solver]\nangles = "a.csv"\n'
)
PROFILE = profile_text(
    "neutral", steps_mm=(100.0, 100.0, 50.0), references_mm=(0.0, 0.0, 0.0), direction="mean"
)
FILES = {
    "p.toml": PROFILE.encode(),
    "a.csv": b"axis,position_mm,EA_urad,EB_urad,EC_urad\nx,0,0,0,0\nx,300,1,2,3\n",
}


def log_targets() -> dict[str, Target]:
    """Return the log as bytes, and as contents under right checksums."""
    whole = recorded()
    return {
        "log": Target(whole, _every_command, weight=0.2),
        "log contents": Target(
            contents(whole), refusing(lambda data: _every_command(log_of(data))), weight=0.3
        ),
    }


def _every_command(data: bytes) -> None:
    """Do all that a person may do with a foreign log."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "0001" / "0001.mcap"
        path.parent.mkdir()
        path.write_bytes(data)
        asked: tuple[Callable[[], object], ...] = (
            lambda: log_info(path),
            lambda: replay([path]),
            lambda: head_of_log(path),
            lambda: standing_of(path.parent),
            lambda: latest_round(Path(folder), SURVEY, {}),
            lambda: complete([path], Path(folder) / "out"),
            lambda: recover(path, Path(folder) / "mended.mcap"),
        )
        for ask in asked:
            with suppress(StepdiagError):
                ask()
        stray = {each.name for each in Path(folder).iterdir()} - {
            "0001",
            "out",
            "mended.mcap",
            ".lock",
        }
        assert not stray, f"written beside the folder that was asked for: {stray}"


@cache
def recorded() -> bytes:
    """Return a whole log of one short pass, its captured stops included."""
    survey = parse_survey(SURVEY, "survey.toml")
    start = PassBook(survey).start(skip_open_dwell=False, wall_offset_ns=WALL_OFFSET_NS)
    stream = BytesIO()
    run = {"start": msgspec.json.encode(start).decode(), **bundle_to_run(FILES)}
    header = LogHeader(survey_text=SURVEY, wall_offset_ns=WALL_OFFSET_NS, start_ns=0, run=run)
    writer, capture = LogWriter(stream, header), Capture(survey, start)
    standing = [replace(stop, seconds=0.6) for stop in diagonal("ppp", n=1)]
    for number, event in enumerate(
        Timeline(standing, rate_hz=RATE_HZ, move_s=0.2, lead_s=0.3).events()
    ):
        writer.event(event)
        if number % 60 == 59:
            writer.flush()
        for outcome in capture.feed(event):
            if isinstance(outcome, CapturedStop):
                writer.note(stop_note(outcome))
    writer.finish("complete", "", {})
    return stream.getvalue()


@cache
def contents(log: bytes) -> bytes:
    """Return a log as lines: survey and run record, then every message behind its topic."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log"
        path.write_bytes(log)
        topics: dict[int, str] = {}
        header = open_log(path).header
        lines = [
            json.dumps(header.survey_text).encode(),
            json.dumps(dict(header.run)).encode(),
        ]
        for record in RecordReader(path):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                lines.append(topics[record.channel_id].encode() + b" " + record.data)
        return b"\n".join(lines)


def with_survey(text: str) -> bytes:
    """Return the short pass as if it had been recorded with another survey file."""
    _, run, *messages = contents(recorded()).split(b"\n")
    own = {
        name: word
        for name, word in json.loads(run).items()
        if name in ("start", *bundle_to_run(FILES))
    }
    return log_of(
        b"\n".join((json.dumps(text).encode(), json.dumps(own).encode(), *messages))
    )


def log_of(data: bytes) -> bytes:
    """Return the log that holds these lines; one that is no record of a log is left out."""
    text, run, *messages = [*data.split(b"\n"), b"", b""]
    stream = BytesIO()
    writer = LogWriter(
        stream,
        LogHeader(
            survey_text=_json(text, str, SURVEY),
            wall_offset_ns=0,
            start_ns=0,
            run=_json(run, dict, {}),
        ),
    )
    for message in messages:
        topic, _, body = message.partition(b" ")
        with suppress(KeyError, UnicodeDecodeError):
            writer._message(topic.decode(), 0, 0, body)
    writer.finish("complete", "", {})
    return stream.getvalue()


def _json(line: bytes, kind: type, otherwise: object) -> object:
    with suppress(ValueError, RecursionError):
        found = json.loads(line)
        if isinstance(found, kind):
            encodable = (
                json.dumps(found, ensure_ascii=False).encode("utf-8", "replace").decode()
            )
            found = json.loads(encodable)
            return (
                {str(key): str(value) for key, value in found.items()}
                if isinstance(found, dict)
                else found
            )
    return otherwise
