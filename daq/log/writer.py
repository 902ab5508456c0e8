"""Writes a log (MCAP) into a stream of bytes.

A chunk has up to 64 KiB, zstd and a CRC. The flushes of the recorder limit the loss of the last
chunk. Only a fast instrument fills a chunk before a flush; smaller chunks would need a quarter more
time.
"""

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import IO, Any, Literal, cast

import msgspec
from mcap.writer import CompressionType, Writer

from stepdiag.daq.log.codec import (
    LogClock,
    Numbered,
    encode,
    joins,
    time_of,
    topic_of,
    whole_us,
)
from stepdiag.daq.log.topics import CHANNELS, LOG_TOPIC, VOLUME_TOPIC, Note
from stepdiag.daq.records.events import Chunk, Event

LOG_VERSION = 1
LIBRARY = "stepdiag"
RUN = "stepdiag.run"
CLOCK = "stepdiag.clock"
RUN_STOP = "stepdiag.run_stop"
SURVEY_ATTACHMENT = "survey.toml"
CHUNK_BYTES = 65_536
BATCH_BYTES = 65_536
"""Size in bytes of the waiting events at which the batches are written at once. The text of the
events has about the same size.
"""

ExitStatus = Literal["complete", "aborted", "interrupted"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LogHeader:
    """The first record of a log.

    ``wall_offset_ns`` is the time of day minus the host's clock (`host_clock`). ``run`` (run id,
    setup, initial state) and ``clock`` (latency timer, low-latency mode) contain texts by name; the
    caller chooses the names. The program adds versions and the SHA-256 of the survey file.
    """

    survey_text: str
    wall_offset_ns: int
    start_ns: int
    run: Mapping[str, str] = field(default_factory=dict)
    clock: Mapping[str, str] = field(default_factory=dict)


def survey_digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


class LogWriter:
    """Writes the events and notes of a log into a stream with ``write``, ``tell`` and ``flush``."""

    def __init__(self, stream: object, header: LogHeader) -> None:
        self.counts: Counter[str] = Counter()
        self._clock = LogClock(header.wall_offset_ns)
        self._writer = Writer(
            cast("IO[Any]", stream),
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            enable_crcs=True,
            enable_data_crcs=True,
        )
        self._encode = msgspec.json.Encoder().encode
        self._log_time_ns = self._clock.wall_ns(header.start_ns)
        self._next = 0
        self._batches: dict[str, list[Numbered]] = {}
        self._batched = 0
        self._channels: dict[str, int] = {}
        self._sequences: Counter[str] = Counter()
        self._begin(header)

    def _begin(self, header: LogHeader) -> None:
        software = version("stepdiag")
        digest = survey_digest(header.survey_text)
        run = {
            "log_version": str(LOG_VERSION),
            "software": software,
            "survey_sha256": digest,
            **header.run,
        }
        clock = {
            "source": "CLOCK_BOOTTIME",
            "wall_minus_monotonic_ns": str(header.wall_offset_ns),
            "start_mono_ns": str(header.start_ns),
        }
        self._writer.start(profile="", library=f"{LIBRARY} {software}")
        self._writer.add_metadata(RUN, run)
        self._writer.add_metadata(CLOCK, {**clock, **header.clock})
        self._writer.add_metadata("foxglove", {"deviceName": run.get("machine", LIBRARY)})
        now = self._log_time_ns
        self._writer.add_attachment(
            now, now, SURVEY_ATTACHMENT, "text/plain", header.survey_text.encode()
        )
        schemas: dict[str, int] = {}
        for channel in CHANNELS:
            if channel.schema_name not in schemas:
                schemas[channel.schema_name] = self._writer.register_schema(
                    channel.schema_name, "jsonschema", channel.schema
                )
            self._channels[channel.topic] = self._writer.register_channel(
                channel.topic, "json", schemas[channel.schema_name]
            )

    def event(self, event: Event) -> None:
        """Add the next event in the order of processing; its times are stored in whole
        microseconds.
        """
        event = whole_us(event)
        topic = topic_of(event)
        batch = self._batches.setdefault(topic, [])
        if batch and not joins(batch[-1][1], event):
            self._write_batch(topic)
            batch = self._batches.setdefault(topic, [])
        batch.append((self._next, event))
        self._next += 1
        self._batched += 10 + len(event.data) if isinstance(event, Chunk) else 50
        if self._batched >= BATCH_BYTES:
            self._write_batches()

    def note(self, note: Note) -> None:
        """Write a note without its fields that are None."""
        stamp = self._clock.stamp(note.time_ns)
        fields = {name: value for name, value in note.fields.items() if value is not None}
        times = {"time": stamp, "t_mono_ns": str(note.time_ns)}
        if note.topic == LOG_TOPIC:
            times = {"timestamp": stamp}
        elif note.topic == VOLUME_TOPIC:
            times, fields = (
                {},
                {
                    **fields,
                    "entities": [
                        {"timestamp": stamp, **entity} for entity in fields["entities"]
                    ],
                },
            )
        self._message(
            note.topic, note.time_ns, note.time_ns, self._encode({**times, **fields})
        )

    def flush(self) -> None:
        """Pass all added events and notes to the stream, as a closed chunk."""
        self._write_batches()
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self, status: ExitStatus, reason: str, counters: Mapping[str, int]) -> None:
        """Write the end of the log: its status, its counts, and the indexes."""
        self._write_batches()
        totals = {"events": self._next, **self.counts, **counters}
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._writer.add_metadata(
            RUN_STOP,
            {
                "exit_status": status,
                "reason": reason,
                **{name: str(count) for name, count in totals.items()},
            },
        )
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _write_batches(self) -> None:
        for topic in list(self._batches):
            self._write_batch(topic)
        self._batched = 0

    def _write_batch(self, topic: str) -> None:
        batch = self._batches.pop(topic)
        first, last = batch[0][1], batch[-1][1]
        self._message(topic, time_of(first), time_of(last), encode(self._clock, batch))

    def _message(self, topic: str, publish_ns: int, taken_ns: int, data: bytes) -> None:
        """Write a message. The log times of messages never decrease (acquisition.md B2, rule 5)."""
        self._log_time_ns = max(self._log_time_ns, self._clock.wall_ns(taken_ns))
        sequence = self._sequences[topic]
        self._sequences[topic] += 1
        self.counts[topic] += 1
        self._writer.add_message(
            self._channels[topic],
            self._log_time_ns,
            data,
            self._clock.wall_ns(publish_ns),
            sequence,
        )
