"""The ISG_CSV file: a heading names the columns, rows of numbers follow, ``//`` begins a comment,
and ``#`` precedes a new heading (TF5280, 296429067).

Lengths are in mm, angles in rad (296426379). A block whose heading names no axis has one row of
position errors. stepdiag writes the squarenesses C0Y, B0Z and A0Z there, with the sign of the
displacement of the tool.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines, finite, read_lines, require_end
from stepdiag.exporters.files.numbers import fixed, shortest
from stepdiag.exporters.tables.angular import COLUMN, Angle, angle_tables, column_urad
from stepdiag.exporters.tables.curves import SQUARENESS_SLOPE
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Law, Table

_COMPONENT = re.compile(r"^E[XYZ][XYZ]\Z")
_ANGLE = re.compile(r"^E[ABC][XYZ]\Z")
_POSITION_ERROR = re.compile(r"^[XYZABC]0[XYZABC]\Z")
_WIDTH = 12
_MARK, _END = b"// values and positions in mm", b"// end"
"""First and last comment of a file from stepdiag. The format has no end mark, so a missing last
comment shows a truncated file.
"""
RAD_DECIMALS = 9
"""Decimal places of an angle in rad: the last place is 1 nrad."""
_FINER = 2
"""Additional decimal places of a straightness column from which a squareness is subtracted."""
SHIFTS = {"C0Y": "EXY", "B0Z": "EXZ", "A0Z": "EYZ"}
"""The straightness function to which the reader adds each squareness. A squareness and a slope of
this function displace the tool in the same way.
"""

Rows = list[tuple[str, list[str]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Instructions for reading a file: kinds of its tables, laws by output axis, and ``levers`` of
    the angles (None if the profile states no chain).
    """

    kind: str
    angle_kind: str
    laws: Mapping[str, Law]
    levers: Vector | None


def render(
    tables: Sequence[Table],
    decimals: int,
    notes: Sequence[str],
    squareness: Sequence[str] = (),
) -> bytes:
    """Return the bytes of a file with one block per input axis; displacements are in mm, angles in
    rad.

    ``squareness`` contains the squarenesses that get a column of their own in the first block.
    Every other squareness stays in a straightness column.
    """
    curves = {table.name: table for table in tables if table.multiplier is None}
    angles = {
        str(table.place[COLUMN]): table for table in tables if table.multiplier is not None
    }
    slopes_rad = {
        name: _slope_rad(curves[SHIFTS[name]], name)
        for name in squareness
        if SHIFTS[name] in curves
    }
    leaning = (
        f"{', '.join(slopes_rad)} as columns"
        if slopes_rad
        else "squareness is within the straightness components"
    )
    lines = [f"// {note}" for note in notes]
    lines.append(
        f"{_MARK.decode('ascii')}{', angles in rad' if angles else ''}, ISO 230-1, actual minus "
        f"commanded; {leaning}"
    )
    if slopes_rad:
        lines += [
            _csv_row(list(slopes_rad)),
            _csv_row([fixed(value, RAD_DECIMALS) for value in slopes_rad.values()]),
        ]
    places = decimals + _FINER if slopes_rad else decimals
    for letter in "XYZ":
        block = {
            name: _without(table, slopes_rad) / 1000
            for name, table in curves.items()
            if table.input_axis == letter
        }
        turns = {
            name: column_urad(table) * 1e-6
            for name, table in angles.items()
            if table.input_axis == letter
        }
        along = next((table for table in tables if table.input_axis == letter), None)
        if along is None:
            continue
        lines += ["#"] if any(not line.startswith("//") for line in lines) else []
        lines.append(_csv_row([letter, *block, *turns]))
        for index, at in enumerate(along.position_mm):
            cells = [fixed(value[index], places) for value in block.values()]
            cells += [fixed(value[index], RAD_DECIMALS) for value in turns.values()]
            lines.append(_csv_row([shortest(float(at)), *cells]))
    return ascii_lines([*lines, _END.decode("ascii")])


def _slope_rad(table: Table, name: str) -> float:
    rise = (table.value_um[-1] - table.value_um[0]) / (
        table.position_mm[-1] - table.position_mm[0]
    )
    return round(float(rise) * 1e-3 / SQUARENESS_SLOPE[name][SHIFTS[name]], RAD_DECIMALS)


def _without(table: Table, slopes_rad: Mapping[str, float]) -> Vector:
    """Return the values of a table in um without its squareness. The contribution of the squareness
    is zero at the position 0 of the axis.
    """
    value = table.value_um
    for name, slope in slopes_rad.items():
        if SHIFTS[name] == table.name:
            value = value - _shift_um(name, slope, table.position_mm)
    return value


def _shift_um(name: str, slope_rad: float, position_mm: Vector) -> Vector:
    return slope_rad * 1e3 * SQUARENESS_SLOPE[name][SHIFTS[name]] * position_mm


def recognises(file: ControlFile) -> bool:
    try:
        head = next(_csv_lines(file), ("", []))[1]
    except DataError:
        return False
    if head and all(map(_POSITION_ERROR.match, head)):
        return True
    return (
        len(head) > 1
        and head[0] in ("X", "Y", "Z")
        and all(_COMPONENT.match(name) or _ANGLE.match(name) for name in head[1:])
    )


def read(file: ControlFile, profile: Profile, how: Reading) -> list[Table]:
    """Return one table per component column, with its squareness added, and the product tables of
    each angle column.

    Raises ``DataError``, with file and line, for a wrong file, and for angles if the profile has no
    chain.
    """
    require_end(file, _MARK, _END)
    squareness: dict[str, float] = {}
    tables: list[Table] = []
    for block in _blocks(file):
        (where, head), rows = block[0], block[1:]
        if all(map(_POSITION_ERROR.match, head)):
            squareness |= _squareness(where, head, rows)
            continue
        if head[0] not in ("X", "Y", "Z") or not all(
            _COMPONENT.match(name) or _ANGLE.match(name) for name in head[1:]
        ):
            raise DataError(where, expected=message("heading-words"), found=" ".join(head))
        if len(set(head)) != len(head):
            raise DataError(where, expected=message("each-column"), found=" ".join(head))
        values = np.array([_numbers(cells, len(head), at) for at, cells in rows])
        if len(rows) < 2 or np.any(np.diff(values[:, 0]) <= 0):
            raise DataError(
                where,
                expected=message("rows-rising"),
                found=message("count-rows", count=len(rows)),
            )
        tables += _columns(file, block, values, profile, how)
    return _with_squareness(tables, squareness, file, profile, how)


def _squareness(where: str, head: Sequence[str], rows: Rows) -> dict[str, float]:
    if len(rows) != 1:
        raise DataError(
            where, expected=message("one-row"), found=message("count-rows", count=len(rows))
        )
    ((at, cells),) = rows
    values = dict(zip(head, _numbers(cells, len(head), at), strict=True))
    foreign = [name for name, value in values.items() if value and name not in SHIFTS]
    if foreign:
        raise DataError(
            where,
            expected=message("c0y-b0z-a0z"),
            found=", ".join(foreign),
            remedy=message("fold-three"),
        )
    return {name: value for name, value in values.items() if value}


def _with_squareness(
    tables: Sequence[Table],
    squareness: Mapping[str, float],
    file: ControlFile,
    profile: Profile,
    how: Reading,
) -> list[Table]:
    found = {table.name: table for table in tables}
    for name, value in squareness.items():
        target = SHIFTS[name]
        if target in found:
            table = found[target]
            found[target] = replace(
                table, value_um=table.value_um + _shift_um(name, value, table.position_mm)
            )
            continue
        ends = profile.grid_mm(target[2])[[0, -1]]
        found[target] = Table(
            kind=how.kind,
            input_axis=target[2],
            output_axis=target[1],
            position_mm=ends,
            value_um=_shift_um(name, value, ends),
            quantum_um=1e-3,
            law=replace(how.laws[target[1]], ends="extended"),
            reference_mm=profile.axis(target[2]).reference_mm,
            place={COLUMN: name},
        )
    if not found:
        raise DataError(file.name, expected=message("columns-errors"), found=message("none"))
    return list(found.values())


def _columns(
    file: ControlFile, block: Rows, values: Vector, profile: Profile, how: Reading
) -> Iterator[Table]:
    (where, head), rows = block[0], block[1:]
    for column, name in enumerate(head[1:], start=1):
        if name[2] != head[0]:
            raise DataError(
                where, expected=message("components-of-axis", axis=head[0]), found=name
            )
        places = max(len(cells[column].partition(".")[2]) for _, cells in rows)
        if _ANGLE.match(name):
            yield from _angle(
                file,
                where,
                Angle(
                    name=name, position_mm=values[:, 0], value_urad=values[:, column] * 1e6
                ),
                profile,
                how,
                places,
            )
            continue
        yield Table(
            kind=how.kind,
            input_axis=head[0],
            output_axis=name[1],
            position_mm=values[:, 0],
            value_um=values[:, column] * 1000.0,
            quantum_um=1000.0 * 10.0**-places,
            law=how.laws[name[1]],
            reference_mm=profile.axis(head[0]).reference_mm,
            place={COLUMN: name},
        )


def _angle(
    file: ControlFile, where: str, angle: Angle, profile: Profile, how: Reading, places: int
) -> Iterator[Table]:
    if how.levers is None:
        if angle.value_urad.any():
            raise DataError(
                where,
                expected=message("zero-levers", name=angle.name),
                found=message("an-angle"),
                remedy=message("state-chain", name=angle.name, file=file.name),
            )
        return
    as_error = replace(
        angle, value_urad=angle.value_urad * -next(iter(how.laws.values())).factor
    )
    yield from angle_tables(
        as_error,
        how.levers,
        profile,
        kind=how.angle_kind,
        laws=how.laws,
        quantum_urad=1e6 * 10.0**-places,
        place={},
    )


def _numbers(cells: Sequence[str], count: int, where: str) -> list[float]:
    if len(cells) != count:
        raise DataError(
            where, expected=message("count-numbers", count=count), found=" ".join(cells)
        )
    return [finite(cell, where) for cell in cells]


def _blocks(file: ControlFile) -> list[Rows]:
    blocks: list[Rows] = [[]]
    for where, cells in _csv_lines(file):
        if cells[0].startswith("#"):
            blocks.append([])
        else:
            blocks[-1].append((where, cells))
    if any(not block for block in blocks):
        raise DataError(
            file.name,
            expected=message("heading-rows"),
            found=message("empty-block"),
            remedy=message("file-truncated"),
        )
    return blocks


def _csv_lines(file: ControlFile) -> Iterator[tuple[str, list[str]]]:
    for where, line in read_lines(file):
        if cells := line.partition("//")[0].split():
            yield where, cells


def _csv_row(cells: Sequence[str]) -> str:
    return " ".join(cell.ljust(_WIDTH) for cell in cells).rstrip()
