"""The quantities of the machines in a store over time, from the index and the tables outside it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.messages import Message, message
from stepdiag.fleet.series import (
    OF_VOLUME,
    Array,
    Groups,
    LeftOut,
    Series,
    Survey,
    by_volume,
    middle_of,
    parted,
    stated,
)
from stepdiag.fleet.store import INDEX, Place, Store
from stepdiag.fleet.tables import PLACE, index_of, read_index, read_table


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """Every series of a store by machine and quantity, and the surveys or tables outside all
    series."""

    series: tuple[Series, ...]
    left_out: tuple[LeftOut, ...]


def history_in(store: Store, now: datetime, machine: str = "", software: str = "") -> History:
    """Return every quantity over time by machine and name, from the archived results or from the
    results that ``software`` solved again.

    A damaged table is left out and reported. Raises DataError for a store without series.
    """
    places = store.tables()
    wanted = [
        place
        for place in places
        if place.software == software and machine in ("", place.machine)
    ]
    if not wanted:
        what = message("surveys-of", machine=machine or "*", software=software or "*")
        known = sorted({place.machine for place in places})
        raise DataError(
            store.address,
            expected=what,
            found=message("none-known", names=known or [message("no-machines")]),
        )
    table, damaged = _wanted_rows(store, wanted, len(places))
    found = history_of(table, now)
    return replace(found, left_out=(*damaged, *found.left_out))


def _wanted_rows(
    store: Store, wanted: Sequence[Place], surveys: int
) -> tuple[pa.Table, list[LeftOut]]:
    left_out: list[LeftOut] = []
    folders = {place.folder for place in wanted}
    parts, held = [], set()
    if store.exists(INDEX):
        try:
            index = read_index(store, surveys)
        except DataError as error:
            left_out.append(LeftOut(machine="", name=INDEX, why=error.message, damaged=True))
        else:
            codes = index[PLACE].combine_chunks()
            names = codes.dictionary.to_pylist()
            chosen = np.array([name in folders for name in names], dtype=bool)
            held = folders & set(names)
            parts.append(
                index
                if chosen.all()
                else index.filter(pa.array(chosen[codes.indices.to_numpy()]))
            )
    loose = []
    for place in wanted:
        if place.folder not in held:
            try:
                loose.append((read_table(store, place), place.folder))
            except DataError as error:
                left_out.append(
                    LeftOut(
                        machine=place.machine,
                        name=place.table,
                        why=error.message,
                        damaged=True,
                    )
                )
    parts += [index_of(loose)] if loose or not parts else []
    return pa.concat_tables(parts).unify_dictionaries().combine_chunks(), left_out


class _Columns:
    def __init__(self, table: pa.Table) -> None:
        self.words: dict[str, list[str]] = {}
        self.codes: dict[str, NDArray[np.int64]] = {}
        for name in (
            "machine",
            "quantity",
            "unit",
            "survey",
            "event",
            "conditions",
            "software",
            PLACE,
        ):
            column = table[name].combine_chunks()
            self.words[name] = column.dictionary.to_pylist()
            self.codes[name] = column.indices.to_numpy().astype(np.int64)
        self.times = table["time"].cast(pa.int64()).to_numpy()
        self.shown = np.column_stack(
            [table[name].to_numpy() for name in ("value", "u", "low", "high")]
        ).astype(float)
        self.common = table["common"].to_numpy().astype(float)
        self.lists = {
            name: _flat(table[name].combine_chunks())
            for name in ("positions", "values", "us")
        }
        self.stated = cache(lambda code: stated(self.words["conditions"][code]))

    def nodes(self, rows: NDArray[np.int64]) -> tuple[Array, Array, Array] | None:
        """Return positions, values and uncertainties, shapes (nodes,) and (rows, nodes), if all
        rows have the same nodes, otherwise None."""
        _, begins = self.lists["values"]
        counts = begins[rows + 1] - begins[rows]
        if np.any(counts != counts[0]):
            return None
        along = np.arange(counts[0])
        values, us = (
            each[ends[rows][:, None] + along].astype(float)
            for each, ends in (self.lists["values"], self.lists["us"])
        )
        places, ends = self.lists["positions"]
        if ends[rows[0] + 1] == ends[rows[0]]:
            return np.zeros(1), values, us
        positions = places[ends[rows][:, None] + along].astype(float)
        return (positions[0], values, us) if np.all(positions == positions[0]) else None

    def lists_of(self, name: str, rows: NDArray[np.int64]) -> list[Array]:
        flat, begins = self.lists[name]
        return [flat[begins[row] : begins[row + 1]].astype(float) for row in rows]

    def of(self, name: str, row: int) -> str:
        return self.words[name][int(self.codes[name][row])]


def _flat(column: pa.ListArray) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    return column.values.to_numpy(), column.offsets.to_numpy().astype(np.int64)


def history_of(table: pa.Table, now: datetime) -> History:
    """Return the series in a table of `INDEX_SCHEMA`, and the surveys outside all series."""
    columns = _Columns(table)
    rank = {
        name: np.argsort(np.argsort(columns.words[name])) for name in ("machine", "quantity")
    }
    machine, quantity = (rank[name][columns.codes[name]] for name in ("machine", "quantity"))
    order = np.lexsort((columns.codes[PLACE], columns.times, quantity, machine))
    series: list[Series] = []
    left_out: list[LeftOut] = []
    for rows in np.split(order, np.flatnonzero(np.diff(machine[order])) + 1):
        if len(rows):
            name = columns.of("machine", rows[0])
            groups, without = parted(name, _surveys(columns, rows), now)
            left_out += without
            series += _of_machine(name, columns, rows, quantity, groups)
    return History(series=tuple(series), left_out=tuple(left_out))


def _surveys(columns: _Columns, rows: NDArray[np.int64]) -> dict[int, Survey]:
    places, firsts = np.unique(columns.codes[PLACE][rows], return_index=True)
    found: dict[int, Survey] = {}
    for place, row in sorted(
        zip(places.tolist(), rows[firsts].tolist(), strict=True),
        key=lambda each: (columns.times[each[1]], each[0]),
    ):
        active, standing = columns.stated(int(columns.codes["conditions"][row]))
        found[place] = Survey(
            time=datetime.fromtimestamp(int(columns.times[row]) / 1e6, UTC),
            name=columns.of("survey", row),
            event=columns.of("event", row),
            active=active,
            software=columns.of("software", row),
            standing=standing,
        )
    return found


def _of_machine(
    machine: str,
    columns: _Columns,
    rows: NDArray[np.int64],
    quantity: NDArray[np.int64],
    groups: Groups,
) -> Iterator[Series]:
    place = columns.codes[PLACE]
    inside = [np.isin(place[rows], list(surveys)) for surveys, _ in groups]
    for mine in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(quantity[rows])) + 1):
        for (surveys, why), held in zip(groups, inside, strict=True):
            chosen = rows[mine[held[mine]]]
            if len(chosen):
                whole = _series(
                    machine,
                    columns,
                    chosen,
                    tuple(map(surveys.__getitem__, place[chosen].tolist())),
                    why,
                )
                yield from by_volume(whole) if whole.quantity in OF_VOLUME else (whole,)


def _series(
    machine: str,
    columns: _Columns,
    rows: NDArray[np.int64],
    surveys: tuple[Survey, ...],
    why: Message | None,
) -> Series:
    shown = columns.shown[rows]
    alike = columns.nodes(rows)
    nodes, at, u = alike or _at_common_nodes(
        *(columns.lists_of(name, rows) for name in ("positions", "values", "us"))
    )
    if len(nodes) == 1:
        at = middle_of(shown)
    return Series(
        machine=machine,
        quantity=columns.of("quantity", rows[0]),
        unit=columns.of("unit", rows[0]),
        surveys=surveys,
        nodes_mm=nodes,
        values=at,
        u=u,
        common=columns.common[rows],
        shown=shown,
        other=why,
    )


def _at_common_nodes(
    positions: list[Array], values: list[Array], us: list[Array]
) -> tuple[Array, Array, Array]:
    """Return a function over its surveys at the nodes of the coarsest survey that all other surveys
    cover.

    The values are relative to the line through the end points of this range, because surveys over
    other parts of the travel have another zero and another line.
    """
    coarsest = min(positions, key=len)
    low, high = (
        pick(each[end] for each in positions if len(each))
        for pick, end in ((max, 0), (min, -1))
    )
    nodes = coarsest[(coarsest >= low - ALMOST_MM) & (coarsest <= high + ALMOST_MM)]
    if len(nodes) < 2:
        nothing = np.full((len(positions), 1), np.nan)
        return np.zeros(1), nothing, nothing
    at = np.stack(
        [np.interp(nodes, each, value) for each, value in zip(positions, values, strict=True)]
    )
    u = np.stack(
        [np.interp(nodes, each, value) for each, value in zip(positions, us, strict=True)]
    )
    same_ends = all(
        np.allclose(each[[0, -1]], positions[0][[0, -1]], atol=ALMOST_MM)
        for each in positions
    )
    if not same_ends:
        along = (nodes - nodes[0]) / (nodes[-1] - nodes[0])
        at = at - at[:, :1] - (at[:, -1:] - at[:, :1]) * along
        u = np.sqrt(u**2 + (u[:, :1] * (1 - along)) ** 2 + (u[:, -1:] * along) ** 2)
    return nodes, at, u


ALMOST_MM = 0.01
"""Distance in mm below which two nodes count as one."""
