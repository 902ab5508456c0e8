"""A compensation table in a control, and the law that gives the movement from the table's numbers.

Only the function ``correction_um`` applies laws. So the module of a control states its behaviour as
data, and contains no sign of its own.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import Message, Words, message
from stepdiag.base.names import AXES
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.numbers import fixed

Sense = Literal["as-error", "as-compensation"]
_SPOTS: Mapping[str, Message] = {
    "axis": message("spot-axis-name"),
    "table": message("spot-table"),
    "first point": message("spot-first-point"),
    "pair": message("spot-pair"),
    "first data": message("spot-first-data"),
    "scale": message("spot-scale"),
    "measuring system": message("spot-system"),
    "points": message("spot-points"),
    "coefficient": message("spot-coefficient"),
    "file": message("spot-file"),
    "list": message("spot-list"),
    "column": message("spot-column"),
    "set": message("spot-set"),
}
"""Names, in messages, of the parts of a table's place in the control or in a file."""


_LAW_WORDS = {
    "as-error": message("law-as-error"),
    "as-compensation": message("law-as-compensation"),
    "absolute": message("law-absolute"),
    "incremental": message("law-incremental"),
    "linear": message("law-linear"),
    "stepped": message("law-stepped"),
    "held": message("law-held"),
    "extended": message("law-extended"),
}


_LEVER = 1e-6
"""Tolerance for the difference of two multipliers, whose values are about 1."""


def _spot(what: str) -> Words:
    return _SPOTS.get(what, what)


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """The law by which a control applies a table (controllers.md 1).

    ``sense``: a positive value moves the output axis in - (``as-error``) or in +
    (``as-compensation``). ``data``: a value is absolute, or is the change from the previous point
    in the + direction. ``between``: between points the control interpolates linearly, or changes
    the value in a step when the axis passes a point. ``ends``: outside the table the control uses
    the end value, or extends the end section as a straight line.
    """

    sense: Sense
    data: Literal["absolute", "incremental"] = "absolute"
    between: Literal["linear", "stepped"] = "linear"
    ends: Literal["held", "extended"] = "held"

    @property
    def factor(self) -> int:
        """Return the movement for a table value of 1: -1 for an error, +1 for a compensation."""
        return -1 if self.sense == "as-error" else 1

    @property
    def words(self) -> Message:
        parts = [
            _LAW_WORDS[part] for part in (self.sense, self.data, self.between, self.ends)
        ]
        return message(
            "law-of-kind", sense=parts[0], data=parts[1], between=parts[2], ends=parts[3]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Multiplier:
    """The factor by which a control multiplies a table: a function of another axis without a unit,
    with the largest value 1, linear between its points.

    Outside the points the factor keeps its end value or is extended, by ``ends``.
    """

    axis: str
    position_mm: Vector
    value: Vector
    ends: Literal["held", "extended"] = "held"

    def at(self, position_mm: Vector) -> Vector:
        inside = np.interp(position_mm, self.position_mm, self.value)
        return (
            _extended(position_mm, self.position_mm, self.value, inside)
            if self.ends == "extended"
            else inside
        )

    @property
    def is_straight(self) -> bool:
        slope, zero_mm = self.line
        return slope != 0.0 and bool(
            np.allclose(self.value, slope * (self.position_mm - zero_mm), rtol=0, atol=1e-3)
        )

    @property
    def line(self) -> tuple[float, float]:
        """Return the slope per mm of the line through the ends of the multiplier, and the position
        in mm where this line is zero (0 and 0 for a line without a slope).
        """
        slope = float(
            (self.value[-1] - self.value[0]) / (self.position_mm[-1] - self.position_mm[0])
        )
        return (
            (slope, float(self.position_mm[0] - self.value[0] / slope))
            if slope
            else (0.0, 0.0)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A compensation table in a control.

    ``value_um`` are the written values in um, one per ``position_mm`` (ascending); with incremental
    data the first is 0, because there is no point before it. ``quantum_um`` is the unit of the
    written numbers. A table with ``direction`` 0 acts in both directions of travel of the input
    axis, with +1 or -1 in one direction. An incremental table counts from ``reference_mm``, where
    its value is ``offset_um``. ``place`` is the place of the table in the control (table index,
    measuring system, first point number), in the controller's own words. With a ``multiplier`` the
    table acts as a product: its values are those for a multiplier of 1.
    """

    kind: str
    input_axis: str
    output_axis: str
    position_mm: Vector
    value_um: Vector
    quantum_um: float
    law: Law
    reference_mm: float
    direction: int = 0
    offset_um: float = 0.0
    place: Mapping[str, int | str] = field(default_factory=lambda: MappingProxyType({}))
    multiplier: Multiplier | None = None

    @property
    def name(self) -> str:
        """Return the ISO 230-1 name of the function that the table corrects, such as EYX; for a
        product a name such as ``EYX*Z``.
        """
        by = "" if self.multiplier is None else f"*{self.multiplier.axis}"
        return f"E{self.output_axis}{self.input_axis}{by}"

    @property
    def label(self) -> Message:
        """Return the name of the table in messages: function, kind, direction and place."""
        way = (
            [message("table-direction", sign=f"{self.direction:+d}"[0])]
            if self.direction
            else []
        )
        spots = [
            message("table-spot", what=_spot(what), where=str(where))
            for what, where in self.place.items()
        ]
        return message("table-label", function=self.name, parts=[self.kind, *way, *spots])

    @property
    def identity(self) -> tuple[object, ...]:
        place = tuple(
            sorted(
                (key, str(value))
                for key, value in self.place.items()
                if key not in ("file", "list")
            )
        )
        return self.kind, self.name, self.direction, place

    @property
    def absolute_um(self) -> Vector:
        """Return the values of the table as absolute numbers in the sense of the table, shape of
        ``position_mm``.
        """
        if self.law.data == "absolute":
            return self.value_um
        summed = np.cumsum(self.value_um)
        origin = np.searchsorted(self.position_mm, self.reference_mm + 1e-6, side="right") - 1
        return np.asarray(summed - summed[max(int(origin), 0)] + self.offset_um)


def correction_um(table: Table, position_mm: Vector, direction: int = 1) -> Vector:
    """Return the movement of the output axis by the table and its law, in um in the + direction, at
    positions of the input axis.

    ``direction`` is the travel of the input axis, +1 or -1. A table of the opposite direction gives
    the movement 0. A product gives the movement for a multiplier of 1.
    """
    at = np.asarray(position_mm, dtype=np.float64)
    if table.direction not in (0, direction):
        return np.zeros(at.shape)
    absolute = table.absolute_um
    if table.law.between == "stepped":
        # Tolerance of 1 nm: a commanded position that differs from the point only by rounding
        # has passed the point.
        passed = np.searchsorted(table.position_mm, at + 1e-6, side="right") - 1
        return np.asarray(table.law.factor * absolute[np.clip(passed, 0, None)])
    moved = np.interp(at, table.position_mm, absolute)
    if table.law.ends == "extended":
        moved = _extended(at, table.position_mm, absolute, moved)
    return np.asarray(table.law.factor * moved)


def summed_um(tables: Iterable[Table], position_mm: Vector, direction: int = 1) -> Vector:
    return sum(
        (correction_um(table, position_mm, direction) for table in tables),
        np.zeros(np.shape(position_mm)),
    )


def steps_um(tables: Iterable[Table], position_mm: Vector, direction: int = 1) -> Vector:
    """Return the part of `summed_um` that comes from steps: stepped tables minus the straight lines
    between their points.
    """
    every = list(tables)
    straight = summed_um(map(joined, every), position_mm, direction)
    return summed_um(every, position_mm, direction) - straight


def _extended(at: Vector, position: Vector, value: Vector, inside: Vector) -> Vector:
    low = value[0] + (at - position[0]) * (value[1] - value[0]) / (position[1] - position[0])
    high = value[-1] + (at - position[-1]) * (value[-1] - value[-2]) / (
        position[-1] - position[-2]
    )
    return np.where(at < position[0], low, np.where(at > position[-1], high, inside))


def total_correction_um(
    tables: Iterable[Table], points_mm: Vector, direction: int = 1
) -> Vector:
    total = np.zeros(np.shape(points_mm))
    for table in tables:
        moved = correction_um(
            table, points_mm[:, AXES.index(table.input_axis.lower())], direction
        )
        if table.multiplier is not None:
            moved = moved * table.multiplier.at(
                points_mm[:, AXES.index(table.multiplier.axis.lower())]
            )
        total[:, AXES.index(table.output_axis.lower())] += moved
    return total


def mean_correction_um(tables: Sequence[Table], points_mm: Vector) -> Vector:
    return (
        total_correction_um(tables, points_mm, +1)
        + total_correction_um(tables, points_mm, -1)
    ) / 2


def joined(table: Table) -> Table:
    """Return a stepped table with its points joined by straight lines."""
    return replace(table, law=replace(table.law, between="linear"))


def same_lever(one: Table, other: Table) -> bool:
    if one.multiplier is None or other.multiplier is None:
        return one.multiplier is other.multiplier
    there = other.multiplier.at(one.multiplier.position_mm)
    alike = np.allclose(one.multiplier.value, there, rtol=0, atol=_LEVER)
    return one.multiplier.axis == other.multiplier.axis and bool(alike)


def plain_rows(table: Table) -> tuple[str, ...]:
    """Return the rows of the report, one for each point: number, position in mm, value in um."""
    rows = zip(table.position_mm, table.value_um, strict=True)
    return (
        f"{'point':>6} {'position mm':>14} {'value µm':>12}",
        *(
            f"{index:>6} {position:>14.4f} {fixed(value, 3):>12}"
            for index, (position, value) in enumerate(rows)
        ),
    )


def require_rising(position_mm: Vector, where: str) -> None:
    """Raise ``DataError`` unless there are two or more positions, each above the position
    before.
    """
    if len(position_mm) < 2 or np.any(np.diff(position_mm) <= 0.0):
        raise DataError(
            where,
            expected=message("two-rising"),
            found=message("not-all-rise", count=len(position_mm)),
        )


def zeroed(tables: Iterable[Table]) -> tuple[Table, ...]:
    """Return the tables with all values 0: the contents of a restore file if no table was active
    before.
    """
    return tuple(
        replace(
            table,
            value_um=np.zeros(table.value_um.shape),
            offset_um=0.0,
            multiplier=None
            if table.multiplier is None
            else replace(table.multiplier, value=np.zeros(table.multiplier.value.shape)),
        )
        for table in tables
    )
