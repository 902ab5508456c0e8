"""Neutral curves e(p) from a result: the error of an output axis as a function of the position of
an input axis.

A curve is the error of the machine, in the + direction of the output axis, before any sense, unit
or differencing of a controller: ``e = actual - commanded`` (contract 1). Nine curves describe a
three-axis machine without its angular errors: three positioning errors and six straightness errors.
Each squareness is a single number for two axes; as a displacement it is included in the
straightness of exactly one axis of the pair.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.result.result import POSITIONING, Function, Result
from stepdiag.base.volume import Vector

STRAIGHTNESS = ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ")
FUNCTIONS = POSITIONING + STRAIGHTNESS
"""The nine functions that a table with an input and an output axis can correct."""
SIGNIFICANT = 3.0
"""Number of standard uncertainties above which a reversal is significant. A reversal by chance does
not exceed this number at any of some ten positions.
"""

SQUARENESS_SLOPE: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "C0Y": MappingProxyType({"EXY": -1.0, "EYX": -1.0}),
        "B0Z": MappingProxyType({"EXZ": +1.0, "EZX": +1.0}),
        "A0Z": MappingProxyType({"EYZ": -1.0, "EZY": -1.0}),
    }
)
"""Slope of the straightness curve for one unit of squareness. The first value of each pair is the
displacement by the squareness (dX = -C0Y y, dX = +B0Z z, dY = -A0Z z), the second value the
displacement after a rigid rotation of the workpiece.
"""

FOLD_DEFAULT: Mapping[str, str] = MappingProxyType({"C0Y": "EXY", "B0Z": "EXZ", "A0Z": "EYZ"})
FOLD_OTHER: Mapping[str, str] = MappingProxyType({"C0Y": "EYX", "B0Z": "EZX", "A0Z": "EZY"})
"""The function that contains each squareness by default, and the alternative function of the same
pair of axes.
"""

KEPT = "the table in the control"
"""Name of the part of a curve that comes from an old table. The function of this table was not
requested, so the part is written again unchanged.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """The error of an output axis along an input axis. ``name`` contains both axes (``EYX``: Y
    error along X).

    ``forward_um`` belongs to travel in the + direction of the input axis, ``reverse_um`` to the -
    direction (None if the measurement does not separate the directions). ``u_um`` is the standard
    uncertainty, NaN where unknown. ``parts`` contains the names of the summands of the curve.
    ``slope_known`` is False if only the shape was identified and the end-point line is missing.
    """

    name: str
    position_mm: Vector
    forward_um: Vector
    reverse_um: Vector | None = None
    u_um: Vector
    parts: tuple[str, ...]
    slope_known: bool = True

    @property
    def output_axis(self) -> str:
        return self.name[1]

    @property
    def input_axis(self) -> str:
        return self.name[2]

    @property
    def mean_um(self) -> Vector:
        """Return the error in um as the mean of both directions, shape of ``position_mm``."""
        return (
            self.forward_um
            if self.reverse_um is None
            else (self.forward_um + self.reverse_um) / 2
        )

    def at(self, position_mm: Vector, direction: int = 0) -> Vector:
        """Return the error in um at positions: linear between the nodes, and the value of the end
        node outside.

        ``direction`` is +1 or -1 for the travel of the input axis, 0 for the mean of both.
        """
        return np.interp(position_mm, self.position_mm, self.toward(direction))

    def toward(self, direction: int) -> Vector:
        if self.reverse_um is None:
            return self.forward_um
        return (self.mean_um, self.forward_um, self.reverse_um)[direction]


def curves_of(
    result: Result, names: Sequence[str] = FUNCTIONS, fold: Mapping[str, str] = FOLD_DEFAULT
) -> tuple[Curve, ...]:
    """Return the curves with the names ``names``. Each squareness is added to the straightness
    curve in ``fold``.

    Raises ``DataError`` for a function or squareness that the result does not identify. Raises
    ``UsageError`` for a name that is no function of a three-axis machine, or if ``fold`` contains a
    function of another pair of axes.
    """
    if len(set(names)) != len(names):
        raise UsageError(
            "functions", expected=message("function-once"), found=", ".join(names)
        )
    slopes = _folded_slopes(result, names, fold)
    return tuple(_curve(result, name, slopes.get(name, {})) for name in names)


def _folded_slopes(
    result: Result, names: Sequence[str], fold: Mapping[str, str]
) -> dict[str, dict[str, float]]:
    slopes: dict[str, dict[str, float]] = {}
    for squareness, target in fold.items():
        pair = SQUARENESS_SLOPE.get(squareness, {})
        if target not in pair:
            raise UsageError(
                f"squareness_into.{squareness}",
                expected=message("or-list", items=list(pair))
                if pair
                else message("a-squareness"),
                found=repr(target),
            )
        if target in names:
            slopes.setdefault(target, {})[squareness] = (
                pair[target] * _squareness_urad(result, squareness) / 1000.0
            )
    return slopes


def _squareness_urad(result: Result, name: str) -> float:
    quantity = result.squareness.get(name)
    if quantity is None or quantity.value is None:
        raise DataError(
            f"{result.source}: squareness.{name}",
            expected=message("known-squareness"),
            found="null",
            remedy=message("four-or-out"),
        )
    return float(quantity.value)


def _curve(result: Result, name: str, slopes: Mapping[str, float]) -> Curve:
    if name not in FUNCTIONS:
        raise UsageError(
            "functions", expected=message("one-of", names=FUNCTIONS), found=repr(name)
        )
    function = result.errors.get(name)
    if function is None or function.value is None:
        raise DataError(
            f"{result.source}: errors.{name}",
            expected=message("known-function"),
            found="null",
            remedy=message("not-identified", name=name),
        )
    position = function.position_mm
    mean = function.value + sum(slopes.values()) * (position - position[0])
    half = _half_reversal(result, name, position)
    return Curve(
        name=name,
        position_mm=position,
        forward_um=mean if half is None else mean + half,
        reverse_um=None if half is None else mean - half,
        u_um=np.full(position.shape, np.nan) if function.u is None else function.u,
        parts=(name, *slopes),
        slope_known=function.slope_identified,
    )


def _significant(name: str, reversal: Function) -> bool:
    """Return whether a reversal is significant at any position. The reversal of a positioning
    function must also be known at the first position.

    If the passes have no common zero, the reversal of a positioning function is known only relative
    to its first position (u = 0 there). The constant part of the reversal is then unknown, and
    tables for each direction would leave it uncorrected, because the backlash parameter is zero
    with such tables.
    """
    if reversal.u is None or reversal.value is None:
        return reversal.value is not None
    if name in POSITIONING and not reversal.u[0] > 0.0:
        return False
    measured = reversal.u > 0.0
    return bool(np.any(np.abs(reversal.value[measured]) > SIGNIFICANT * reversal.u[measured]))


def _half_reversal(result: Result, name: str, position_mm: Vector) -> Vector | None:
    reversal = result.reversal.get(name)
    if reversal is None or reversal.value is None or not _significant(name, reversal):
        return None
    return np.interp(position_mm, reversal.position_mm, reversal.value) / 2
