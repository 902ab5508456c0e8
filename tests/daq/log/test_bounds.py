"""What a small file may cost: no more than its bytes justify."""

import struct
import tracemalloc
from pathlib import Path

import pytest
import zstandard

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.readings.readings import MOST_READINGS, parse_readings
from stepdiag.daq.log.codec import MOST_EVENTS, MOST_RANGES, LogClock, decode, encode
from stepdiag.daq.log.reader import RecordReader
from stepdiag.daq.records.events import ModbusBlock, ReadRange

MAGIC = b"\x89MCAP0\r\n"


def record(opcode: int, body: bytes) -> bytes:
    """Return a record of an MCAP file (its specification, "Records")."""
    return struct.pack("<BQ", opcode, len(body)) + body


def bomb(path: Path, chunks: int, size: int) -> int:
    """Write a log of chunks that unpack to ``size`` zeros each; return the size of the file."""
    message = record(5, struct.pack("<HIQQ", 1, 0, 0, 0) + bytes(size))
    packed = zstandard.compress(message, 19)
    chunk = (
        struct.pack("<QQQI", 0, 0, len(message), 0)
        + struct.pack("<I", 4)
        + b"zstd"
        + struct.pack("<Q", len(packed))
        + packed
    )
    path.write_bytes(MAGIC + record(1, struct.pack("<II", 0, 0)) + record(6, chunk) * chunks)
    return path.stat().st_size


def test_a_small_log_does_not_unpack_to_gigabytes(tmp_path: Path) -> None:
    """A few thousand bytes that stand for two gigabytes are read up to what they justify, and the
    rest is called damage."""
    assert bomb(tmp_path / "bomb.mcap", chunks=140, size=15_000_000) < 400_000
    tracemalloc.start()
    try:
        reader = RecordReader(tmp_path / "bomb.mcap")
        seen = sum(1 for _ in reader)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert "chunks.uncompressed_size" in str(reader.damage)
    assert seen < 140
    assert peak < 200_000_000


def test_a_poll_has_no_more_ranges_than_signals() -> None:
    asked = tuple(ReadRange("holding", address, 1) for address in range(MOST_RANGES + 1))
    block = ModbusBlock(1_000, 2_000, asked, tuple(b"\0\0" for _ in asked))
    data = encode(LogClock(0), [(0, block)])
    with pytest.raises(ValueError, match=f"ranges cannot be {MOST_RANGES + 1}"):
        decode("/machine/raw", data)
    assert MOST_EVENTS > 50_000


def test_a_table_of_readings_has_an_end() -> None:
    row = "ppp,1,0,0,0,0,0\n"
    with pytest.raises(DataError, match=f"at most {MOST_READINGS} rows"):
        parse_readings(
            "setup,pass,stop,x_mm,y_mm,z_mm,reading_mm\n" + row * (MOST_READINGS + 1), "r.csv"
        )


def test_a_refusal_repeats_no_megabytes() -> None:
    """What a foreign file has in place of a word is shown by its beginning."""
    refusal = UsageError(
        "survey.toml: " + "w" * 10**6,
        expected="e" * 10**6,
        found="f" * 10**7,
        remedy="r" * 10**6,
    )
    assert len(str(refusal)) < 10_000
    assert "(10000000 characters)" in str(refusal)
