"""The ISG_CSV file: columns named in a heading, rows below, ``//`` comments, ``#`` before a new heading (TF5280, 296429067)."""

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines, finite, read_lines
from stepdiag.exporters.files.numbers import fixed, shortest
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Law, Table
from stepdiag.solver.errors import DataError

_COMPONENT = re.compile(r"^E[XYZ][XYZ]\Z")
_ANGLE = re.compile(r"^E[ABC][XYZ]\Z")
_WIDTH = 12


def render(tables: Sequence[Table], decimals: int, notes: Sequence[str]) -> bytes:
    """Return the file: one block for each input axis, its components in mm beside each other."""
    lines = [f"// {note}" for note in notes]
    lines.append("// values and positions in mm, ISO 230-1, actual minus commanded; squareness is within the straightness components")
    blocks = [[table for table in tables if table.input_axis == letter] for letter in "XYZ"]
    for number, block in enumerate(block for block in blocks if block):
        lines += ["#"] if number else []
        lines.append(_row([block[0].input_axis, *(table.name for table in block)]))
        for index, at in enumerate(block[0].position_mm):
            lines.append(_row([shortest(float(at)), *(fixed(table.value_um[index] / 1000, decimals) for table in block)]))
    return ascii_lines(lines)


def recognises(file: ControlFile) -> bool:
    """Return whether the first line that is no comment is a heading of component errors."""
    try:
        head = next(_said(file), ("", []))[1]
    except DataError:
        return False
    return len(head) > 1 and head[0] in ("X", "Y", "Z") and all(map(_COMPONENT.match, head[1:]))


def read(file: ControlFile, profile: Profile, kind: str, laws: Mapping[str, Law]) -> list[Table]:
    """Return a table for each component column; angle columns must be 0. Raises ``DataError`` with file and line."""
    tables: list[Table] = []
    for block in _blocks(file):
        (where, head), rows = block[0], block[1:]
        if head[0] not in ("X", "Y", "Z") or not all(_COMPONENT.match(name) or _ANGLE.match(name) for name in head[1:]):
            raise DataError(where, expected="a heading such as X EXX EYX EZX", found=" ".join(head))
        values = np.array([_numbers(cells, len(head), at) for at, cells in rows])
        if len(rows) < 2 or np.any(np.diff(values[:, 0]) <= 0):
            raise DataError(where, expected="two or more rows with rising positions", found=f"{len(rows)} rows")
        tables += _columns(file, block, values, profile, kind, laws)
    return tables


def _columns(
    file: ControlFile, block: Sequence[tuple[str, list[str]]], values: "np.ndarray[tuple[int, int], np.dtype[np.float64]]",
    profile: Profile, kind: str, laws: Mapping[str, Law],
) -> Iterator[Table]:  # fmt: skip
    (where, head), rows = block[0], block[1:]
    for column, name in enumerate(head[1:], start=1):
        if _ANGLE.match(name):
            if values[:, column].any():
                raise DataError(
                    where, expected=f"{name} 0: angles are not corrected here", found="an angle", remedy=f"take {name} out of {file.name}"
                )
            continue
        if name[2] != head[0]:
            raise DataError(where, expected=f"components of {head[0]}", found=name)
        places = max(len(cells[column].partition(".")[2]) for _, cells in rows)
        yield Table(
            kind=kind,
            input_axis=head[0],
            output_axis=name[1],
            position_mm=values[:, 0],
            value_um=values[:, column] * 1000.0,
            quantum_um=1000.0 * 10.0**-places,
            law=laws[name[1]],
            reference_mm=profile.axis(head[0]).reference_mm,
            place={"column": name},
        )


def _numbers(cells: Sequence[str], count: int, where: str) -> list[float]:
    if len(cells) != count:
        raise DataError(where, expected=f"{count} numbers", found=" ".join(cells))
    return [finite(cell, where) for cell in cells]


def _blocks(file: ControlFile) -> list[list[tuple[str, list[str]]]]:
    blocks: list[list[tuple[str, list[str]]]] = [[]]
    for where, cells in _said(file):
        if cells[0].startswith("#"):
            blocks.append([])
        else:
            blocks[-1].append((where, cells))
    if any(not block for block in blocks):
        raise DataError(
            file.name, expected="a heading and rows in every block", found="an empty block", remedy="the file is truncated: take it again"
        )
    return blocks


def _said(file: ControlFile) -> Iterator[tuple[str, list[str]]]:
    for where, line in read_lines(file):
        if cells := line.partition("//")[0].split():
            yield where, cells


def _row(cells: Sequence[str]) -> str:
    return " ".join(cell.ljust(_WIDTH) for cell in cells).rstrip()
