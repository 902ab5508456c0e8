from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.linear.elimination import Blocks
from stepdiag.solver.linear.least_squares import Inverse, invert
from stepdiag.solver.linear.packed import Packed
from stepdiag.solver.linear.rows import Rows


@dataclass(frozen=True, eq=False)
class Fit:
    """A weighted least-squares fit: ``unknowns`` (count,) minimise sum weight * (target - rows @
    unknowns)^2; weight = 1/u^2, or 0 for an omitted row."""

    rows: Rows
    weight: Vector
    inverse: Inverse
    unknowns: Vector
    residual: Vector

    @cached_property
    def redundancy(self) -> Vector:
        """Return the redundancy of each row, shape (m,): the share of the row's own error that
        appears in its residual, from 0 (not checked) to 1."""
        return np.clip(1.0 - self.weight * self.inverse.squares(), 0.0, 1.0)

    def redundancy_of(self, rows: NDArray[np.int64]) -> Vector:
        some: Vector = self.redundancy[rows]
        return some

    @property
    def target(self) -> Vector:
        return self.residual + self.rows.times(self.unknowns)

    @property
    def packed(self) -> Packed:
        return self.inverse.packed

    @property
    def freedom(self) -> int:
        return int(np.count_nonzero(self.weight)) - self.inverse.rank

    @property
    def chi_square(self) -> float:
        return float(np.sum(self.weight * self.residual**2))


def fit(
    rows: Rows, blocks: Blocks, target: Vector, weight: Vector, like: Inverse | None = None
) -> Fit:
    """Return the weighted least-squares fit. One step of iterative refinement restores the
    precision that the normal matrix loses.

    ``like`` is described in `solver.linear.least_squares.invert`.
    """
    inverse = invert(rows, weight, blocks, like)
    return refit(rows, target, weight, inverse)


def refit(rows: Rows, target: Vector, weight: Vector, inverse: Inverse) -> Fit:
    unknowns = inverse.solve(rows.transposed_times(weight * target))
    unknowns = unknowns + inverse.solve(
        rows.transposed_times(weight * (target - rows.times(unknowns)))
    )
    return Fit(rows, weight, inverse, unknowns, target - rows.times(unknowns))
