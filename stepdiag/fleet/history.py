"""What a store says of its machines over time: one DuckDB query over the index of points and over the surveys that are not in it yet."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any, NamedTuple

import duckdb
import numpy as np
import pyarrow as pa

from stepdiag.base.errors import DataError
from stepdiag.fleet.store import INDEX, Place, Store
from stepdiag.fleet.tables import PLACE, points_of, read_index, read_table

_QUERY = "SELECT * EXCLUDE (place) FROM ({sources}) ORDER BY machine, quantity, time, survey"


class Point(NamedTuple):
    """One quantity in one survey; ``u`` is None where none is stated, ``active`` are the hashes of the tables that were loaded."""

    time: datetime
    survey: str
    value: float
    u: float | None
    event: str
    active: tuple[str, ...]
    software: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """One quantity of one machine, oldest first."""

    machine: str
    quantity: str
    unit: str
    points: tuple[Point, ...]


def series_in(store: Store, machine: str = "", software: str = "") -> list[Series]:
    """Return every quantity over time, by machine and name: of what was archived, or of what ``software`` solved anew.

    Raises DataError where a table is damaged, and where there is nothing.
    """
    wanted = [place for place in store.tables() if place.software == software and machine in ("", place.machine)]
    if not wanted:
        what = f"surveys of {machine or 'any machine'}" + (f" solved anew by {software}" if software else "")
        known = sorted({place.machine for place in store.tables()})
        raise DataError(store.address, expected=what, found=f"none; known are {', '.join(known) or 'no machines'}")
    with duckdb.connect() as connection:
        connection.execute("SET TimeZone = 'UTC'")
        sources = _sources(connection, store, wanted)
        columns = connection.execute(_QUERY.format(sources=sources)).fetchnumpy()
    return list(_grouped(columns))


def _sources(connection: duckdb.DuckDBPyConnection, store: Store, wanted: Sequence[Place]) -> str:
    """Register what is read, and return it as SQL: the index where it holds some of what is wanted, the rest from its own tables."""
    folders = {place.folder for place in wanted}
    held: set[str] = set()
    found = []
    if store.exists(INDEX):
        index = read_index(store, len(store.tables()))
        connection.register("everything", index)
        rows = connection.execute("SELECT DISTINCT place FROM everything").fetchall()
        held = folders & {row[0] for row in rows}
        connection.register("chosen", pa.table({PLACE: sorted(held)}, schema=pa.schema([(PLACE, pa.string())])))
        found.append("SELECT * FROM everything SEMI JOIN chosen USING (place)")
    loose = [(read_table(store, place), place.folder) for place in wanted if place.folder not in held]
    if loose:
        connection.register("loose", points_of(loose))
        found.append("SELECT * FROM loose")
    return " UNION ALL ".join(found)


def _grouped(columns: dict[str, Any]) -> Iterator[Series]:
    """Yield the series of columns that are in their order; column by column, since there are hundreds of thousands of points."""
    machine, quantity = columns["machine"], columns["quantity"]
    times = columns["time"].astype("datetime64[us]").astype("int64").tolist()
    moments = {time: datetime.fromtimestamp(time / 1e6, UTC) for time in set(times)}
    cells = {name: _filled(columns[name]).tolist() for name in ("survey", "value", "u", "event", "conditions", "software", "unit")}
    known = {words: _active(words) for words in set(cells["conditions"])}
    points = list(
        map(
            Point, map(moments.__getitem__, times), cells["survey"], cells["value"], cells["u"], cells["event"],
            map(known.__getitem__, cells["conditions"]), cells["software"],
        )
    )  # fmt: skip
    begins = np.flatnonzero((machine[1:] != machine[:-1]) | (quantity[1:] != quantity[:-1])) + 1
    for begin, end in pairwise([0, *begins.tolist(), len(points)]):
        yield Series(machine=machine[begin], quantity=quantity[begin], unit=cells["unit"][begin], points=tuple(points[begin:end]))


def _filled(column: Any) -> Any:
    """Return a column with None where DuckDB masked a missing value."""
    return column.astype(object).filled(None) if hasattr(column, "filled") else column


def _active(conditions: str) -> tuple[str, ...]:
    try:
        found = json.loads(conditions).get("active", [])
    except (ValueError, AttributeError, RecursionError):
        return ()
    return tuple(map(str, found)) if isinstance(found, list) else ()
