"""The rows of one result as a Parquet file, and the points of many: long format, texts that repeat stored once, zstd.

A point is what a quantity comes to in one survey. A function stands for itself by its range, with the uncertainty of the difference of its
extremes; a number is itself.
"""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from datetime import UTC, datetime

import duckdb
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from stepdiag.base.errors import DataError
from stepdiag.base.files import LARGEST_BYTES
from stepdiag.fleet.rows import About, Row
from stepdiag.fleet.store import INDEX, Place, Store

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
PLACE = "place"
"""The column behind the others of a point: the folder of the survey that it is of."""
POINTS = pa.schema(
    [SCHEMA.field(name) for name in ("machine", "quantity", "unit", "survey", "time", "event", "conditions", "software", "value", "u")]
)
INDEX_SCHEMA = POINTS.append(pa.field(PLACE, _WORD))
MOST_ROWS = 300_000
"""A survey of every kind of setup has a few thousand, one axis alone at most as many as it may have readings."""
MOST_POINTS_A_SURVEY = 100
"""A result has 18 functions, 3 squarenesses, 3 scales and 2 figures of the volume: 26 quantities."""
LARGEST_POINT_BYTES = 1000
"""The conditions of a survey stand beside each of its points."""
_REQUIRED = [field.name for field in SCHEMA if field.type == _WORD] + [PLACE, "time", "value"]
_EARLIEST, _LATEST = (pa.scalar(datetime(year, 1, 1, tzinfo=UTC), pa.timestamp("us", tz="UTC")) for year in (1, 9999))
_REMEDY = "remove it: an index is made again by the next `archive add`, a survey's numbers by archiving it again"
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


def read_table(store: Store, place: Place) -> pa.Table:
    """Return the rows of one survey, a table of `SCHEMA`. Raises DataError as `from_parquet` does."""
    return from_parquet(store.read(place.table), place.table, SCHEMA, MOST_ROWS, LARGEST_BYTES)


def read_index(store: Store, surveys: int) -> pa.Table:
    """Return the points of a store that has so many surveys, a table of `INDEX_SCHEMA`. Raises DataError as `from_parquet` does."""
    most = MOST_POINTS_A_SURVEY * surveys
    largest = max(LARGEST_BYTES, LARGEST_POINT_BYTES * most)
    return from_parquet(store.read(INDEX, largest=largest), INDEX, INDEX_SCHEMA, max(MOST_ROWS, most), largest)


def from_parquet(data: bytes, name: str, schema: pa.Schema, most_rows: int, largest: int) -> pa.Table:
    """Return the table in a file, of ``schema``.

    Raises DataError for a file that is damaged, foreign, of a newer version, too large, or with a value that no survey has. A few
    hundred kilobytes can hold millions of rows, so the end of the file is judged before anything is unpacked.
    """
    with _damage_named(name):
        metadata = pq.read_metadata(io.BytesIO(data))
        _require_ours(metadata, name, schema)
        _require_small(metadata, name, most_rows, largest)
        table = pq.ParquetFile(io.BytesIO(data), read_dictionary=[field.name for field in schema if field.type == _WORD]).read()
        if table.schema.types != schema.types:
            raise DataError(name, expected=f"columns {_described(schema)}", found=_described(table.schema), remedy=_REMEDY)
    _require_values(table, name)
    return table


def _require_ours(metadata: pq.FileMetaData, name: str, schema: pa.Schema) -> None:
    marked = (metadata.metadata or {}).get(_MARK, b"").decode("ascii", "replace")
    if marked != VERSION or metadata.schema.names != schema.names:
        remedy = "a newer stepdiag reads it" if marked.isdecimal() and int(marked) > int(VERSION) else "remove it from the store"
        raise DataError(name, expected=f"rows of version {VERSION}", found=f"version {marked or 'none'}", remedy=remedy)


def _require_small(metadata: pq.FileMetaData, name: str, most_rows: int, largest: int) -> None:
    unpacked = sum(metadata.row_group(number).total_byte_size for number in range(metadata.num_row_groups))
    if metadata.num_rows > most_rows or unpacked > largest:
        raise DataError(
            name, expected=f"at most {most_rows} rows and {largest} bytes unpacked", found=f"{metadata.num_rows} rows, {unpacked} bytes",
            remedy=_REMEDY,
        )  # fmt: skip


def _require_values(table: pa.Table, name: str) -> None:
    """Raise DataError for a row with nothing, or with a number or a time, that no result has."""
    wrong = [column for column in _REQUIRED if column in table.column_names and table[column].null_count]
    wrong += [column for column in ("value", "u") if not _all(pc.is_finite(table[column]))]
    if not _all(pc.greater_equal(table["u"], 0.0)):
        wrong.append("u")
    if not _all(pc.and_(pc.greater_equal(table["time"], _EARLIEST), pc.less(table["time"], _LATEST))):
        wrong.append("time")
    if wrong:
        raise DataError(name, expected="values that a result has", found=f"others in {', '.join(dict.fromkeys(wrong))}", remedy=_REMEDY)


def _all(holds: pa.ChunkedArray) -> bool:
    """Return whether a condition holds wherever there is a value."""
    return pc.all(holds, min_count=0).as_py() is not False


def _described(schema: pa.Schema) -> str:
    return ", ".join(f"{field.name} {field.type}" for field in schema)


@contextmanager
def _damage_named(name: str) -> Iterator[None]:
    try:
        yield
    except (pa.ArrowException, OSError) as error:
        raise DataError(name, expected="a Parquet file of this store", found=str(error), remedy=_REMEDY) from error
