"""One weighted least-squares fit: unknowns, residuals, leverages."""

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
    """``unknowns`` (count,) minimise sum weight * (target - rows @ unknowns)^2; weight = 1/u^2, 0
    where a row is left out."""

    rows: Rows
    weight: Vector
    inverse: Inverse
    unknowns: Vector
    residual: Vector

    @cached_property
    def redundancy(self) -> Vector:
        """Return for each row the share of its own error in its residual, shape (m,), from 0 (not
        checked) to 1.

        A row of weight 0 is predicted by the others entirely: 1.
        """
        return np.clip(1.0 - self.weight * self.inverse.squares(), 0.0, 1.0)

    def redundancy_of(self, rows: NDArray[np.int64]) -> Vector:
        """Return the same share for some rows, shape (rows,)."""
        some: Vector = self.redundancy[rows]
        return some

    @property
    def target(self) -> Vector:
        """Return the fitted values, shape (m,)."""
        return self.residual + self.rows.times(self.unknowns)

    @property
    def packed(self) -> Packed:
        """Return the rows in pieces, for products with many columns."""
        return self.inverse.packed

    @property
    def freedom(self) -> int:
        """Return the degrees of freedom."""
        return int(np.count_nonzero(self.weight)) - self.inverse.rank

    @property
    def chi_square(self) -> float:
        """Return the weighted sum of squared residuals."""
        return float(np.sum(self.weight * self.residual**2))


def fit(
    rows: Rows, blocks: Blocks, target: Vector, weight: Vector, like: Inverse | None = None
) -> Fit:
    """Fit the unknowns; one step of iterative refinement restores the precision lost by squaring
    the rows.

    ``like`` is used as in `solver.linear.least_squares.invert`.
    """
    inverse = invert(rows, weight, blocks, like)
    return refit(rows, target, weight, inverse)


def refit(rows: Rows, target: Vector, weight: Vector, inverse: Inverse) -> Fit:
    """Fit another target with the inverse of the same rows and weights."""
    unknowns = inverse.solve(rows.transposed_times(weight * target))
    unknowns = unknowns + inverse.solve(
        rows.transposed_times(weight * (target - rows.times(unknowns)))
    )
    return Fit(rows, weight, inverse, unknowns, target - rows.times(unknowns))
