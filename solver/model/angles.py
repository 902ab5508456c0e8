"""The angles file (contract 4): angular functions that a 4-DOF head or an electronic level
measured."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stepdiag.base.csv_table import number_in, read_table
from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.result.result import ROTATIONS
from stepdiag.base.volume import POSITION_TOLERANCE_MM, Vector, Volume

ROTATION_COLUMNS = ("EA_urad", "EB_urad", "EC_urad")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownAngle:
    """One angular function: positions ascending in mm, values in urad, standard uncertainties in
    urad (NaN if missing)."""

    position_mm: Vector
    value_urad: Vector
    u_urad: Vector


Angles = Mapping[str, KnownAngle]


@dataclass(frozen=True, slots=True)
class _Row:
    axis: str
    position_mm: float
    urad: tuple[float, float, float]
    u_urad: float


def parse_angles(text: str, source: str = "angles.csv") -> Angles:
    """Return the functions of an angles file (contract 4). An empty field is a missing value; a
    column without values gives no function.

    Raises ``DataError``, with the line number, for an invalid file and for a function with fewer
    than two positions.
    """
    table = read_table(text, source, ("axis", "position_mm", *ROTATION_COLUMNS))
    rows = [_angle_row(source, number, fields) for number, fields in table]
    angles: dict[str, KnownAngle] = {}
    for index, name in enumerate(ROTATIONS):
        axis, component = divmod(index, 3)
        known = sorted(
            (
                row
                for row in rows
                if row.axis == AXES[axis] and not math.isnan(row.urad[component])
            ),
            key=lambda row: row.position_mm,
        )
        if known:
            angles[name] = _function(f"{source}: {name}", known, component)
    return angles


def _angle_row(source: str, number: int, fields: dict[str, str]) -> _Row:
    axis = fields["axis"].lower()
    if axis not in AXES:
        raise DataError(
            f"{source}: line {number}: axis",
            expected=message("x-y-z"),
            found=repr(fields["axis"]),
        )
    where = f"{source}: line {number}"
    a, b, c = (number_in(fields, name, where, optional=True) for name in ROTATION_COLUMNS)
    return _Row(
        axis,
        number_in(fields, "position_mm", where),
        (a, b, c),
        number_in(fields, "u_urad", where, optional=True, least=0.0),
    )


def _function(where: str, rows: list[_Row], component: int) -> KnownAngle:
    position = np.array([row.position_mm for row in rows])
    if len(rows) < 2:
        raise DataError(
            where,
            expected=message("two-positions"),
            found="one",
            remedy=message("leave-empty"),
        )
    if np.any(np.diff(position) <= 0):
        at = position[int(np.argmin(np.diff(position)))]
        raise DataError(
            where,
            expected=message("position-once"),
            found=message("twice-mm", place_mm=at),
            remedy=message("average-repeated-runs"),
        )
    return KnownAngle(
        position_mm=position,
        value_urad=np.array([row.urad[component] for row in rows]),
        u_urad=np.array([row.u_urad for row in rows]),
    )


def render_angles(angles: Angles) -> str:
    """Return the text of an angles file (contract 4) with LF line ends and six decimals. Angles
    at one position with different uncertainties are written in different rows."""
    lines = ["axis,position_mm," + ",".join(ROTATION_COLUMNS) + ",u_urad"]
    for axis, letter in enumerate(AXES):
        mine = [angles.get(name) for name in ROTATIONS[3 * axis : 3 * axis + 3]]
        for position in sorted(
            {float(at) for known in mine if known for at in known.position_mm}
        ):
            values = [
                _interpolated(known.position_mm, known.value_urad, position)
                if known
                else math.nan
                for known in mine
            ]
            every_u = [
                _interpolated(known.position_mm, known.u_urad, position)
                if known
                else math.nan
                for known in mine
            ]
            texts = ["" if math.isnan(u) else f"{u:.6f}" for u in every_u]
            for text in dict.fromkeys(
                text
                for text, value in zip(texts, values, strict=True)
                if not math.isnan(value)
            ):
                same = [
                    value if text == own else math.nan
                    for value, own in zip(values, texts, strict=True)
                ]
                lines.append(
                    f"{letter},{position:.6f},"
                    + ",".join("" if math.isnan(value) else f"{value:.6f}" for value in same)
                    + f",{text}"
                )
    return "\n".join(lines) + "\n"


def _interpolated(position_mm: Vector, values: Vector, at_mm: float) -> float:
    place = np.flatnonzero(position_mm == at_mm)
    return float(values[place[0]]) if len(place) else math.nan


def angle_at_nodes(known: KnownAngle, name: str, volume: Volume) -> tuple[Vector, Vector]:
    """Return an angular function and its standard uncertainty in urad at nodes 1 .. n of its axis,
    relative to node 0, shapes (n,).

    The values are interpolated linearly. Raises ``DataError`` if the positions of the function do
    not cover the volume.
    """
    nodes = volume.nodes_mm(AXES.index(name[2].lower()))
    low, high = known.position_mm[0], known.position_mm[-1]
    if low > nodes[0] + POSITION_TOLERANCE_MM or high < nodes[-1] - POSITION_TOLERANCE_MM:
        raise DataError(
            f"angles: {name}",
            expected=message("positions-whole", low=nodes[0], high_mm=nodes[-1]),
            found=message("mm-to", low=low, high_mm=high),
            remedy=message("angles-whole"),
        )
    value = np.interp(nodes, known.position_mm, known.value_urad)
    return value[1:] - value[0], np.interp(nodes, known.position_mm, known.u_urad)[1:]
