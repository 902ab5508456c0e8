"""Summary of a log, and recovery of a log that was cut off."""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from stepdiag.base.errors import DataError, UsageError, system_words
from stepdiag.base.messages import message
from stepdiag.daq.log.codec import time_of
from stepdiag.daq.log.contents import LogEnd, open_log
from stepdiag.daq.log.part_file import PART_SUFFIX, PartFile
from stepdiag.daq.log.reader import RecordReader
from stepdiag.daq.log.topics import STOP_TOPIC
from stepdiag.daq.log.writer import CHUNK_BYTES, RUN_STOP
from stepdiag.daq.records.events import Chunk, ModbusBlock

_DRAIN_BYTES = 1_000_000
_SUFFIX = ".recovering"
"""Suffix of an incomplete mended log; the remains of an interrupted recovery are overwritten."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogInfo:
    """Contents of a log. ``stream_bytes`` is the number of raw bytes by stream, ``seconds`` the
    time from the first event to the last.
    """

    path: Path
    run: dict[str, str]
    clock: dict[str, str]
    begin_wall_ns: int
    seconds: float
    stream_bytes: dict[str, int]
    polls: int
    stops: int
    end: LogEnd
    carries_token: bool = False
    """Whether the survey file in the log contains an access token of the operator's page. Only
    survey files of older versions can contain a token.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    source: Path
    target: Path
    messages: int
    end: LogEnd


def log_info(path: Path) -> LogInfo:
    """Return the contents of a log. Raises DataError for a file that is no log of this program."""
    log = open_log(path)
    stream_bytes: dict[str, int] = {}
    polls = 0
    first_ns, last_ns = log.header.start_ns, log.header.start_ns
    for event in log.events():
        last_ns = max(last_ns, time_of(event))
        if isinstance(event, Chunk):
            stream_bytes[event.stream] = stream_bytes.get(event.stream, 0) + len(event.data)
        polls += isinstance(event, ModbusBlock)
    end = _end_of(log.end)
    return LogInfo(
        path=path,
        run=dict(log.header.run),
        clock=dict(log.header.clock),
        begin_wall_ns=first_ns + log.header.wall_offset_ns,
        seconds=(last_ns - first_ns) * 1e-9,
        stream_bytes=stream_bytes,
        polls=polls,
        stops=end.messages.get(STOP_TOPIC, 0),
        end=end,
        carries_token=_carries_token(log.header.survey_text),
    )


def _carries_token(survey_text: str) -> bool:
    try:
        page = tomllib.loads(survey_text).get("page")
    except (
        ValueError,
        RecursionError,
    ):  # ValueError: not TOML, or a whole number of thousands of digits
        return False
    return isinstance(page, dict) and bool(page.get("token"))


def recovered_path(path: Path) -> Path:
    """Return the path of the mended copy of a log, in the same folder: ``0001.mcap`` for
    ``0001.mcap.part``, and ``0001.recovered.mcap`` for ``0001.mcap``.
    """
    if path.suffix == PART_SUFFIX:
        return path.with_suffix("")
    return path.with_name(f"{path.stem}.recovered.mcap")


def recover(path: Path, target: Path | None = None) -> Recovery:
    """Write every whole message of a damaged log into a new, indexed log. The damaged log is
    unchanged.

    Raises DataError if the log is whole or no log of this program, if the target exists, or if the
    mended log has another number of messages or events; UsageError if the target cannot be written.
    """
    target = recovered_path(path) if target is None else target
    log = open_log(path)
    for _event in log.events():
        pass
    end = _end_of(log.end)
    if end.whole:
        raise DataError(
            str(path), expected=message("log-cut-off"), found=message("whole-log")
        )
    if target.exists():
        raise DataError(
            str(target),
            expected=message("new-file"),
            found=message("one-exists"),
            remedy=message("log-not-overwritten"),
        )
    try:
        messages = _write_mended(path, target, end)
    except OSError as error:
        raise UsageError(
            str(target), expected=message("file-can-be-written"), found=system_words(error)
        ) from error
    _check(target, end)
    return Recovery(source=path, target=target, messages=messages, end=end)


def _end_of(end: LogEnd | None) -> LogEnd:
    if end is None:
        raise RuntimeError("a log's end is known only after its events")
    return end


def _write_mended(path: Path, target: Path, end: LogEnd) -> int:
    target.with_name(target.name + _SUFFIX).unlink(missing_ok=True)
    file = PartFile(target, _SUFFIX)
    try:
        messages = _copy(path, file, end)
        file.publish()
    finally:
        file.close()
        file.part.unlink(missing_ok=True)
    return messages


def _copy(path: Path, file: PartFile, end: LogEnd) -> int:
    writer = Writer(
        cast("IO[Any]", file),
        chunk_size=CHUNK_BYTES,
        compression=CompressionType.ZSTD,
        enable_data_crcs=True,
    )
    copied = 0
    for record in _first(RecordReader(path), sum(end.messages.values())):
        copy_record(writer, record)
        copied += isinstance(record, Message)
        if file.waiting > _DRAIN_BYTES:
            file.drain()
    writer.flush()  # type: ignore[no-untyped-call]
    stop = end.run_stop or {
        "exit_status": "interrupted",
        "reason": "the log was cut off",
        "events": str(end.events),
    }
    writer.add_metadata(
        RUN_STOP,
        {
            **stop,
            "recovered_from": path.name,
            "damage": str(end.damage),
            "lost_bytes": str(end.lost_bytes),
        },
    )
    writer.finish()  # type: ignore[no-untyped-call]
    file.drain()
    return copied


def _first(records: RecordReader, messages: int) -> Iterator[McapRecord]:
    left = messages
    known: set[tuple[str, int]] = set()
    for record in records:
        if isinstance(record, Message):
            if left == 0:
                return
            left -= 1
        elif isinstance(record, Schema | Channel):
            key = (type(record).__name__, record.id)
            if key in known:
                continue
            known.add(key)
        yield record


def copy_record(writer: Writer, record: McapRecord) -> None:
    """Copy a record. Schemas and channels are numbered from 1 in order, so the copies get the same
    numbers.
    """
    match record:
        case Header():
            writer.start(profile=record.profile, library=record.library)
        case Metadata() if record.name != RUN_STOP:
            writer.add_metadata(record.name, record.metadata)
        case Attachment():
            writer.add_attachment(
                record.create_time,
                record.log_time,
                record.name,
                record.media_type,
                record.data,
            )
        case Schema():
            writer.register_schema(record.name, record.encoding, record.data)
        case Channel():
            writer.register_channel(
                record.topic, record.message_encoding, record.schema_id, record.metadata
            )
        case Message():
            writer.add_message(
                record.channel_id,
                record.log_time,
                record.data,
                record.publish_time,
                record.sequence,
            )
        case _:
            pass


def _check(target: Path, wanted: LogEnd) -> None:
    """Open the mended log again and count its messages and events, because other tools have
    reported success with an unreadable file (acquisition.md B2, rule 2).
    """
    log = open_log(target)
    for _event in log.events():
        pass
    found = _end_of(log.end)
    if (
        found.events != wanted.events
        or sum(found.messages.values()) != sum(wanted.messages.values())
        or not found.run_stop
    ):
        remedy = message("keep-both-files")
        raise DataError(
            str(target),
            expected=f"{wanted.events} events",
            found=f"{found.events} events",
            remedy=remedy,
        )
