"""The straightness file: straightness measured by a 4-DOF head or a straightedge, for a survey
whose diagonals were recorded with other software.

The columns are ``position_mm``, optionally ``approach``, and two columns for each function, for
example ``EYX_um`` and ``u_EYX_um``. An empty field is a missing value. ``approach`` is 1 for travel
in +, -1 for travel in -, and 0 or empty for the mean of both.
"""

import math
from collections.abc import Sequence

import numpy as np

from stepdiag.base.csv_table import number_in, read_table
from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.solver.model.lateral import MeasuredStraightness

STRAIGHTNESS = tuple(name for name in DISPLACEMENTS if name[1] != name[2])
LEAST_POSITIONS = 3
"""Smallest number of positions of a function: two positions always form a straight line."""


def parse_straightness(
    text: str, source: str = "straightness.csv"
) -> tuple[MeasuredStraightness, ...]:
    """Return the contents of a straightness file, one entry for each function and direction of
    approach.

    Raises ``DataError``, with the line or column, for an unknown column, a value without its
    uncertainty, or a repeated position.
    """
    table = read_table(text, source, ("position_mm",))
    names = _functions(list(table[0][1]), source)
    known: list[MeasuredStraightness] = []
    for name in names:
        rows = [
            row
            for number, fields in table
            if (row := _straightness_row(fields, name, f"{source}: line {number}"))
            is not None
        ]
        ways = sorted({row[0] for row in rows}, reverse=True)
        known += [
            _function(
                name,
                way,
                sorted(row[1:] for row in rows if row[0] == way),
                f"{source}: {name}",
            )
            for way in ways
        ]
    if not known:
        raise DataError(
            source, expected=message("value-straightness"), found=message("empty-only")
        )
    return tuple(known)


def _functions(columns: list[str], source: str) -> list[str]:
    names = [
        column.removesuffix("_um")
        for column in columns
        if column not in ("position_mm", "approach") and not column.startswith("u_")
    ]
    unknown = [name for name in names if name not in STRAIGHTNESS]
    if unknown or not names:
        expected = message("columns-such", names=STRAIGHTNESS)
        raise DataError(
            f"{source}: header",
            expected=expected,
            found=unknown[0] if unknown else ",".join(columns),
        )
    alone = [name for name in names if f"u_{name}_um" not in columns]
    if alone:
        remedy = message("state-u")
        raise DataError(
            f"{source}: header",
            expected=message("column-u-um", alone=alone[0]),
            found=message("none"),
            remedy=remedy,
        )
    return names


def _straightness_row(
    fields: dict[str, str], name: str, where: str
) -> tuple[int, float, float, float] | None:
    position = number_in(fields, "position_mm", where)
    approach = number_in(fields, "approach", where, optional=True)
    value = number_in(fields, f"{name}_um", where, optional=True)
    if math.isnan(value):
        return None
    u = number_in(fields, f"u_{name}_um", where, least=0.0)
    if u == 0.0:
        raise DataError(f"{where}: u_{name}_um", expected=message("u-above"), found="0")
    if not math.isnan(approach) and approach not in (-1.0, 0.0, 1.0):
        raise DataError(
            f"{where}: approach", expected=message("sign-or-zero"), found=f"{approach:g}"
        )
    return (0 if math.isnan(approach) else int(approach), position, value, u)


def _function(
    name: str, approach: int, rows: Sequence[tuple[float, float, float]], where: str
) -> MeasuredStraightness:
    if len(rows) < LEAST_POSITIONS:
        raise DataError(
            where, expected=message("values-at", count=LEAST_POSITIONS), found=str(len(rows))
        )
    position, value, u = (np.array(column) for column in zip(*rows, strict=True))
    if np.any(np.diff(position) == 0):
        at = position[int(np.argmin(np.diff(position)))]
        raise DataError(
            where,
            expected=message("position-once-way"),
            found=message("twice-mm", place_mm=at),
            remedy=message("average-repeated-runs"),
        )
    return MeasuredStraightness(
        name=name, position_mm=position, value_um=value, u_um=u, approach=approach
    )


def render_straightness(measured: Sequence[MeasuredStraightness]) -> str:
    """Return the text of a straightness file with LF line ends and six decimals; ``measured``
    has at most one entry for each function and direction."""
    names = [name for name in STRAIGHTNESS if any(one.name == name for one in measured)]
    lines = ["position_mm,approach," + ",".join(f"{name}_um,u_{name}_um" for name in names)]
    for approach in sorted({one.approach for one in measured}, reverse=True):
        mine = {one.name: one for one in measured if one.approach == approach}
        places = sorted(
            {float(position) for one in mine.values() for position in one.position_mm}
        )
        lines += [
            f"{at:.6f},{approach}," + ",".join(_fields(mine.get(name), at) for name in names)
            for at in places
        ]
    return "\n".join(lines) + "\n"


def _fields(one: MeasuredStraightness | None, at_mm: float) -> str:
    if one is None or at_mm not in one.position_mm:
        return ","
    place = int(np.argmax(one.position_mm == at_mm))
    return f"{one.value_um[place]:.6f},{one.u_um[place]:.6f}"
