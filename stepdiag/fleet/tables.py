"""The rows of one result as a Parquet file: long format, texts that repeat stored once, zstd."""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields

import pyarrow as pa
import pyarrow.parquet as pq

from stepdiag.fleet.rows import About, Row
from stepdiag.solver.errors import DataError

VERSION = "1"
_MARK = b"stepdiag-rows"
_WORD = pa.dictionary(pa.int32(), pa.string())
SCHEMA = pa.schema(
    [
        ("machine", _WORD), ("survey", _WORD), ("time", pa.timestamp("us", tz="UTC")), ("event", _WORD),
        ("quantity", _WORD), ("axis", _WORD), ("position_mm", pa.float64()), ("value", pa.float64()), ("u", pa.float64()),
        ("k", pa.int8()), ("unit", _WORD), ("method", _WORD), ("software", _WORD), ("conditions", _WORD),
    ]
)  # fmt: skip
COLUMNS = tuple(SCHEMA.names)
_WORDS = [field.name for field in SCHEMA if field.type == _WORD]
PLACE = "place"
"""The column behind ours in an index: the folder of the survey that a row is of."""


def table_of(about: About, rows: Sequence[Row]) -> pa.Table:
    """Return the rows of one result as a table of `SCHEMA`."""
    shared = {field.name: [getattr(about, field.name)] * len(rows) for field in fields(about)}
    own = {field.name: [getattr(row, field.name) for row in rows] for field in fields(Row)}
    return pa.table({name: (shared | own)[name] for name in COLUMNS}, schema=SCHEMA)


def to_parquet(table: pa.Table) -> bytes:
    """Return the bytes of a table: the same for the same rows."""
    out = io.BytesIO()
    with pq.ParquetWriter(
        out, table.schema, compression="zstd", compression_level=9, write_statistics=["time"], store_schema=False
    ) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({_MARK: VERSION})
    return out.getvalue()


def from_parquet(source: bytes | str, name: str, *, index: bool = False) -> pa.Table:
    """Return the table in a file, given as bytes or as a path. Raises DataError as `require_ours` does."""
    with _damage_said(name):
        _require_ours(pq.ParquetFile(_opened(source)), name, index=index)
        return pq.ParquetFile(_opened(source), read_dictionary=[*_WORDS, *[PLACE][:index]]).read()


def require_ours(source: bytes | str, name: str, *, index: bool = False) -> None:
    """Raise DataError for a file that is damaged, foreign, or of a newer version; only its end is read."""
    with _damage_said(name):
        _require_ours(pq.ParquetFile(_opened(source)), name, index=index)


def _opened(source: bytes | str) -> io.BytesIO | str:
    return io.BytesIO(source) if isinstance(source, bytes) else source


def _require_ours(file: pq.ParquetFile, name: str, *, index: bool) -> None:
    marked = (file.metadata.metadata or {}).get(_MARK, b"").decode("ascii", "replace")
    if marked != VERSION or file.schema_arrow.names != [*COLUMNS, *[PLACE][:index]]:
        remedy = "a newer stepdiag reads it" if marked.isdecimal() and int(marked) > int(VERSION) else "remove it from the store"
        raise DataError(name, expected=f"rows of version {VERSION}", found=f"version {marked or 'none'}", remedy=remedy)


@contextmanager
def _damage_said(name: str) -> Iterator[None]:
    try:
        yield
    except (pa.ArrowException, OSError) as error:
        remedy = "remove it: an index is made again by the next `archive add`, a survey's numbers by archiving it again"
        raise DataError(name, expected="a Parquet file of this store", found=str(error), remedy=remedy) from error
