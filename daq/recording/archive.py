"""Limits the size of a survey's folder: finished rounds are packed more tightly, the oldest first.
No file is removed.

A log is written in small chunks, so that an interruption loses little. A packed log has the same
records in chunks of 1 MB at zstd's level 19, which saves four tenths of its size. Replay, `info`
and the viewers read a packed log like any log. The packed log replaces the log only after every
record was read back and compared. Packing runs in a separate process.
"""

import hashlib
import os
import struct
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

import mcap.writer
import zstandard
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.daq.log.part_file import PartFile
from stepdiag.daq.log.reader import RecordReader
from stepdiag.daq.log.recovery import copy_record
from stepdiag.daq.log.writer import RUN_STOP
from stepdiag.daq.records.survey_folder import RESULT, logs_in

PACKED_CHUNK_BYTES = 1_000_000
LEVEL = 19
MARK = ".packed"
"""The file that marks a folder whose logs are packed."""
_ONE_AT_A_TIME = threading.Lock()
_SUFFIX = ".packing"
_DRAIN_BYTES = 4_000_000
_MAGIC = b"\x89MCAP0\r\n"
_DATA_END = struct.pack("<BQ", 0x0F, 4)
_FOOTER = struct.Struct("<QQI")
"""The footer of a log before the magic bytes: start of the index, start of its offsets,
checksum.
"""


@dataclass(frozen=True, slots=True)
class Packed:
    folder: Path
    saved_bytes: int


def size_bytes(folder: Path) -> int:
    """Return the size of all files in a folder in bytes."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def keep_budget(folder: Path, max_bytes: float) -> Iterator[Packed]:
    """Pack the finished rounds of a survey's folder, oldest first, until the folder is within
    ``max_bytes``. Yield each packed round.

    Raises DataError for a packed log that differs from its log; the log is then unchanged.
    """
    rounds = sorted(
        each for each in folder.iterdir() if each.is_dir() and each.name.isdecimal()
    )
    for each in rounds:
        if size_bytes(folder) <= max_bytes:
            return
        if (each / RESULT).exists() and not (each / MARK).exists():
            saved = sum(pack(log) for log in logs_in(each) if log.suffix == ".mcap")
            (each / MARK).touch()
            yield Packed(each, saved)


def pack(log: Path) -> int:
    """Replace a log by its packed form and return the number of saved bytes. A damaged log is
    unchanged, and the result is 0.
    """
    before = log.stat()
    wanted = digest(log)
    if not wanted:
        return 0
    part = log.with_name(log.name + _SUFFIX)
    part.with_name(part.name + _SUFFIX).unlink(missing_ok=True)
    part.unlink(missing_ok=True)
    file = PartFile(part, _SUFFIX)
    try:
        with _tight():
            _copy(log, file)
        file.publish()
    finally:
        file.close()
    if digest(part) != wanted:
        part.unlink()
        raise DataError(
            str(log),
            expected=message("same-records"),
            found=message("other-records"),
            remedy=message("report-log-unchanged"),
        )
    after = part.stat().st_size
    os.utime(part, ns=(before.st_atime_ns, before.st_mtime_ns))
    part.replace(log)
    return before.st_size - after


def digest(log: Path) -> str:
    """Return the SHA-256 of a log's records, which does not depend on the chunks; empty for a
    damaged log.
    """
    reader, sum_of = RecordReader(log), hashlib.sha256()
    for record in reader:
        if isinstance(record, Schema | Channel | Message | Metadata | Attachment):
            sum_of.update(repr(_content(record)).encode())
    return "" if reader.damage else sum_of.hexdigest()


def index_holds(log: Path) -> bool:
    """Return whether the index behind the records of a whole log is unchanged, because the digest
    of the records does not cover the index.

    Source: MCAP, Footer: ``summary_crc`` is the CRC-32 of the bytes from ``summary_start`` to the
    checksum; 0 means no checksum. The record before the index is DataEnd; readers skip a record of
    unknown kind.
    """
    data = log.read_bytes()
    if len(data) < _FOOTER.size + len(_MAGIC):
        return False
    start: int
    start, _, checksum = _FOOTER.unpack(data[-_FOOTER.size - len(_MAGIC) : -len(_MAGIC)])
    ends = data[: max(start - 4, 0)].endswith(_DATA_END)
    return ends and checksum in {zlib.crc32(data[start : -4 - len(_MAGIC)])} - {0}


def _content(record: McapRecord) -> tuple[object, ...]:
    return type(record).__name__, *sorted(vars(record).items())


def _copy(log: Path, file: PartFile) -> None:
    writer = Writer(
        cast("IO[Any]", file),
        chunk_size=PACKED_CHUNK_BYTES,
        compression=CompressionType.ZSTD,
        enable_data_crcs=True,
    )
    known: set[tuple[str, int]] = set()
    stop: dict[str, str] = {}
    for record in RecordReader(log):
        if isinstance(record, Metadata) and record.name == RUN_STOP:
            stop = dict(record.metadata)
        if isinstance(record, Schema | Channel):
            if (type(record).__name__, record.id) in known:
                continue
            known.add((type(record).__name__, record.id))
        copy_record(writer, record)
        if file.waiting > _DRAIN_BYTES:
            file.drain()
    writer.flush()  # type: ignore[no-untyped-call]
    writer.add_metadata(RUN_STOP, stop)
    writer.finish()  # type: ignore[no-untyped-call]
    file.drain()


@contextmanager
def _tight() -> Iterator[None]:
    """Make the MCAP writer, which has no setting for the level, compress with the highest level in
    this process.

    Only one use at a time is allowed: the end of the first use would reset the level of the second
    use, and the same log would be packed to other bytes.
    """
    names = vars(mcap.writer)
    with _ONE_AT_A_TIME:
        usual, names["zstandard"] = names["zstandard"], _Tight
        try:
            yield
        finally:
            names["zstandard"] = usual


class _Tight:
    compress = staticmethod(lambda data: zstandard.ZstdCompressor(level=LEVEL).compress(data))
