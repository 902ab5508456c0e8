"""The text of Heidenhain .COM and .CMA tables: first line, heading, numbered rows, ``[END]``."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines, finite, read_lines
from stepdiag.exporters.files.naming import plain_name
from stepdiag.exporters.files.numbers import fixed
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Law, Table
from stepdiag.solver.errors import DataError, SafetyError

_NEWLINE = "\r\n"
_END = "[END]"
_BEGIN = re.compile(r"^BEGIN\s+(?P<name>\S+)(?:\s+DATUM:(?P<datum>\S+)\s+DISTANCE:(?P<distance>\S+))?(?:\s+(?P<unit>MM|INCH))?\s*\Z")
_WIDTHS = {"NR": 8, "ACTIVE": 8}
_WIDTH = 16


def file_name(axis: str, positions: bool) -> str:
    """Return the name of the table of an input axis, as each generation writes it."""
    return f"AXIS_{axis}.COM" if positions else f"AXIS-{axis}.COM"


def axis_in(name: str, axes: Sequence[str]) -> str:
    """Return the axis that a table's name ends with. Raises ``DataError``."""
    stem = name.upper().removesuffix(".COM")
    for axis in axes:
        if stem.endswith((f"_{axis.upper()}", f"-{axis.upper()}")):
            return axis
    raise DataError(name, expected="a .CMA file, or a name that ends with an axis, such as AXIS_X.COM", found=name)


def render(tables: Sequence[Table], profile: Profile, *, positions: bool, decimals: int) -> ControlFile:
    """Return the .COM file of the tables of one input axis, which share a grid.

    ``positions``: the newer form with a column AXISPOS; otherwise DATUM and DISTANCE stand in the first line.
    """
    name, grid = str(tables[0].place["file"]), tables[0].position_mm
    values = {profile.axis(table.output_axis).name: table.value_um / 1000.0 for table in tables}
    columns = ["NR", *(["AXISPOS", "BACKLASH"] if positions else []), *(axis.name for axis in profile.axes.values())]
    heading = _heading(columns, ".COM", profile)
    rows = []
    for index, at in enumerate(grid):
        cells = {"NR": str(index), "AXISPOS": _signed(at, decimals), "BACKLASH": _signed(0.0, decimals)}
        cells |= {axis: _signed(float(column[index]), decimals) for axis, column in values.items()}
        rows.append(_row(heading, cells, _signed(0.0, decimals), name))
    datum = f"  DATUM:{_signed(float(grid[0]), decimals)} DISTANCE:{_signed(float(grid[1] - grid[0]), decimals)}"
    first = f"BEGIN {name}{'' if positions else datum} MM"
    return ControlFile(name=name, data=ascii_lines([first, heading.rstrip(), *rows, _END], _NEWLINE))


def render_assignment(name: str, named: Mapping[str, str], axes: Sequence[str], profile: Profile) -> ControlFile:
    """Return the .CMA file with one active line that calls the table of each axis in ``named``."""
    heading = _heading(["NR", "ACTIVE", *axes], ".CMA", profile)
    row = _row(heading, {"NR": "0", "ACTIVE": "*", **named}, "", name)
    return ControlFile(name=name, data=ascii_lines([f"BEGIN {name} MM", heading.rstrip(), row, _END], _NEWLINE))


def read(file: ControlFile, input_axis: str, profile: Profile, kind: str, law: Law) -> list[Table]:
    """Return the tables of a .COM file, one for each axis that it has a column for. Raises ``DataError``."""
    begin, columns, rows = _read(file)
    index = {column: place for place, column in enumerate(columns)}
    where = f"{file.name}: heading"
    axes = [column for column in columns if column not in ("NR", "AXISPOS", "BACKLASH")]
    letters = {column: profile.letter_of(column, where) for column in axes}
    position = _positions(file.name, begin, index, rows)
    if "BACKLASH" in index and any(finite(cells[index["BACKLASH"]], at) for at, cells in rows):
        raise DataError(where, expected="BACKLASH 0 in every row", found="a backlash", remedy="its sense is not public: take it out first")
    values = {axis: np.array([finite(cells[index[axis]], at) for at, cells in rows]) for axis in axes}
    places = max((len(cells[index[axis]].partition(".")[2]) for _, cells in rows for axis in axes), default=4)
    return [
        Table(
            kind=kind,
            input_axis=input_axis,
            output_axis=letters[axis],
            position_mm=position,
            value_um=value * 1000.0,
            quantum_um=1000.0 * 10.0**-places,
            law=law,
            reference_mm=profile.axis(input_axis).reference_mm,
            place={"file": plain_name(file.name)},
        )
        for axis, value in values.items()
    ]


def read_assignment(file: ControlFile) -> dict[str, str]:
    """Return the table that the active line calls, by axis. Raises ``DataError`` unless exactly one line is active."""
    _, columns, rows = _read(file, free_cells=True)
    active = [cells for _, cells in rows if "*" in cells]
    if columns[:2] != ["NR", "ACTIVE"] or len(active) != 1:
        raise DataError(file.name, expected="columns NR ACTIVE .. and one line with *", found=f"{len(active)} such lines")
    return {axis: cell for axis, cell in zip(columns[2:], active[0][2:], strict=True) if cell}


def _positions(
    name: str, begin: re.Match[str], index: Mapping[str, int], rows: Sequence[tuple[str, list[str]]]
) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    if "AXISPOS" in index:
        position = np.array([finite(cells[index["AXISPOS"]], at) for at, cells in rows])
    elif begin["datum"] is not None:
        distance = finite(begin["distance"], f"{name}: DISTANCE")
        position = finite(begin["datum"], f"{name}: DATUM") + distance * np.arange(len(rows))
    else:
        raise DataError(f"{name}: line 1", expected="DATUM and DISTANCE, or a column AXISPOS", found=begin.group())
    if len(position) < 2 or np.any(np.diff(position) <= 0.0):
        raise DataError(name, expected="two or more rising positions", found=f"{len(position)} rows")
    return position


def _read(file: ControlFile, *, free_cells: bool = False) -> tuple[re.Match[str], list[str], list[tuple[str, list[str]]]]:
    """Return first line, column names, and the cells of each row with its place.

    ``free_cells``: cells may be empty, so they are cut where the columns begin; otherwise at the blanks.
    """
    lines = [(at, line) for at, line in read_lines(file) if line.strip()]
    begin = _BEGIN.match(lines[0][1]) if lines else None
    if begin is None or begin["unit"] == "INCH":
        raise DataError(f"{file.name}: line 1", expected="BEGIN <name> .. MM", found=repr(lines[0][1]) if lines else "nothing")
    if len(lines) < 3 or lines[-1][1].strip() != _END:
        raise DataError(
            file.name, expected=f"heading, rows and {_END}", found="no end of file", remedy="the file is truncated: take it again"
        )
    starts = [(match.group(), match.start()) for match in re.finditer(r"\S+", lines[1][1])]
    rows = []
    for number, (at, line) in enumerate(lines[2:-1]):
        cells = _cut(line, [start for _, start in starts]) if free_cells else line.split()
        if len(cells) != len(starts) or cells[0] != str(number):
            raise DataError(at, expected=f"row {number} with {len(starts)} cells", found=repr(line.rstrip()))
        rows.append((at, cells))
    return begin, [name for name, _ in starts], rows


def _cut(line: str, starts: Sequence[int]) -> list[str]:
    ends = [*starts[1:], len(line)]
    return [line[start:end].strip() for start, end in zip(starts, ends, strict=True)]


def _heading(columns: Sequence[str], ending: str, profile: Profile) -> str:
    """Return the heading: that of the control's own file where it has the same columns, otherwise with assumed widths."""
    for file in profile.existing:
        if file.name.upper().endswith(ending):
            own = [line for _, line in read_lines(file)][1:2]
            if own and own[0].split() == list(columns):
                return own[0]
    return "".join(column.ljust(_WIDTHS.get(column, _WIDTH)) for column in columns)


def _row(heading: str, cells: Mapping[str, str], empty: str, name: str) -> str:
    starts = [(match.group(), match.start()) for match in re.finditer(r"\S+", heading)]
    row = ""
    for column, start in starts:
        if row and len(row) >= start:
            raise SafetyError(
                f"{name}: {column}", code="column-too-narrow", expected="columns wide enough for the values", found=repr(row.rstrip()),
                remedy="widen the columns of the control's own file, or write fewer decimals",
            )  # fmt: skip
        row = row.ljust(start) + cells.get(column, empty)
    return row.rstrip()


def _signed(value: float, decimals: int) -> str:
    text = fixed(value, decimals)
    return text if text.startswith("-") else f"+{text}"
