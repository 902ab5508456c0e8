"""The rows of one result as a Parquet file, and the points of many: long format, texts that repeat stored once, zstd.

A point is what a quantity comes to in one survey. A function stands for itself by its range, with the uncertainty of the difference of its
extremes; a number is itself.
"""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq

from stepdiag.base.errors import DataError
from stepdiag.fleet.rows import About, Row

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
"""The column behind the others of a point: the folder of the survey that it is of."""
POINTS = pa.schema(
    [SCHEMA.field(name) for name in ("machine", "quantity", "unit", "survey", "time", "event", "conditions", "software", "value", "u")]
)
INDEX_SCHEMA = POINTS.append(pa.field(PLACE, _WORD))
_WORDS_OF_POINTS = [field.name for field in INDEX_SCHEMA if field.type == _WORD]
_POINTS_QUERY = """
SELECT machine, quantity, any_value(unit) AS unit, survey, time, any_value(event) AS event, any_value(conditions) AS conditions,
       any_value(software) AS software,
       CASE WHEN count(position_mm) > 0 THEN max(value) - min(value) ELSE any_value(value) END AS value,
       CASE WHEN count(position_mm) > 0 THEN sqrt(pow(arg_max(u, value), 2) + pow(arg_min(u, value), 2)) ELSE any_value(u) END AS u,
       place
FROM rows GROUP BY machine, quantity, survey, time, place ORDER BY machine, quantity, time, survey
"""


def table_of(about: About, rows: Sequence[Row]) -> pa.Table:
    """Return the rows of one result as a table of `SCHEMA`."""
    shared = {field.name: [getattr(about, field.name)] * len(rows) for field in fields(about)}
    own = {field.name: [getattr(row, field.name) for row in rows] for field in fields(Row)}
    return pa.table({name: (shared | own)[name] for name in COLUMNS}, schema=SCHEMA)


def points_of(tables: Sequence[tuple[pa.Table, str]]) -> pa.Table:
    """Return the points of results as a table of `INDEX_SCHEMA`; each table of rows comes with the folder of its survey."""
    if not tables:
        return INDEX_SCHEMA.empty_table()
    placed = [
        table.append_column(PLACE, pa.DictionaryArray.from_arrays(pa.array([0] * table.num_rows, pa.int32()), pa.array([folder])))
        for table, folder in tables
    ]
    with duckdb.connect() as connection:
        connection.execute("SET TimeZone = 'UTC'")
        connection.register("rows", pa.concat_tables(placed).unify_dictionaries())
        found = connection.sql(_POINTS_QUERY).to_arrow_table()
    columns = [found[each.name].cast(pa.string()).dictionary_encode() if each.type == _WORD else found[each.name] for each in INDEX_SCHEMA]
    return pa.table(columns, names=INDEX_SCHEMA.names).cast(INDEX_SCHEMA)


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
        return pq.ParquetFile(_opened(source), read_dictionary=_WORDS_OF_POINTS if index else _WORDS).read()


def require_ours(source: bytes | str, name: str, *, index: bool = False) -> None:
    """Raise DataError for a file that is damaged, foreign, or of a newer version; only its end is read."""
    with _damage_said(name):
        _require_ours(pq.ParquetFile(_opened(source)), name, index=index)


def _opened(source: bytes | str) -> io.BytesIO | str:
    return io.BytesIO(source) if isinstance(source, bytes) else source


def _require_ours(file: pq.ParquetFile, name: str, *, index: bool) -> None:
    marked = (file.metadata.metadata or {}).get(_MARK, b"").decode("ascii", "replace")
    if marked != VERSION or file.schema_arrow.names != (INDEX_SCHEMA.names if index else list(COLUMNS)):
        remedy = "a newer stepdiag reads it" if marked.isdecimal() and int(marked) > int(VERSION) else "remove it from the store"
        raise DataError(name, expected=f"rows of version {VERSION}", found=f"version {marked or 'none'}", remedy=remedy)


@contextmanager
def _damage_said(name: str) -> Iterator[None]:
    try:
        yield
    except (pa.ArrowException, OSError) as error:
        remedy = "remove it: an index is made again by the next `archive add`, a survey's numbers by archiving it again"
        raise DataError(name, expected="a Parquet file of this store", found=str(error), remedy=remedy) from error
