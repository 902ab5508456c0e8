"""Tables of multi-axis lasers (position, angles, straightness and roll at once) as readings, angles
and straightness.

A column is selected by ``FUNCTION=[-]COLUMN[UNIT]~U``, for example ``EBX=-Pitch[arcsec]~0.1``; U is
the standard uncertainty (k = 1) in the unit of the column. Rows are in the order of driving. A pass
ends at a reversal of the axis, or where the axis returns to its start in one step. If the reversal
is a single stop, this stop ends the outward pass and begins the back pass. The value of a function
at a target is the mean of all passes. For straightness, it is the mean of the passes with the same
approach. u is the larger of the given uncertainty and the scatter of the passes.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.csv_table import number_in, read_table
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.base.result.result import DISPLACEMENTS, POSITIONING, ROTATIONS
from stepdiag.base.setups import setup_of
from stepdiag.base.volume import Vector
from stepdiag.solver.model.angles import Angles, KnownAngle
from stepdiag.solver.model.lateral import MeasuredStraightness

Whole: TypeAlias = NDArray[np.int64]
Flags: TypeAlias = NDArray[np.bool_]
UM, URAD = (
    {"nm": 1e-3, "um": 1.0, "mm": 1e3},
    {"urad": 1.0, "mrad": 1e3, "arcsec": 1e6 * math.pi / 648_000.0},
)
UNITS = {**UM, **URAD}
POSITION = "position"
BACK_AT_ONCE = 0.9
"""Share of the travel above which a single step counts as the return of the axis to the start of
the next run."""
_NAMED = re.compile(
    r"(?P<name>\w+)=(?P<sign>-?)(?P<column>.+)\[(?P<unit>\w+)\](?:~(?P<u>[0-9.]+))?"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column of a table: its factor to mm (position), um or urad, with the sign; and its standard
    uncertainty in the same unit, NaN if unknown."""

    name: str
    factor: float
    u: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Table:
    """A run in a table, rows in the order of driving. ``number`` (rows,) is the pass, odd in +;
    ``turned`` is true for a row that also ends the previous pass."""

    setup: str
    position_mm: Vector
    number: Whole
    turned: Flags
    values: Mapping[str, Vector]


def columns_named(options: Sequence[str]) -> dict[str, Column]:
    """Return the columns of a table by function. Raises ``UsageError`` for an invalid name, a unit
    of another kind, or a missing position."""
    columns: dict[str, Column] = {}
    for option in options:
        part = _NAMED.fullmatch(option)
        units = () if part is None else _units_of(part["name"])
        if part is None or part["unit"] not in units:
            expected = message(
                "table-column",
                names=[POSITION, *DISPLACEMENTS, *ROTATIONS],
                units=list(units or UNITS),
            )
            raise UsageError("--map", expected=expected, found=repr(option))
        factor = UNITS[part["unit"]] * (1e-3 if part["name"] == POSITION else 1.0)
        u = factor * float(part["u"]) if part["u"] else math.nan
        columns[part["name"]] = Column(
            name=part["column"].strip(), factor=-factor if part["sign"] else factor, u=u
        )
    if POSITION not in columns:
        raise UsageError(
            "--map",
            expected=message("table-position"),
            found=", ".join(columns) or message("none"),
        )
    return columns


def _units_of(name: str) -> tuple[str, ...]:
    if name == POSITION or name in DISPLACEMENTS:
        return tuple(UM)
    return tuple(URAD) if name in ROTATIONS else ()


def parse_run(text: str, setup: str, columns: Mapping[str, Column], source: str) -> Table:
    """Return the run in a table; columns of other axes are left out."""
    header = text.partition("\n")[0]
    for separator in (";", "\t"):
        if separator in header:
            text = text.replace(",", ".").replace(separator, ",")
    own = {
        name: one
        for name, one in columns.items()
        if name == POSITION or name[2] == setup[-1].upper()
    }
    table = read_table(text, source, list(dict.fromkeys(one.name for one in own.values())))
    read = {
        name: one.factor
        * np.array(
            [number_in(fields, one.name, f"{source}: line {line}") for line, fields in table]
        )
        for name, one in own.items()
    }
    position = read.pop(POSITION)
    rows, number, turned = _passes(position, source)
    values = {name: value[rows] for name, value in read.items()}
    return Table(
        setup=setup, position_mm=position[rows], number=number, turned=turned, values=values
    )


def _passes(position_mm: Vector, source: str) -> tuple[Whole, Whole, Flags]:
    step, travel = (
        np.diff(position_mm),
        float(np.ptp(position_mm)) if len(position_mm) else 0.0,
    )
    if travel == 0.0:
        raise DataError(source, expected=message("table-travel"), found=message("none"))
    first = step[np.flatnonzero(step)[0]]
    way, rows, turned = int(np.sign(first)), [0], [False]
    number = [1 if way > 0 else 2]
    for row, move in enumerate(step, start=1):
        again = move * way < 0 and abs(move) >= BACK_AT_ONCE * travel
        if again:
            number.append(number[-1] + 2)
        elif move * way <= 0:
            way, latest = -way, number[-1] + 1
            if move:
                rows, turned, number = [*rows, row - 1], [*turned, True], [*number, latest]
            number.append(latest)
        else:
            number.append(number[-1])
        rows.append(row)
        turned.append(False)
    return np.array(rows), np.array(number), np.array(turned, dtype=np.bool_)


def readings_of(
    tables: Sequence[Table], columns: Mapping[str, Column], at_mm: Sequence[Vector]
) -> Readings | None:
    """Return the linear runs of the tables with positioning, each on a line through ``at_mm``; None
    without such a table."""
    parts = [
        (table, place)
        for table, place in zip(tables, at_mm, strict=True)
        if _positioning(table) in table.values
    ]
    if not parts:
        return None
    position, reading = [], []
    for table, place in parts:
        stops = np.tile(np.asarray(place, dtype=np.float64), (len(table.position_mm), 1))
        stops[:, AXES.index(setup_of(table.setup).axis)] = table.position_mm
        position.append(stops)
        reading.append(table.position_mm + 1e-3 * table.values[_positioning(table)])
    return make_readings(
        setup=[table.setup for table, _ in parts for _ in table.number],
        pass_number=np.concatenate([table.number for table, _ in parts]),
        stop=np.concatenate([_stops(table.number) for table, _ in parts]),
        position_mm=np.vstack(position),
        reading_mm=np.concatenate([values - values[0] for values in reading]),
        u_um=np.concatenate(
            [np.full(len(table.number), columns[_positioning(table)].u) for table, _ in parts]
        ),
        zero=np.zeros(sum(len(table.number) for table, _ in parts), dtype=np.int64),
        turned=np.concatenate([table.turned for table, _ in parts]),
    )


def _positioning(table: Table) -> str:
    return POSITIONING[AXES.index(table.setup[-1])]


def _stops(number: Whole) -> Whole:
    first = np.searchsorted(number, number)
    stops: Whole = np.arange(len(number)) - first
    return stops


def angles_of(tables: Sequence[Table], columns: Mapping[str, Column]) -> Angles:
    found: dict[str, KnownAngle] = {}
    for table in tables:
        for name in (name for name in ROTATIONS if name in table.values):
            at, value, u = _means(
                table, name, np.ones(len(table.number), dtype=np.bool_), columns[name].u
            )
            found[name] = KnownAngle(position_mm=at, value_urad=value - value[0], u_urad=u)
    return found


def straightness_of(
    tables: Sequence[Table], columns: Mapping[str, Column]
) -> tuple[MeasuredStraightness, ...]:
    """Return the straightness functions in the tables by approach. Raises ``UsageError`` without a
    given uncertainty."""
    found: list[MeasuredStraightness] = []
    for table in tables:
        for name in (
            name for name in DISPLACEMENTS if name in table.values and name not in POSITIONING
        ):
            if math.isnan(columns[name].u):
                raise UsageError(
                    "--map", expected=message("table-u", name=name), found=message("none")
                )
            for approach in (1, -1):
                mine = (table.number % 2 == 1) == (approach > 0)
                if np.any(mine):
                    at, value, u = _means(table, name, mine & ~table.turned, columns[name].u)
                    found.append(
                        MeasuredStraightness(
                            name=name,
                            position_mm=at,
                            value_um=value,
                            u_um=u,
                            approach=approach,
                        )
                    )
    return tuple(found)


def _means(table: Table, name: str, rows: Flags, u: float) -> tuple[Vector, Vector, Vector]:
    number, values = table.number[rows], table.values[name][rows]
    at, place = np.unique(table.position_mm[rows], return_inverse=True)
    free = values - np.array([np.mean(values[number == one]) for one in number])
    count = np.bincount(place)
    mean = np.bincount(place, weights=values) / count
    between = np.bincount(place, weights=free) / count
    scatter = np.sqrt(
        np.bincount(place, weights=(free - between[place]) ** 2).sum()
        / max(len(values) - len(at), 1)
        / count
    )
    return at, mean, np.fmax(u, scatter)
