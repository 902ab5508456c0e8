"""The curves that a result requests, in the form of a table of one axis, of a product of two
tables, or of a control with one slope per pair of axes.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector, Volume, grid_points_mm
from stepdiag.exporters.tables.curves import (
    FOLD_DEFAULT,
    FOLD_OTHER,
    FUNCTIONS,
    SQUARENESS_SLOPE,
    Curve,
)
from stepdiag.exporters.tables.fit import fitted, straight_line_um_mm


class Wanted:
    """The curves that a result requests, with each squareness in either of its two functions."""

    def __init__(self, result: Result) -> None:
        self._result = result
        self._curves: dict[str, list[Curve]] = {name: [] for name in FUNCTIONS}
        for fold in (FOLD_DEFAULT, FOLD_OTHER):
            known = [name for name in FUNCTIONS if is_known(result, name, fold)]
            for curve in fitted(result, known, fold).curves:
                self._curves[curve.name].append(curve)

    def of(self, name: str) -> list[Curve]:
        """Return the forms of the request for a function, none if the result does not identify the
        function.

        The request for a product, such as ``EYX*Z``, is the part of the error that is proportional
        to the lever. A product whose lever is along its own axis is a curve.
        """
        if "*" not in name or name[2] == name[-1]:
            return self._curves[name[:3]]
        volume, angle = self._result.volume, self._result.errors.get(angle_of(name))
        at = volume.nodes_mm("XYZ".index(name[2]))
        grown = growing_um(lambda points: error_field_um(self._result, points), volume, name)
        u_um = 0.0 * at
        if angle is not None and angle.u is not None:
            lever_mm = volume.size_mm["XYZ".index(name[-1])] / 2.0
            u_um = np.interp(at, angle.position_mm, angle.u) * lever_mm / 1000.0
        return [Curve(name=name, position_mm=at, forward_um=grown, u_um=u_um, parts=())]

    def as_slope(self, name: str) -> list[Curve]:
        """Return the curves for a control with a common slope for both functions of a pair of axes.
        Each curve of ``name`` gets the slope of the second function of the pair in addition.
        """
        plain = [
            curve
            for curve in self.of(mirrored(name))
            if not any(part in SQUARENESS_SLOPE for part in curve.parts)
        ]
        slope = straight_line_um_mm(plain[0]) if plain else 0.0
        return [
            replace(
                curve,
                forward_um=curve.forward_um + slope * curve.position_mm,
                reverse_um=None,
            )
            for curve in self.of(name)
        ]


def mirrored(name: str) -> str:
    return f"E{name[2]}{name[1]}"


def angle_of(product: str) -> str:
    """Return the angular function of a product, such as EAX for ``EYX*Z``; empty if no angle moves
    the output axis with this lever.
    """
    turns = [
        turn for axis, turn in zip("XYZ", "ABC", strict=True) if axis not in product[1::3]
    ]
    return f"E{turns[0]}{product[2]}" if len(turns) == 1 else ""


def growing_um(field_um: Callable[[Vector], Vector], volume: Volume, name: str) -> Vector:
    """Return the part of a field that is proportional to the lever of a product such as ``EYX*Z``.
    The values are for the end of the lever, at the nodes of the input axis, without their mean.

    The mean of the lever is zero, so this part does not contain the curves of single axes.
    """
    output, moving, by = ("XYZ".index(letter) for letter in (name[1], name[2], name[4]))
    nodes = volume.increments + 1
    values = field_um(grid_points_mm(volume, nodes))[:, output].reshape(nodes, nodes, nodes)
    plane = np.mean(np.moveaxis(values, (moving, by), (0, 1)), axis=2)
    lever = np.linspace(-1.0, 1.0, nodes)
    return centred(plane @ lever) / np.sum(lever**2)


def centred(values: Vector) -> Vector:
    return np.asarray(values - np.mean(values))


def is_known(result: Result, name: str, fold: Mapping[str, str]) -> bool:
    """Return whether a result identifies a function, and the squareness that ``fold`` assigns to
    it.
    """
    squares = (square for square, target in fold.items() if target == name)
    return result.knows(name) and all(map(result.knows, squares))
