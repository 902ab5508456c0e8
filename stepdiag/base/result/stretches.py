"""Stretches of an axis in which tables reduce or increase the error, by the draws of the whole
volume."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.names import AXES
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.prediction import interval_of, squares_um2
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector, Volume

MOST_CELLS, MOST_STRETCHES = 10, 10
FEWEST = 8
"""Smallest number of points in a cell from which the mean square of the error is computed."""
CLEARLY, LEAST_UM = 1.02, 0.1
"""Smallest increase of the error after compensation, as a factor and in um, that counts as harm:
the rounding of tables causes smaller increases."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """A stretch of an axis, for all positions of the other axes, with the length of the error
    vector in the stretch (rms, rigid motion removed, um) without and with the tables."""

    axis: str
    low_mm: float
    high_mm: float
    before: Interval
    after: Interval

    @property
    def times(self) -> float:
        """Return the error with the tables divided by the error without tables."""
        return self.after.value_um / max(self.before.value_um, 1e-9)


def harmed(
    result: Result, points_mm: Vector, correction_um: Vector, beside_um: Vector | float = 0.0
) -> list[Stretch]:
    """Return the stretches in which a correction (N, 3) increases the predicted error and the upper
    end of its interval.

    Arguments as in `solver.result.prediction.predicted`. Neighbouring cells form one stretch. The
    worst stretch comes first; its points are left out of the stretches of other axes.
    """
    before, after = squares_um2(result, points_mm, correction_um, beside_um)
    open_points = np.ones(len(points_mm), dtype=np.bool_)
    found: list[Stretch] = []
    while len(found) < MOST_STRETCHES:
        worst = max(
            _candidates(result.volume, points_mm, before, after, open_points),
            key=lambda one: one[0].times,
            default=None,
        )
        if worst is None:
            break
        found.append(worst[0])
        open_points &= ~worst[1]
    return found


def _candidates(
    volume: Volume, points_mm: Vector, before: Vector, after: Vector, among: NDArray[np.bool_]
) -> Iterator[tuple[Stretch, NDArray[np.bool_]]]:
    for axis, letter in enumerate(AXES):
        cells = min(volume.increments, MOST_CELLS)
        edges = volume.origin_mm[axis] + volume.size_mm[axis] * np.arange(cells + 1) / cells
        cell = np.where(
            among,
            np.clip(
                np.searchsorted(edges, points_mm[:, axis], side="right") - 1, 0, cells - 1
            ),
            -1,
        )
        worse = [
            int(np.sum(cell == one)) >= FEWEST
            and _worse(_of(before, cell == one), _of(after, cell == one))
            for one in range(cells)
        ]
        for first, last in _runs(worse):
            mine = (cell >= first) & (cell <= last)
            low_mm, high_mm = float(edges[first]), float(edges[last + 1])
            yield (
                Stretch(
                    axis=letter.upper(),
                    low_mm=low_mm,
                    high_mm=high_mm,
                    before=_of(before, mine),
                    after=_of(after, mine),
                ),
                mine,
            )


def _of(square: Vector, mine: NDArray[np.bool_]) -> Interval:
    return interval_of(np.sqrt(np.mean(square[:, mine], axis=1)), known=len(square) > 1)


def _worse(before: Interval, after: Interval) -> bool:
    reaches = (
        before.high_um is None or after.high_um is None or after.high_um > before.high_um
    )
    return reaches and after.value_um > CLEARLY * before.value_um + LEAST_UM


def _runs(flags: list[bool]) -> list[tuple[int, int]]:
    runs: list[tuple[int, int]] = []
    for place in (number for number, flag in enumerate(flags) if flag):
        if runs and runs[-1][1] == place - 1:
            runs[-1] = (runs[-1][0], place)
        else:
            runs.append((place, place))
    return runs
