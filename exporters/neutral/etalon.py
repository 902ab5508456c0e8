"""Etalon Exchange: all functions of a result as text, for other software for volumetric
compensation.

Source: TF5280, page 296430091 of infosys.beckhoff.com, and the same page of isg-stuttgart.de. A
block begins with the ISO 230-1 name in square brackets. A position error has ``VALUE = number``, a
function ``Gridpoints = { position value .. }``. ``//`` begins a comment. Lengths are in mm, angles
in rad (296426379). The format does not state the point from which the lever of an angle counts.
stepdiag uses the zero of the axes, as a control does, and shifts the displacements by the levers of
the measured corner. The format contains no kinematic chain, so the import command asks for the
chain.
"""

import re
from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.kinematics import abbe_mask, cross_matrix
from stepdiag.base.messages import excerpt, message
from stepdiag.base.result.result import (
    DISPLACEMENTS,
    ROTATIONS,
    SQUARENESS,
    Function,
    Quantity,
    Result,
    Scale,
)
from stepdiag.base.volume import MOST_INCREMENTS, Vector, Volume
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines, finite, read_lines
from stepdiag.exporters.files.numbers import shortest

NAME = "etalon"
FILE_NAME = "etalon_exchange.txt"
_BLOCK = re.compile(r"^\[([A-Z0-9]{3})\]\Z")
_VALUE = re.compile(r"^VALUE\s*=\s*(\S+)\Z")
_BEGIN = re.compile(r"^Gridpoints\s*=\s*\{\Z")
_DECIMALS = 9
"""Decimal places in the file, more than in a file for any control: the last place is 1 nrad or 1
pm.
"""


def render(result: Result) -> ControlFile:
    """Return the file with every function and squareness that the result identifies. Levers count
    from the zero of the axes.
    """
    mask, origin = abbe_mask(result.chain), np.asarray(result.volume.origin_mm)
    lines = [
        (
            f"// stepdiag, chain {result.chain}: actual minus commanded, mm and rad, levers of "
            "angles from the zero of the axes"
        )
    ]
    for name in SQUARENESS:
        value = result.squareness[name].value
        lines += (
            [] if value is None else [f"[{name}]", f"VALUE = {value * 1e-6:.{_DECIMALS}f}"]
        )
    for name in (*DISPLACEMENTS, *ROTATIONS):
        function = result.errors.get(name)
        if function is None or function.value is None:
            continue
        values = (
            function.value * 1e-6
            if name in ROTATIONS
            else 1e-3 * (function.value - _lever_um(result, name, mask, origin))
        )
        lines += [f"[{name}]", "Gridpoints = {"]
        lines += [
            f"{shortest(float(at))} {value:.{_DECIMALS}f}"
            for at, value in zip(function.position_mm, values, strict=True)
        ]
        lines.append(f"}} // end of {name}")
    return ControlFile(name=FILE_NAME, data=ascii_lines(lines))


def _lever_um(result: Result, name: str, mask: Vector, origin: Vector) -> Vector:
    axis, component = "XYZ".index(name[2]), "XYZ".index(name[1])
    at = result.errors[name].position_mm
    turns = np.column_stack(
        [_function_at(result.errors.get(f"E{turn}{name[2]}"), at) for turn in "ABC"]
    )
    moved: Vector = np.cross(turns, mask[axis] * origin)[:, component] * 1e-3
    return moved


def _function_at(function: Function | None, at: Vector) -> Vector:
    known = function is not None and function.value is not None
    return (
        np.interp(at, function.position_mm, function.value)  # type: ignore[arg-type]
        if known and function is not None
        else np.zeros(at.shape)
    )


def parse(file: ControlFile, chain: str) -> Result:
    """Return the result in a file, for a machine with the given chain.

    The volume follows from the three positioning functions. The slopes of the functions are added
    to the squarenesses, and angles count from their first position. Raises ``DataError``, with the
    line, for a wrong file, and ``UsageError`` for a wrong chain.
    """
    mask = abbe_mask(chain)
    values, functions = _etalon_blocks(file)
    missing = [name for name in ("EXX", "EYY", "EZZ") if name not in functions]
    if missing:
        raise DataError(
            file.name,
            expected=message("functions-exx-eyy-and"),
            found="no " + ", ".join(missing),
        )
    volume = _volume(functions, file.name)
    origin = np.asarray(volume.origin_mm)
    linear = np.zeros(
        (3, 3)
        # um of displacement (row) per mm of travel (column), from the levers of the first
        # value of each angle and from the slopes
    )
    errors: dict[str, Function] = {}
    for axis, letter in enumerate("XYZ"):
        turns = {
            turn: functions[f"E{turn}{letter}"]
            for turn in "ABC"
            if f"E{turn}{letter}" in functions
        }
        first = np.array(
            [turns[turn][0, 1] * 1e6 if turn in turns else 0.0 for turn in "ABC"]
        )
        linear += cross_matrix(first) @ np.diag(mask[axis]) * 1e-3
        for component, word in enumerate("XYZ"):
            rows = functions.get(f"E{word}{letter}")
            if rows is not None:
                angles = np.column_stack(
                    [
                        np.interp(rows[:, 0], *turns[t].T) * 1e6
                        if t in turns
                        else 0.0 * rows[:, 0]
                        for t in "ABC"
                    ]
                )
                moved = (
                    rows[:, 1] * 1e3
                    + np.cross(angles, mask[axis] * origin)[:, component] * 1e-3
                )
                errors[f"E{word}{letter}"], slope = _function(
                    rows[:, 0], moved, straight=component != axis
                )
                linear[component, axis] += slope
        for turn, rows in turns.items():
            errors[f"E{turn}{letter}"] = Function(
                position_mm=rows[:, 0],
                value=(rows[:, 1] - rows[0, 1]) * 1e6,
                u=None,
                unit="urad",
            )
    return Result(
        volume=volume,
        chain=chain,
        method="imported",
        errors={**{name: _unknown(volume, name) for name in DISPLACEMENTS}, **errors},
        squareness=_squareness(values, linear),
        scale={letter: Scale(value=None, u=None, identified=False) for letter in "XYZ"},
        setups={},
        findings=(),
        source=file.name,
    )


def _function(at: Vector, value_um: Vector, *, straight: bool) -> tuple[Function, float]:
    """Return a displacement function that begins at zero, and the slope in um per mm that was
    removed from a straightness function.
    """
    value = value_um - value_um[0]
    slope = float(value[-1] / (at[-1] - at[0])) if straight else 0.0
    return Function(
        position_mm=at, value=value - slope * (at - at[0]), u=None, unit="um"
    ), slope


def _unknown(volume: Volume, name: str) -> Function:
    return Function(
        position_mm=volume.nodes_mm("XYZ".index(name[2])), value=None, u=None, unit="um"
    )


def _squareness(values: Mapping[str, float], linear: Vector) -> dict[str, Quantity]:
    """Return the squarenesses: the values in the file plus the contribution of the linear
    displacements of both axes of a pair (contract 1).
    """
    pairs = {"C0Y": (0, 1, -1.0), "B0Z": (0, 2, 1.0), "A0Z": (1, 2, -1.0)}
    return {
        name: Quantity(
            value=values.get(name, 0.0) * 1e6
            + sign * 1e3 * float(linear[one, other] + linear[other, one]),
            u=None,
        )
        for name, (one, other, sign) in pairs.items()
    }


def _volume(functions: Mapping[str, Vector], where: str) -> Volume:
    axes = [functions[name][:, 0] for name in ("EXX", "EYY", "EZZ")]
    sizes = tuple(float(at[-1] - at[0]) for at in axes)
    increments = min(len(axes[0]) - 1, MOST_INCREMENTS)
    if min(sizes) <= 0:
        raise DataError(where, expected=message("positions-rise"), found=message("none"))
    return Volume(
        origin_mm=tuple(float(at[0]) for at in axes),  # type: ignore[arg-type]
        size_mm=sizes,  # type: ignore[arg-type]
        increments=increments,
    )


def _etalon_blocks(file: ControlFile) -> tuple[dict[str, float], dict[str, Vector]]:
    values: dict[str, float] = {}
    functions: dict[str, Vector] = {}
    name = ""
    rows: list[list[float]] | None = None
    for where, line in _etalon_lines(file):
        if (block := _BLOCK.match(line)) and rows is None:
            name = block[1]
            if (
                name in values
                or name in functions
                or name not in (*SQUARENESS, *DISPLACEMENTS, *ROTATIONS)
            ):
                raise DataError(
                    where, expected=message("function-or-squareness-three"), found=line
                )
        elif name and rows is None and (value := _VALUE.match(line)):
            values[name] = finite(value[1], where)
        elif name and rows is None and _BEGIN.match(line):
            rows = []
        elif rows is not None and line == "}":
            if len(rows) < 2 or np.any(np.diff(np.array(rows)[:, 0]) <= 0):
                raise DataError(
                    where,
                    expected=message("two-rising"),
                    found=message("count-rows", count=len(rows)),
                )
            functions[name] = np.array(rows)
            rows = None
        elif rows is not None and len(line.split()) == 2:
            rows.append([finite(cell, where) for cell in line.split()])
        else:
            raise DataError(
                where, expected=message("block-etalon-exchange-format"), found=excerpt(line)
            )
    if rows is not None or not functions:
        raise DataError(
            file.name,
            expected=message("whole-blocks"),
            found=message("no-end"),
            remedy=message("file-truncated"),
        )
    return values, functions


def _etalon_lines(file: ControlFile) -> Iterator[tuple[str, str]]:
    for where, line in read_lines(file):
        if text := line.partition("//")[0].strip():
            yield where, text
