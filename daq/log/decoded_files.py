"""The files of ``stepdiag decode``: every sample as CSV, as Parquet, or as MCAP with the notes of
the log.
"""

import csv
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Channel as ChannelRecord
from mcap.records import Message, Schema
from mcap.writer import CompressionType, Writer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.daq.log.codec import LogClock
from stepdiag.daq.log.contents import Log
from stepdiag.daq.log.decoded import Decoded
from stepdiag.daq.log.reader import RecordReader
from stepdiag.daq.log.topics import BLOCK_TOPIC, DECODED_CHANNELS, RAW_TOPICS
from stepdiag.daq.records.events import Stream

RAW = {*RAW_TOPICS.values(), BLOCK_TOPIC}
Write = Callable[[Path, Log, Stream, Iterator[Decoded]], int]
"""A function that writes the blocks of a stream into a new file and returns the number of written
samples.
"""


def write_csv(path: Path, _log: Log, _stream: Stream, blocks: Iterator[Decoded]) -> int:
    """Write a header and one line per sample; an unknown value is an empty field."""
    count = 0
    with path.open("x", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        for block in blocks:
            columns = block.columns()
            if not count:
                writer.writerow(columns)
            texts = [
                [_plain(value) for value in column.tolist()] for column in columns.values()
            ]
            writer.writerows(zip(*texts, strict=True))
            count += len(block.time_ns)
    return count


def write_parquet(path: Path, log: Log, stream: Stream, blocks: Iterator[Decoded]) -> int:
    """Write typed columns; the metadata of the file contain the log and the stream. Raises
    UsageError without pyarrow.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise UsageError(
            "--to parquet",
            expected=message("pyarrow"),
            found=message("none"),
            remedy=message("install-parquet"),
        ) from error
    count, writer = 0, None
    try:
        for block in blocks:
            table = pa.table(
                {
                    name: pa.array(column, from_pandas=True)
                    for name, column in block.columns().items()
                }
            )
            table = table.replace_schema_metadata({"log": log.path.name, "stream": stream})
            writer = writer or parquet.ParquetWriter(path, table.schema)
            writer.write_table(table)
            count += len(block.time_ns)
    finally:
        if writer is not None:
            writer.close()
    return count


def write_mcap(path: Path, log: Log, stream: Stream, blocks: Iterator[Decoded]) -> int:
    """Write one message per sample, and the notes of the log (stops, signals, findings, scene) for
    a viewer.
    """
    with path.open("xb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="", library="stepdiag")
        _copy_notes(writer, log.path)
        channel = DECODED_CHANNELS[stream]
        number = writer.register_channel(
            channel.topic,
            "json",
            writer.register_schema(channel.schema_name, "jsonschema", channel.schema),
        )
        count = sum(
            _samples(writer, number, LogClock(log.header.wall_offset_ns), block)
            for block in blocks
        )
        writer.finish()  # type: ignore[no-untyped-call]
    return count


FORMATS: Mapping[str, Write] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "mcap": write_mcap,
}


def _samples(writer: Writer, channel: int, clock: LogClock, block: Decoded) -> int:
    encode = msgspec.json.Encoder().encode
    names = ("counter", "position_mm", "beam", "flags")
    rows = zip(
        block.time_ns.tolist(),
        block.mono_ns.tolist(),
        *(getattr(block, name).tolist() for name in names),
        strict=True,
    )
    channels = block.channels.tolist() if block.channels is not None else None
    for index, (time_ns, mono_ns, *values) in enumerate(rows):
        known = {
            name: value
            for name, value in zip(names, values, strict=True)
            if _plain(value) != ""
        }
        fields: dict[str, Any] = {
            "time": clock.stamp(mono_ns),
            "t_mono_ns": str(mono_ns),
            **known,
        }
        if channels is not None:
            fields["channels"] = channels[index]
        writer.add_message(channel, time_ns, encode(fields), time_ns)
    return len(block.time_ns)


def _copy_notes(writer: Writer, path: Path) -> None:
    schemas, channels = dict[int, int](), dict[int, int]()
    for record in RecordReader(path):
        match record:
            case Schema():
                schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
            case ChannelRecord() if record.topic not in RAW:
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id]
                )
            case Message() if record.channel_id in channels:
                writer.add_message(
                    channels[record.channel_id],
                    record.log_time,
                    record.data,
                    record.publish_time,
                )
            case _:
                pass


def _plain(value: float) -> float | str:
    return "" if isinstance(value, float) and math.isnan(value) else value
