"""The rows of a result as a Parquet file, and the index of many results.

A row of the index is a quantity in a survey: its nodes in three lists, and its value. The value
of a function is its range, with the uncertainty of the difference of its extremes.
"""

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from datetime import UTC, datetime

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from stepdiag.base.errors import DataError
from stepdiag.base.files import LARGEST_BYTES, as_text
from stepdiag.base.messages import message
from stepdiag.base.result.result import parse_result
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.fleet.rows import About, Row, about, rows_of
from stepdiag.fleet.store import INDEX, Place, Store, sha256, unsealed

VERSION, OLDEST = "2", "1"
"""Version of written tables, and oldest readable version. Tables of version 1 lack the columns from
`u_common` on."""
_MARK, _RESULT, _WRITER = b"stepdiag-rows", b"stepdiag-result-sha256", b"stepdiag-arrow"
_WORD = pa.dictionary(pa.int32(), pa.string())
SCHEMA = pa.schema(
    [
        ("machine", _WORD),
        ("survey", _WORD),
        ("time", pa.timestamp("us", tz="UTC")),
        ("event", _WORD),
        ("quantity", _WORD),
        ("axis", _WORD),
        ("position_mm", pa.float64()),
        ("value", pa.float64()),
        ("u", pa.float64()),
        ("k", pa.int8()),
        ("unit", _WORD),
        ("method", _WORD),
        ("software", _WORD),
        ("conditions", _WORD),
        ("u_common", pa.float64()),
        ("low", pa.float64()),
        ("high", pa.float64()),
    ]
)
COLUMNS = tuple(SCHEMA.names)
_BY = "parquet-cpp-arrow version "
PLACE = "place"
"""Name of the last column of the index: the folder of the survey."""
_LIST = pa.list_(pa.float32())
_OF_SURVEY = ("survey", "time", "event", "conditions", "software")
INDEX_SCHEMA = pa.schema(
    [
        *(
            SCHEMA.field(name)
            for name in (
                "machine",
                "quantity",
                "unit",
                *_OF_SURVEY,
                "value",
                "u",
                "low",
                "high",
            )
        ),
        ("common", pa.float32()),
        ("positions", _LIST),
        ("values", _LIST),
        ("us", _LIST),
        (PLACE, _WORD),
    ]
)
"""Columns of the index. ``value``, ``u``, ``low``, ``high``: the values for people. ``common``:
the share of u common to surveys with the same instruments."""
MOST_ROWS = 300_000
"""Largest number of rows of a survey's table. A survey with every kind of setup has a few thousand
rows, a single axis at most as many as its readings."""
MOST_POINTS_A_SURVEY = 100
"""Largest number of rows of a survey in the index. A result has 18 functions, 3 squarenesses, 3
scales and 2 values of the volume: 26 quantities."""
LARGEST_POINT_BYTES = 4000
"""Largest size in bytes of a row of the index: the conditions of the survey, and for a function
three numbers per node."""
_REQUIRED = [field.name for field in SCHEMA if field.type == _WORD] + [PLACE, "time", "value"]
_EARLIEST, _LATEST = (
    pa.scalar(datetime(year, 1, 1, tzinfo=UTC), pa.timestamp("us", tz="UTC"))
    for year in (1, 9999)
)
_REMEDY = message("remove-table")


def table_of(about: About, rows: Sequence[Row]) -> pa.Table:
    """Return the rows of one result as a table of `SCHEMA`."""
    shared = {field.name: [getattr(about, field.name)] * len(rows) for field in fields(about)}
    own = {field.name: [getattr(row, field.name) for row in rows] for field in fields(Row)}
    return pa.table({name: (shared | own)[name] for name in COLUMNS}, schema=SCHEMA)


def index_of(tables: Sequence[tuple[pa.Table, str]]) -> pa.Table:
    """Return the quantities of results as a table of `INDEX_SCHEMA`; each table of rows is paired
    with the folder of its survey."""
    found = [row for table, folder in tables for row in _quantities(table, folder)]
    return pa.table(
        {name: [row[name] for row in found] for name in INDEX_SCHEMA.names},
        schema=INDEX_SCHEMA,
    )


def _quantities(table: pa.Table, folder: str) -> Iterator[dict[str, object]]:
    columns = table.to_pydict()
    places: dict[str, list[int]] = {}
    for at, quantity in enumerate(columns["quantity"]):
        places.setdefault(quantity, []).append(at)
    for quantity, rows in places.items():
        first = rows[0]
        values, us = ([columns[name][at] for at in rows] for name in ("value", "u"))
        shared = {name: columns[name][first] for name in ("machine", "unit", *_OF_SURVEY)}
        known = [
            (columns["u_common"][at] or 0.0) / u for at, u in zip(rows, us, strict=True) if u
        ]
        function = columns["position_mm"][first] is not None
        value, u = _shown(values, us) if function else (values[0], us[0])
        yield shared | {
            "quantity": quantity,
            "value": value,
            "u": u,
            "low": columns["low"][first],
            "high": columns["high"][first],
            "common": max(known, default=0.0),
            "positions": [columns["position_mm"][at] for at in rows] if function else [],
            "values": values,
            "us": [math.nan if each is None else each for each in us],
            PLACE: folder,
        }


def _shown(values: Sequence[float], us: Sequence[float | None]) -> tuple[float, float | None]:
    low, high = int(np.argmin(values)), int(np.argmax(values))
    one, other = us[low], us[high]
    return values[high] - values[low], None if one is None or other is None else math.hypot(
        one, other
    )


def to_parquet(table: pa.Table, result: str = "") -> bytes:
    """Return the bytes of a Parquet file: the same for the same rows. ``result`` is the SHA-256 of
    the result from which the rows come."""
    out = io.BytesIO()
    with pq.ParquetWriter(
        out,
        table.schema,
        compression="zstd",
        compression_level=9,
        write_statistics=["time"],
        store_schema=False,
    ) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata(
            {_MARK: VERSION, _WRITER: pa.cpp_version} | ({_RESULT: result} if result else {})
        )
    return out.getvalue()


def result_named(data: bytes) -> str:
    """Return the SHA-256 of the result from which a table was made; empty if the table does not
    contain it. Raises DataError for a damaged table."""
    with _damage_named("parquet"):
        return (
            _known(pq.read_metadata(pa.BufferReader(data))).get(_RESULT, b"").decode("ascii")
        )


def written_by_another(data: bytes) -> bool:
    """Return whether another version of the library wrote a Parquet file, so that its bytes differ
    for equal rows; the file contains the version twice."""
    with _damage_named("parquet"):
        metadata = pq.read_metadata(pa.BufferReader(data))
        version = _known(metadata).get(_WRITER, b"").decode("ascii")
        by = str(metadata.created_by)
        return by != _BY + pa.cpp_version and (
            not version or (version != pa.cpp_version and by == _BY + version)
        )


def _known(metadata: pq.FileMetaData) -> dict[bytes, bytes]:
    return metadata.metadata or {}


def read_table(store: Store, place: Place) -> pa.Table:
    """Return the rows of a survey as a table of `SCHEMA`; the hash of its bytes is compared with
    the list of the survey's files.

    Without a hash (older versions), the rows are compared with the rows of its result. Raises the
    DataError of `from_parquet` and `Store.listed`, and DataError if the hash or the rows differ.
    """
    return _rows_in(store, place, store.listed(place).table)


def _rows_in(store: Store, place: Place, stated: str) -> pa.Table:
    data = store.read(place.table)
    if stated and sha256(data) != stated:
        raise DataError(
            place.table, expected=f"SHA-256 {stated}", found=sha256(data), remedy=_REMEDY
        )
    rows = from_parquet(data, place.table, SCHEMA, MOST_ROWS, LARGEST_BYTES)
    if not stated:
        result = store.read(f"{place.folder}/{RESULT}")
        if rows.to_pylist() != rows_from(result, place).to_pylist() or result_named(
            data
        ) not in (
            sha256(result),
            "",
        ):
            raise DataError(
                place.table,
                expected=message("numbers-of", name=f"{place.folder}/{RESULT}"),
                found=message("another-one"),
                remedy=_REMEDY,
            )
    return rows


def rows_from(result: bytes, place: Place) -> pa.Table:
    """Return the rows made from the result of a survey in the store. Raises DataError for an
    unreadable result."""
    read = parse_result(as_text(result, f"{place.folder}/{RESULT}"), RESULT)
    return table_of(about(read, place.survey), list(rows_of(read)))


def read_index(store: Store, surveys: int) -> pa.Table:
    """Return the index of a store with this number of surveys, a table of `INDEX_SCHEMA`. Raises
    the DataError of `from_parquet`."""
    most = MOST_POINTS_A_SURVEY * surveys
    largest = max(LARGEST_BYTES, LARGEST_POINT_BYTES * most)
    data = unsealed(store.read(INDEX, largest=largest), INDEX)
    return from_parquet(data, INDEX, INDEX_SCHEMA, max(MOST_ROWS, most), largest)


def from_parquet(
    data: bytes, name: str, schema: pa.Schema, most_rows: int, largest: int
) -> pa.Table:
    """Return the table of ``schema`` in a file.

    Raises DataError for a file that is damaged, foreign, of a newer version, too large, or with an
    impossible value. The end of the file is checked before unpacking, because a few hundred
    kilobytes can contain millions of rows.
    """
    with _damage_named(name):
        metadata = pq.read_metadata(pa.BufferReader(data))
        _require_ours(metadata, name, schema)
        _require_small(metadata, name, most_rows, largest)
        # The library's threads can still run when the interpreter ends: the process then aborts
        # (apache/arrow issue 34314), and a finished command exits with -6.
        table = pq.ParquetFile(
            pa.BufferReader(data),
            read_dictionary=[field.name for field in schema if field.type == _WORD],
        ).read(use_threads=False)
        table.validate(
            full=True
        )  # texts that are not UTF-8 are read unchanged, and fail where they are used
        for lacking in schema.names[len(table.schema.names) :]:
            table = table.append_column(
                schema.field(lacking), pa.nulls(table.num_rows, schema.field(lacking).type)
            )
        if table.schema.types != schema.types:
            raise DataError(
                name,
                expected=f"columns {_described(schema)}",
                found=_described(table.schema),
                remedy=_REMEDY,
            )
    _require_values(table, name)
    return table


def _require_ours(metadata: pq.FileMetaData, name: str, schema: pa.Schema) -> None:
    marked = (metadata.metadata or {}).get(_MARK, b"").decode("ascii", "replace")
    names = (
        schema.names[: schema.names.index("u_common")]
        if marked == OLDEST and "u_common" in schema.names
        else schema.names
    )
    if marked not in (VERSION, OLDEST) or metadata.schema.to_arrow_schema().names != names:
        remedy = (
            message("newer-reads")
            if marked.isdecimal() and int(marked) > int(VERSION)
            else _REMEDY
        )
        raise DataError(
            name,
            expected=message("rows-of-version", version=VERSION),
            found=marked or message("none"),
            remedy=remedy,
        )


def _require_small(
    metadata: pq.FileMetaData, name: str, most_rows: int, largest: int
) -> None:
    unpacked = sum(
        metadata.row_group(number).total_byte_size
        for number in range(metadata.num_row_groups)
    )
    if metadata.num_rows > most_rows or unpacked > largest:
        raise DataError(
            name,
            expected=message("rows-and-bytes-at-most", rows=most_rows, size=largest),
            found=message("rows-and-bytes", rows=metadata.num_rows, size=unpacked),
            remedy=_REMEDY,
        )


def _require_values(table: pa.Table, name: str) -> None:
    """Raise DataError for an empty row, or for a number or time that is impossible in a result."""
    wrong = [
        column
        for column in _REQUIRED
        if column in table.column_names and table[column].null_count
    ]
    numbers = {
        name: table[name]
        for name in ("value", "u", "u_common", "low", "high", "common")
        if name in table.column_names
    }
    lists = {
        name: table[name]
        for name in ("positions", "values", "us")
        if name in table.column_names
    }
    numbers |= {name: pc.list_flatten(each) for name, each in lists.items() if name != "us"}
    wrong += [name for name, each in numbers.items() if not _all(pc.is_finite(each))]
    wrong += [
        name
        for name in ("u", "u_common", "common")
        if name in numbers and not _all(pc.greater_equal(numbers[name], 0.0))
    ]
    if lists and (any(each.null_count for each in lists.values()) or not _as_long(lists)):
        wrong += list(lists)
    if not _all(
        pc.and_(pc.greater_equal(table["time"], _EARLIEST), pc.less(table["time"], _LATEST))
    ):
        wrong.append("time")
    if wrong:
        raise DataError(
            name,
            expected=message("values-of-result"),
            found=message("several-others", names=list(dict.fromkeys(wrong))),
            remedy=_REMEDY,
        )


def _as_long(lists: Mapping[str, pa.ChunkedArray]) -> bool:
    """Return whether the lists of uncertainties and values in every row of the index have the same
    length, and the list of positions has this length or is empty."""
    positions, values, us = (
        pc.list_value_length(lists[name]) for name in ("positions", "values", "us")
    )
    nodes = pc.or_(
        pc.equal(positions, values), pc.and_(pc.equal(positions, 0), pc.equal(values, 1))
    )
    return _all(pc.and_(pc.and_(pc.equal(values, us), pc.greater(values, 0)), nodes))


def _all(holds: pa.ChunkedArray) -> bool:
    return pc.all(holds, min_count=0).as_py() is not False


def _described(schema: pa.Schema) -> str:
    return ", ".join(f"{field.name} {field.type}" for field in schema)


@contextmanager
def _damage_named(name: str) -> Iterator[None]:
    try:
        yield
    except (pa.ArrowException, OSError, ValueError) as error:
        raise DataError(
            name, expected=message("parquet-of-store"), found=str(error), remedy=_REMEDY
        ) from error
