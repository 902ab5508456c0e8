"""Reference lines of a straightness measurement and the deviations from them (ISO 230-1;
theory.md 8.6)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message

Vector = NDArray[np.float64]
LineMethod = Literal["end-point", "least-squares", "minimum-zone"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A reference line with the offset in um and the slope in urad."""

    offset_um: float
    slope_urad: float

    def at(self, position_mm: ArrayLike) -> Vector:
        """Return the height of the line in um, shape like ``position_mm``."""
        height: Vector = self.offset_um + 1e-3 * self.slope_urad * np.asarray(
            position_mm, dtype=np.float64
        )
        return height


def end_point_line(position_mm: Vector, deviation_um: Vector) -> Line:
    """Return the line through the mean deviations at the lowest and the highest position."""
    low, high = position_mm.min(), position_mm.max()
    at_low, at_high = (
        deviation_um[position_mm == low].mean(),
        deviation_um[position_mm == high].mean(),
    )
    return _through(low, float(at_low), 1e3 * (at_high - at_low) / (high - low))


def least_squares_line(position_mm: Vector, deviation_um: Vector) -> Line:
    centre = position_mm.mean()
    arm = position_mm - centre
    return _through(
        centre, float(deviation_um.mean()), 1e3 * float(arm @ deviation_um) / float(arm @ arm)
    )


def minimum_zone_line(position_mm: Vector, deviation_um: Vector) -> Line:
    """Return the middle line of the narrowest strip that contains all deviations.

    The strip touches an edge of the convex hull, so a search over the slopes of all edges is exact.
    """
    slopes_urad = _hull_slopes_urad(position_mm, deviation_um)
    heights = deviation_um - 1e-3 * slopes_urad[:, None] * position_mm
    tops, bottoms = heights.max(axis=1), heights.min(axis=1)
    best = int(np.argmin(tops - bottoms))
    return _through(0.0, float(tops[best] + bottoms[best]) / 2, float(slopes_urad[best]))


_METHODS: dict[LineMethod, Callable[[Vector, Vector], Line]] = {
    "end-point": end_point_line,
    "least-squares": least_squares_line,
    "minimum-zone": minimum_zone_line,
}


def reference_line(
    position_mm: ArrayLike, deviation_um: ArrayLike, method: LineMethod = "end-point"
) -> Line:
    """Return the reference line by a method; positions may have any order and may repeat.

    Raises DataError if all positions are equal or a value is not a number.
    """
    position = np.asarray(position_mm, dtype=np.float64)
    deviation = np.asarray(deviation_um, dtype=np.float64)
    if not (np.isfinite(position).all() and np.isfinite(deviation).all()):
        raise DataError(
            "straightness",
            expected=message("number-at-every-stop"),
            found=message("stop-lacks-reading"),
        )
    if len(position) < 2 or np.ptp(position) == 0.0:
        raise DataError(
            "straightness",
            expected=message("stops-at-two-positions"),
            found=f"{len(np.unique(position))}",
        )
    return _METHODS[method](position, deviation)


def residuals_um(
    position_mm: ArrayLike, deviation_um: ArrayLike, method: LineMethod = "end-point"
) -> Vector:
    """Return the deviations from the reference line, shape (N,)."""
    line = reference_line(position_mm, deviation_um, method)
    residuals: Vector = np.asarray(deviation_um, dtype=np.float64) - line.at(position_mm)
    return residuals


def straightness_um(
    position_mm: ArrayLike, deviation_um: ArrayLike, method: LineMethod = "end-point"
) -> float:
    """Return the range of the deviations from the reference line."""
    return float(np.ptp(residuals_um(position_mm, deviation_um, method)))


def _through(position_mm: float, height_um: float, slope_urad: float) -> Line:
    return Line(
        offset_um=float(height_um - 1e-3 * slope_urad * position_mm),
        slope_urad=float(slope_urad),
    )


def _hull_slopes_urad(position: Vector, deviation: Vector) -> Vector:
    """Return the slope of every edge of the upper and the lower convex hull (Andrew's monotone
    chain)."""
    places = np.unique(position)
    order = np.argsort(position, kind="stable")
    starts = np.searchsorted(position[order], places)
    highest = np.maximum.reduceat(deviation[order], starts)
    lowest = np.minimum.reduceat(deviation[order], starts)
    edges = [
        *_upper_hull(places, highest),
        *((x, -y) for x, y in _upper_hull(places, -lowest)),
    ]
    x, y = np.array(edges).T
    run, rise = np.diff(x), np.diff(y)
    slopes: Vector = 1e3 * rise[run > 0] / run[run > 0]
    return slopes


def _upper_hull(x: Vector, y: Vector) -> list[tuple[float, float]]:
    hull: list[tuple[float, float]] = []
    for point in zip(x.tolist(), y.tolist(), strict=True):
        while len(hull) >= 2 and _turns_left(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    return hull


def _turns_left(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]
) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) >= 0
