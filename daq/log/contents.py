"""Reading logs: the header, the events in the order of capture, and the end."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.files import LARGEST_SETTINGS_BYTES
from stepdiag.base.messages import Words, message
from stepdiag.daq.log.codec import MAX_TIME_NS, Run, decode
from stepdiag.daq.log.reader import (
    DAMAGE,
    BrokenRecordError,
    RecordReader,
    damage_of,
    impossible,
    stored_bytes,
)
from stepdiag.daq.log.writer import (
    CLOCK,
    LIBRARY,
    LOG_VERSION,
    RUN,
    RUN_STOP,
    SURVEY_ATTACHMENT,
    LogHeader,
    survey_digest,
)
from stepdiag.daq.records.events import Event

MOST_RECORDS_BEFORE_SURVEY = 16
MAX_WAITING_EVENTS = 1_000_000
"""Largest number of events that wait for an event with a lower number; in an undamaged log one
batch waits at most.
"""


MOST_EVENTS, MOST_EVENTS_PER_BYTE = 1_000_000, 4
"""Largest number of events of a log: a constant, plus a number per byte of the log. Each event
needs at least a byte for its time.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEnd:
    """The end of a log. ``damage`` is empty for a whole log; ``run_stop`` is the last record of the
    recorder, empty if this record is missing.

    ``dropped_events`` is the number of events that were read but not used, because the damaged part
    contained an earlier event; a mended log contains these events too. ``lost_bytes`` is the number
    of bytes that could not be read.
    """

    events: int
    messages: dict[str, int]
    damage: Words
    dropped_events: int
    lost_bytes: int
    run_stop: dict[str, str]

    @property
    def whole(self) -> bool:
        """Return whether the log was closed and is undamaged."""
        return not self.damage and bool(self.run_stop)


@dataclass(slots=True)
class Log:
    """An opened log; ``end`` is valid after `events` is exhausted."""

    path: Path
    header: LogHeader
    end: LogEnd | None = None

    def events(self) -> Iterator[Event]:
        """Yield the events in the order of capture up to the first lost event, with bounded
        memory.
        """
        reader = RecordReader(self.path)
        walk = _Walk()
        for record in reader:
            try:
                walk.require_justified(reader.good_bytes)
                runs = walk.take(record)
            except DAMAGE as error:
                reader.damage = damage_of(error)
                break
            for run in runs:
                yield from run
        self.end = walk.end(reader)


@dataclass(slots=True)
class _Walk:
    next: int = 0
    waiting: dict[int, list[Event]] = field(default_factory=dict)
    waiting_events: int = 0
    topics: dict[int, str] = field(default_factory=dict)
    messages: Counter[str] = field(default_factory=Counter)
    run_stop: dict[str, str] = field(default_factory=dict)

    def take(self, record: McapRecord) -> list[list[Event]]:
        """Process a record; return the runs of events that now follow the returned events without a
        gap.
        """
        match record:
            case Message():
                topic = self.topics.get(record.channel_id, "")
                ready = self._order(decode(topic, record.data))
                self.messages[topic] += 1
                return ready
            case Channel():
                self.topics[record.id] = record.topic
            case Metadata() if record.name == RUN_STOP:
                self.run_stop = dict(record.metadata)
            case _:
                pass
        return []

    def require_justified(self, read_bytes: int) -> None:
        """Raise ValueError if the log has more events than the bytes read until now can contain."""
        events = self.next + self.waiting_events
        if events > MOST_EVENTS + MOST_EVENTS_PER_BYTE * read_bytes:
            raise impossible("events", events)

    def _order(self, runs: list[Run]) -> list[list[Event]]:
        for number, events in runs:
            if number < self.next or number in self.waiting:
                raise BrokenRecordError(message("log-event-twice", number=number))
            self.waiting[number] = events
            self.waiting_events += len(events)
        if self.waiting_events > MAX_WAITING_EVENTS:
            raise BrokenRecordError(message("log-event-missing", number=self.next))
        ready = []
        while (events := self.waiting.pop(self.next, [])) != []:
            ready.append(events)
            self.next += len(events)
            self.waiting_events -= len(events)
        return ready

    def end(self, reader: RecordReader) -> LogEnd:
        damage = reader.damage
        if not damage and self.waiting and "recovered_from" not in self.run_stop:
            damage = message("log-event-missing", number=self.next)
        return LogEnd(
            events=self.next,
            messages=dict(self.messages),
            damage=damage,
            dropped_events=self.waiting_events,
            lost_bytes=stored_bytes(reader.path) - reader.good_bytes if damage else 0,
            run_stop=self.run_stop,
        )


def must_be_there(path: Path) -> None:
    if not path.exists():
        raise UsageError(
            str(path), expected=message("log-or-folder"), found=message("nothing-of-name")
        )


def open_log(path: Path) -> Log:
    """Open a log and read its header.

    Raises DataError for a file that is unreadable, that is no log of this program, that was written
    by a newer version, or that was cut off inside its header.
    """
    reader = RecordReader(path)
    metadata: dict[str, dict[str, str]] = {}
    library = ""
    for record in reader:
        match record:
            case Header():
                library = record.library
                _check_library(path, library)
            case Metadata() if len(metadata) < MOST_RECORDS_BEFORE_SURVEY:
                metadata[record.name] = dict(record.metadata)
                _check_version(path, metadata)
            case Attachment() if record.name == SURVEY_ATTACHMENT:
                return Log(reader.path, _header(reader.path, metadata, record.data))
            case _:
                break
    found = (
        message("nothing")
        if stored_bytes(reader.path) == 0
        else reader.damage or message("other-record-order")
    )
    if not library:
        raise DataError(str(path), expected=message("log-of-stepdiag"), found=found)
    raise DataError(
        str(path),
        expected=message("start-of-log"),
        found=found,
        remedy=message("cut-off-before-start"),
    )


def _check_library(path: Path, library: str) -> None:
    if library.split(" ", maxsplit=1)[0] != LIBRARY:
        raise DataError(
            str(path),
            expected=message("log-of-stepdiag"),
            found=message("file-of-program", name=library or message("unnamed-program")),
        )


def _check_version(path: Path, metadata: dict[str, dict[str, str]]) -> None:
    found = metadata.get(RUN, {}).get("log_version", "")
    if found != str(LOG_VERSION):
        raise DataError(
            str(path),
            expected=message("log-version", version=str(LOG_VERSION)),
            found=found or message("none"),
            remedy=message("read-with-its-version"),
        )


def _header(path: Path, metadata: dict[str, dict[str, str]], survey: bytes) -> LogHeader:
    run, clock = metadata[RUN], metadata.get(CLOCK, {})
    if len(survey) > LARGEST_SETTINGS_BYTES:
        raise DataError(
            str(path),
            expected=message("survey-at-most", count=LARGEST_SETTINGS_BYTES),
            found=str(len(survey)),
        )
    try:
        text = survey.decode("utf-8")
        offset_ns, start_ns = (
            int(clock["wall_minus_monotonic_ns"]),
            int(clock["start_mono_ns"]),
        )
        if not (0 <= start_ns < MAX_TIME_NS and 0 <= start_ns + offset_ns < MAX_TIME_NS):
            raise impossible("clock", f"{start_ns} + {offset_ns} ns")
    except (UnicodeDecodeError, KeyError, ValueError) as error:
        raise DataError(
            str(path), expected=message("clock-and-survey"), found=damage_of(error)
        ) from error
    if survey_digest(text) != run.get("survey_sha256"):
        raise DataError(
            str(path),
            expected=message("survey-as-recorded"),
            found=message("another-one"),
            remedy=message("damaged-at-start"),
        )
    return LogHeader(
        survey_text=text, wall_offset_ns=offset_ns, start_ns=start_ns, run=run, clock=clock
    )
