"""The curves requested by a result, in the form of a table of an axis, or of a control with a slope
per pair.
"""

from collections.abc import Mapping
from dataclasses import replace

from stepdiag.base.result.result import Result
from stepdiag.exporters.tables.curves import (
    FOLD_DEFAULT,
    FOLD_OTHER,
    FUNCTIONS,
    SQUARENESS_SLOPE,
    Curve,
)
from stepdiag.exporters.tables.fit import fitted, straight_line_um_mm


class Wanted:
    """The curves requested by the result, each squareness in either of its two functions."""

    def __init__(self, result: Result) -> None:
        self._curves: dict[str, list[Curve]] = {name: [] for name in FUNCTIONS}
        for fold in (FOLD_DEFAULT, FOLD_OTHER):
            known = [name for name in FUNCTIONS if is_known(result, name, fold)]
            for curve in fitted(result, known, fold).curves:
                self._curves[curve.name].append(curve)

    def of(self, name: str) -> list[Curve]:
        return self._curves.get(name, [])

    def as_slope(self, name: str) -> list[Curve]:
        """Return the curves for a control with a common slope for both functions of a pair of axes:
        the slope of the other function is added.
        """
        plain = [
            curve
            for curve in self.of(f"E{name[2]}{name[1]}")
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


def is_known(result: Result, name: str, fold: Mapping[str, str]) -> bool:
    """Return whether a result identifies a function with the squareness that ``fold`` puts into
    it.
    """
    squares = (square for square, target in fold.items() if target == name)
    return result.knows(name) and all(map(result.knows, squares))
