"""The text of Heidenhain .COM and .CMA tables: first line, heading, numbered rows, ``[END]``.

KinematicsComp (iTNC 530 HSCI technical manual pp. 666-686) adds columns C1 to C6 for the six errors
of the axis: displacements in X, Y, Z in mm, and rotations about X, Y, Z. stepdiag writes rotations
in degrees, the unit of ``Trans`` in the kinematics table. No consulted page states the unit of C4
to C6, so this unit was not checked against a document.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.errors import DataError, SafetyError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines, finite, read_lines
from stepdiag.exporters.files.naming import plain_name
from stepdiag.exporters.files.numbers import fixed
from stepdiag.exporters.tables.angular import COLUMN, Angle, angle_tables, column_urad
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Law, Table

_NEWLINE = "\r\n"
_END = "[END]"
_BEGIN = re.compile(
    r"^BEGIN\s+(?P<name>\S+)(?:\s+DATUM:(?P<datum>\S+)\s+DISTANCE:(?P<distance>\S+))"
    r"?(?:\s+(?P<unit>MM|INCH))?\s*\Z"
)
_WIDTHS = {"NR": 8, "ACTIVE": 8}
_WIDTH = 16
COMPONENTS = ("C1", "C2", "C3")
TURNS = ("C4", "C5", "C6")
DEGREE_DECIMALS = 8
"""Decimal places of an angle in degrees: the last place is 0.0002 urad."""
_URAD_PER_DEGREE = np.pi / 180.0 * 1e6


def file_name(axis: str, positions: bool) -> str:
    """Return the file name of the table of an input axis. ``positions`` is true for a control with
    a column of positions.
    """
    return f"AXIS_{axis}.COM" if positions else f"AXIS-{axis}.COM"


def axis_in(name: str, axes: Sequence[str]) -> str:
    """Return the axis at the end of a table's name. Raises ``DataError`` for a name without an
    axis.
    """
    stem = name.upper().removesuffix(".COM")
    for axis in axes:
        if stem.endswith((f"_{axis.upper()}", f"-{axis.upper()}")):
            return axis
    raise DataError(name, expected=message("com-name"), found=name)


def render(
    tables: Sequence[Table], profile: Profile, *, positions: bool, decimals: int
) -> ControlFile:
    """Return the .COM file of one input axis, whose tables share a grid.

    With ``positions`` the file has the newer form with a column AXISPOS. Otherwise the first line
    contains DATUM and DISTANCE.
    """
    name, grid = str(tables[0].place["file"]), tables[0].position_mm
    values = {
        profile.axis(table.output_axis).name: table.value_um / 1000.0
        for table in tables
        if COLUMN not in table.place
    }
    more = _kinematics_cells(tables, decimals)
    columns = [
        "NR",
        *(["AXISPOS", "BACKLASH"] if positions else []),
        *(axis.name for axis in profile.axes.values()),
    ]
    columns += [*COMPONENTS, *TURNS] if more else []
    heading = _heading(columns, ".COM", profile)
    rows = []
    for index, at in enumerate(grid):
        cells = {
            "NR": str(index),
            "AXISPOS": _signed(at, decimals),
            "BACKLASH": _signed(0.0, decimals),
        }
        cells |= {
            axis: _signed(float(column[index]), decimals) for axis, column in values.items()
        }
        cells |= {column: each[index] for column, each in more.items()}
        rows.append(_com_row(heading, cells, _signed(0.0, decimals), name))
    datum = (
        f"  DATUM:{_signed(float(grid[0]), decimals)} "
        f"DISTANCE:{_signed(float(grid[1] - grid[0]), decimals)}"
    )
    first = f"BEGIN {name}{'' if positions else datum} MM"
    return ControlFile(
        name=name, data=ascii_lines([first, heading.rstrip(), *rows, _END], _NEWLINE)
    )


def _kinematics_cells(tables: Sequence[Table], decimals: int) -> dict[str, list[str]]:
    cells: dict[str, list[str]] = {}
    for table in tables:
        if COLUMN not in table.place:
            continue
        if table.multiplier is None:
            cells[COMPONENTS["XYZ".index(table.output_axis)]] = [
                _signed(float(value), decimals) for value in table.value_um / 1000.0
            ]
        else:
            column = TURNS["ABC".index(str(table.place[COLUMN])[1])]
            cells[column] = [
                _signed(float(value), DEGREE_DECIMALS)
                for value in column_urad(table) / _URAD_PER_DEGREE
            ]
    return cells


def render_assignment(
    name: str, named: Mapping[str, str], axes: Sequence[str], profile: Profile
) -> ControlFile:
    """Return the .CMA file with an active line that calls the table of each axis in ``named``."""
    heading = _heading(["NR", "ACTIVE", *axes], ".CMA", profile)
    row = _com_row(heading, {"NR": "0", "ACTIVE": "*", **named}, "", name)
    return ControlFile(
        name=name,
        data=ascii_lines([f"BEGIN {name} MM", heading.rstrip(), row, _END], _NEWLINE),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Instructions for reading a table: kinds of the columns, law of the values, and ``levers`` of
    the angles (None if the profile states no chain).
    """

    kind: str
    kinematics_kind: str
    law: Law
    levers: Vector | None


def read(file: ControlFile, input_axis: str, profile: Profile, how: Reading) -> list[Table]:
    """Return the tables of a .COM file: one for each axis with a column, and the tables of C1 to
    C6. Raises ``DataError`` for a wrong file.
    """
    begin, columns, rows = _com_cells(file)
    index = {column: place for place, column in enumerate(columns)}
    where = f"{file.name}: heading"
    axes = [
        column
        for column in columns
        if column not in ("NR", "AXISPOS", "BACKLASH", *COMPONENTS, *TURNS)
    ]
    letters = {column: profile.letter_of(column, where) for column in axes}
    position = _positions(file.name, begin, index, rows)
    if "BACKLASH" in index and any(
        finite(cells[index["BACKLASH"]], at) for at, cells in rows
    ):
        raise DataError(
            where,
            expected=message("com-backlash"),
            found=message("a-backlash"),
            remedy=message("sense-private"),
        )
    values = {
        axis: np.array([finite(cells[index[axis]], at) for at, cells in rows])
        for axis in axes
    }
    places = max(
        (len(cells[index[axis]].partition(".")[2]) for _, cells in rows for axis in axes),
        default=4,
    )
    place = {"file": plain_name(file.name)}
    plain = [
        Table(
            kind=how.kind,
            input_axis=input_axis,
            output_axis=letters[axis],
            position_mm=position,
            value_um=value * 1000.0,
            quantum_um=1000.0 * 10.0**-places,
            law=how.law,
            reference_mm=profile.axis(input_axis).reference_mm,
            place=place,
        )
        for axis, value in values.items()
    ]
    turned = {
        column: np.array([finite(cells[index[column]], at) for at, cells in rows])
        for column in columns
        if column in (*COMPONENTS, *TURNS)
    }
    known = [column for column, value in turned.items() if value.any()]
    if known and how.levers is None:
        raise DataError(
            where,
            expected=message("c-zero"),
            found=", ".join(known),
            remedy=message("chain-heidenhain"),
        )
    if how.levers is None:
        return plain
    kinematics = [
        table
        for column in turned
        for table in _kinematics(column, turned[column], plain[0], profile, how, how.levers)
    ]
    own = {table.output_axis for table in kinematics if table.multiplier is None}
    return [
        *(table for table in plain if table.output_axis not in own or table.value_um.any()),
        *kinematics,
    ]


def _kinematics(
    column: str, value: Vector, like: Table, profile: Profile, how: Reading, levers: Vector
) -> Iterator[Table]:
    letter = like.input_axis
    if column in TURNS:
        angle = Angle(
            name=f"E{'ABC'[TURNS.index(column)]}{letter}",
            position_mm=like.position_mm,
            value_urad=value * _URAD_PER_DEGREE,
        )
        quantum_urad = _URAD_PER_DEGREE * 10.0**-DEGREE_DECIMALS
        laws = dict.fromkeys("XYZ", how.law)
        yield from angle_tables(
            angle,
            levers,
            profile,
            kind=how.kinematics_kind,
            laws=laws,
            quantum_urad=quantum_urad,
            place=like.place,
        )
        return
    output = "XYZ"[COMPONENTS.index(column)]
    if output != letter or value.any():
        place = {**like.place, COLUMN: f"E{output}{letter}"}
        yield replace(
            like,
            kind=how.kinematics_kind,
            output_axis=output,
            value_um=value * 1000.0,
            place=place,
        )


def read_assignment(file: ControlFile) -> dict[str, str]:
    """Return the table that the active line calls, by axis. Raises ``DataError`` unless exactly one
    line is active."""
    _, columns, rows = _com_cells(file, free_cells=True)
    active = [cells for _, cells in rows if "*" in cells]
    if columns[:2] != ["NR", "ACTIVE"] or len(active) != 1:
        raise DataError(
            file.name,
            expected=message("nr-active"),
            found=message("such-lines", count=len(active)),
        )
    return {axis: cell for axis, cell in zip(columns[2:], active[0][2:], strict=True) if cell}


def _positions(
    name: str,
    begin: re.Match[str],
    index: Mapping[str, int],
    rows: Sequence[tuple[str, list[str]]],
) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    if "AXISPOS" in index:
        position = np.array([finite(cells[index["AXISPOS"]], at) for at, cells in rows])
    elif begin["datum"] is not None:
        distance = finite(begin["distance"], f"{name}: DISTANCE")
        position = finite(begin["datum"], f"{name}: DATUM") + distance * np.arange(len(rows))
    else:
        raise DataError(
            f"{name}: line 1", expected=message("datum-or-column"), found=begin.group()
        )
    if len(position) < 2 or np.any(np.diff(position) <= 0.0):
        raise DataError(
            name,
            expected=message("two-rising"),
            found=message("count-rows", count=len(position)),
        )
    return position


def _com_cells(
    file: ControlFile, *, free_cells: bool = False
) -> tuple[re.Match[str], list[str], list[tuple[str, list[str]]]]:
    """Return the first line, the names of the columns, and the cells of each row with the place of
    the row.

    With ``free_cells`` cells may be empty, so a row is split where the columns of the heading
    begin. Otherwise a row is split at blanks.
    """
    lines = [(at, line) for at, line in read_lines(file) if line.strip()]
    begin = _BEGIN.match(lines[0][1]) if lines else None
    if begin is None or begin["unit"] == "INCH":
        raise DataError(
            f"{file.name}: line 1",
            expected="BEGIN <name> .. MM",
            found=repr(lines[0][1]) if lines else message("nothing"),
        )
    if len(lines) < 3 or lines[-1][1].strip() != _END:
        raise DataError(
            file.name,
            expected=message("heading-end", end=_END),
            found=message("no-eof"),
            remedy=message("file-truncated"),
        )
    starts = [(match.group(), match.start()) for match in re.finditer(r"\S+", lines[1][1])]
    rows = []
    for number, (at, line) in enumerate(lines[2:-1]):
        cells = _cut(line, [start for _, start in starts]) if free_cells else line.split()
        if len(cells) != len(starts) or cells[0] != str(number):
            raise DataError(
                at,
                expected=message("row-cells", number=number, count=len(starts)),
                found=repr(line.rstrip()),
            )
        rows.append((at, cells))
    return begin, [name for name, _ in starts], rows


def _cut(line: str, starts: Sequence[int]) -> list[str]:
    ends = [*starts[1:], len(line)]
    return [line[start:end].strip() for start, end in zip(starts, ends, strict=True)]


def _heading(columns: Sequence[str], ending: str, profile: Profile) -> str:
    for file in profile.existing:
        if file.name.upper().endswith(ending):
            own = [line for _, line in read_lines(file)][1:2]
            if own and own[0].split() == list(columns):
                return own[0]
    return "".join(column.ljust(_WIDTHS.get(column, _WIDTH)) for column in columns)


def _com_row(heading: str, cells: Mapping[str, str], empty: str, name: str) -> str:
    starts = [(match.group(), match.start()) for match in re.finditer(r"\S+", heading)]
    row = ""
    for column, start in starts:
        if row and len(row) >= start:
            raise SafetyError(
                f"{name}: {column}",
                code="field-too-narrow.column",
                expected=message("wide-columns"),
                found=repr(row.rstrip()),
                remedy=message("widen-columns"),
            )
        row = row.ljust(start) + cells.get(column, empty)
    return row.rstrip()


def _signed(value: float, decimals: int) -> str:
    text = fixed(value, decimals)
    return text if text.startswith("-") else f"+{text}"
