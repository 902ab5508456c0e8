"""Reading the records of a log from front to back, with bounded memory, up to the first incomplete
record.

A log may be cut off at any byte, or be a foreign file. No length in the file is trusted: records,
chunks and unpacked contents have limits, and `DAMAGE` lists every error that the reader library
raises on damaged bytes.
"""

import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, BinaryIO, cast

import msgspec
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Chunk as ChunkRecord
from mcap.records import McapRecord
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk

from stepdiag.base.errors import DataError, system_words
from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.log.part_file import PART_SUFFIX

MAX_RECORD_BYTES = 64_000_000
MAX_CHUNK_BYTES = 16_000_000
"""Largest record and largest chunk in bytes, far above every written size: a chunk has 64 KiB, a
chunk of a packed log 1 MB; the largest record is the index at the end.
"""
MOST_UNPACKED_BYTES, MOST_UNPACKED_PER_BYTE = 16_000_000, 1000
"""Largest number of unpacked bytes of all chunks: a constant, plus a number per byte read. The log
of a laser at rest for hours has 400 unpacked bytes per byte.
"""


class BrokenRecordError(ValueError):
    """A record that no log of this program can contain; ``words`` is the reason."""

    def __init__(self, words: Message) -> None:
        super().__init__(str(words))
        self.words = words


def impossible(field: str, value: object) -> BrokenRecordError:
    return BrokenRecordError(message("log-impossible", field=field, value=str(value)))


DAMAGE = (
    McapError,
    CRCValidationError,
    struct.error,
    zstandard.ZstdError,
    msgspec.DecodeError,
    UnicodeError,
    ValueError,
    RecursionError,
    OverflowError,
)
"""Every error that damaged bytes raise in the reader (measured on logs cut at every byte and with
flipped bits). A wrong number raises ValueError.
"""


def damage_of(error: Exception) -> Message:
    if isinstance(error, EndOfFile | struct.error):
        return message("log-cut-off-here")
    return (
        error.words
        if isinstance(error, BrokenRecordError)
        else message("log-unreadable", what=str(error) or type(error).__name__)
    )


class _BoundedFile:
    """A file that refuses to read more bytes at once than the size of a record, because the reader
    library does not check lengths inside a record.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, length: int) -> bytes:
        if length > MAX_RECORD_BYTES:
            raise impossible("record.length", length)
        return self._file.read(length)


class RecordReader:
    """The records of a file in order. After the iteration ``damage`` is the reason of an early end,
    or empty.

    A log that is closed during the iteration gets a new name; ``path`` is then the new name.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.good_bytes = 0
        self.damage: Words = ""

    def __iter__(self) -> Iterator[McapRecord]:
        with self._open() as file:
            try:
                reader = StreamReader(
                    cast("IO[bytes]", _BoundedFile(file)),
                    emit_chunks=True,
                    validate_crcs=True,
                    record_size_limit=MAX_RECORD_BYTES,
                )
                unpacked = 0
                for record in reader.records:
                    if isinstance(record, ChunkRecord):
                        unpacked += _claimed_bytes(record)
                        if (
                            unpacked
                            > MOST_UNPACKED_BYTES + MOST_UNPACKED_PER_BYTE * file.tell()
                        ):
                            raise impossible("chunks.uncompressed_size", unpacked)
                    parts = _unpack(record) if isinstance(record, ChunkRecord) else [record]
                    self.good_bytes = file.tell()
                    yield from parts
            except DAMAGE as error:
                self.damage = damage_of(error)

    def _open(self) -> BinaryIO:
        try:
            if self.path.suffix == PART_SUFFIX:
                with suppress(FileNotFoundError):
                    return self.path.open("rb")
                self.path = self.path.with_suffix("")
            return self.path.open("rb")
        except OSError as error:
            raise DataError(
                str(self.path), expected=message("log-of-stepdiag"), found=system_words(error)
            ) from error


def stored_bytes(path: Path) -> int:
    """Return the size of a log in bytes, also of a log that was renamed. Raises DataError for a
    missing log.
    """
    try:
        if path.suffix == PART_SUFFIX:
            with suppress(FileNotFoundError):
                return path.stat().st_size
            path = path.with_suffix("")
        return path.stat().st_size
    except OSError as error:
        raise DataError(
            str(path), expected=message("log-of-stepdiag"), found=system_words(error)
        ) from error


def _unpack(chunk: ChunkRecord) -> list[McapRecord]:
    return breakup_chunk(chunk, validate_crc=True)


def _claimed_bytes(chunk: ChunkRecord) -> int:
    if chunk.compression != "zstd":
        raise impossible("chunk.compression", repr(chunk.compression))
    claimed = max(chunk.uncompressed_size, zstandard.frame_content_size(chunk.data))
    if claimed > MAX_CHUNK_BYTES:
        raise impossible("chunk.uncompressed_size", claimed)
    return claimed
