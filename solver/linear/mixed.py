"""A least-squares fit with random effects: causes of which only the usual size is known (Searle,
Casella, McCulloch 1992, 7.4-7.6).

    target = rows @ unknowns + pattern @ amount + noise,    amount ~ normal(0, size^2),    noise ~
    normal(0, 1 / weight)

The rows stay as sparse as before; all quantities of the amounts are matrices of (causes, causes),
so that sizes are tried in milliseconds.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.linear.fit import Fit, fit, refit
from stepdiag.solver.linear.least_squares import Inverse
from stepdiag.solver.linear.rows import Rows

_SMALL = 48
"""Number of rows of a triangle inverted at once."""


@dataclass(frozen=True, eq=False)
class Causes:
    """The residue of every cause after the fit of the fixed unknowns: ``pattern`` (m, q) is the
    effect of a unit on the targets.

    ``taken`` (count, q): its image in the unknowns by the fit without causes; ``left`` (m, q):
    weighted residual of the pattern; ``scaled`` (m, q): its residual times the root of the weight;
    ``seen`` (q, q) = scaled.T @ scaled; ``shown`` (q,) = scaled.T @ scaled residual of the targets.
    They are products of residuals: the part of a pattern that the unknowns explain is removed
    first, and leaves no large rounding error.
    """

    pattern: Vector
    taken: Vector
    left: Vector
    scaled: Vector
    seen: Vector
    shown: Vector

    @classmethod
    def of(cls, fit: Fit, pattern: Vector) -> "Causes":
        """Return the residue of the patterns after a fit."""
        taken = fit.inverse.solve(fit.packed.transposed_times(pattern, fit.weight))
        scaled = fit.packed.times(taken)
        np.subtract(pattern, scaled, out=scaled)
        root = np.sqrt(fit.weight)
        scaled *= root[:, None]
        return cls(
            pattern,
            taken,
            scaled * root[:, None],
            scaled,
            scaled.T @ scaled,
            scaled.T @ (root * fit.residual),
        )


@dataclass(frozen=True, eq=False)
class MixedFit:
    """A fit without causes (``fixed``) and its change when each cause may have its ``size``
    (q,).
    """

    fixed: Fit
    causes: Causes
    size: Vector

    @property
    def rows(self) -> Rows:
        """Return the rows of the fixed unknowns."""
        return self.fixed.rows

    @property
    def weight(self) -> Vector:
        """Return the weights of the rows."""
        return self.fixed.weight

    @property
    def inverse(self) -> Inverse:
        """Return the generalised inverse for the fixed unknowns with known causes."""
        return self.fixed.inverse

    @cached_property
    def damped_root(self) -> Vector:
        """Return a factor of the inverse of D = 1 + size seen size: inverse = root.T @ root, shape
        (q, q).

        No eigenvalue of D is below one: if the noise is next to nothing, rounding must not create a
        smaller value.
        """
        damped = np.eye(len(self.size)) + self.size[:, None] * self.causes.seen * self.size
        try:
            root = _inverse_of_lower(
                np.linalg.cholesky(damped).astype(np.float64, copy=False)
            )
        except np.linalg.LinAlgError:
            value, vector = np.linalg.eigh(damped)
            root = (vector / np.sqrt(np.maximum(value, 1.0))).T
        return root

    @cached_property
    def root(self) -> Vector:
        """Return a factor of the covariance of the amounts: root.T @ root, shape (q, q)."""
        factor: Vector = self.damped_root * self.size
        return factor

    @cached_property
    def amount_covariance(self) -> Vector:
        """Return the covariance of the amounts given the readings, shape (q, q)."""
        matrix: Vector = self.root.T @ self.root
        return matrix

    @cached_property
    def amount(self) -> Vector:
        """Return the most likely amount of every cause, given the readings, shape (q,)."""
        found: Vector = self.root.T @ (self.root @ self.causes.shown)
        return found

    @cached_property
    def unknowns(self) -> Vector:
        """Return the fixed unknowns, shape (count,)."""
        found: Vector = self.fixed.unknowns - self.causes.taken @ self.amount
        return found

    @cached_property
    def residual(self) -> Vector:
        """Return target - rows @ unknowns - pattern @ amount, the noise, shape (m,)."""
        used = self.weight > 0
        left: Vector = self.fixed.residual - np.where(
            used,
            (self.causes.left @ self.amount) / np.where(used, self.weight, np.nan),
            self.causes.pattern @ self.amount
            - self.rows.times(self.causes.taken @ self.amount),
        )
        return left

    @cached_property
    def taken_over(self) -> Vector:
        """Return the part of each row's weighted residual explained by independent combinations of
        the causes, shape (m, q).
        """
        found: Vector = self.causes.left @ self.root.T
        return found

    @cached_property
    def redundancy(self) -> Vector:
        """Return for each row the share of its own noise in its residual, shape (m,), 1 for a
        weight of 0.
        """
        return self._redundancy(np.arange(len(self.weight)), self.taken_over)

    def redundancy_of(self, rows: NDArray[np.int64]) -> Vector:
        """Return the same share for some rows, shape (rows,), without computing all."""
        return self._redundancy(rows, self.causes.left[rows] @ self.root.T)

    def _redundancy(self, rows: NDArray[np.int64], taken_over: Vector) -> Vector:
        spent = np.einsum("ij,ij->i", taken_over, taken_over)
        share = self.fixed.redundancy[rows] - spent / np.where(
            self.weight[rows] > 0, self.weight[rows], np.inf
        )
        clipped: Vector = np.clip(share, 0.0, 1.0)
        return clipped

    def for_target(self, target: Vector) -> "MixedFit":
        """Return the fit of another target (m,), with the same weights and sizes."""
        fixed = refit(self.rows, target, self.weight, self.inverse)
        shown = self.causes.scaled.T @ (np.sqrt(fixed.weight) * fixed.residual)
        return MixedFit(fixed, replace(self.causes, shown=shown), self.size)

    def of_rows(self, kept: NDArray[np.bool_]) -> "MixedFit":
        """Return the fit of some rows alone, ``kept`` (m,), with the same sizes."""
        weight = np.where(kept, self.weight, 0.0)
        fixed = fit(self.rows, self.fixed.packed.blocks, self.fixed.target, weight)
        return MixedFit(fixed, Causes.of(fixed, self.causes.pattern), self.size)

    @property
    def freedom(self) -> int:
        """Return the degrees of freedom of the fixed unknowns."""
        return self.fixed.freedom

    @cached_property
    def chi_square(self) -> float:
        """Return the square sum of the residuals, weighted with noise and causes together."""
        return float(self.fixed.chi_square - self.causes.shown @ self.amount)


def _inverse_of_lower(lower: Vector) -> Vector:
    """Return the inverse of a lower triangular matrix, half by half: nearly all of the work is
    products of matrices.
    """
    size = len(lower)
    if size <= _SMALL:
        small: Vector = np.linalg.inv(lower).astype(np.float64, copy=False)
        return small
    half = size // 2
    inverse = np.zeros((size, size))
    inverse[:half, :half] = first = _inverse_of_lower(lower[:half, :half])
    inverse[half:, half:] = second = _inverse_of_lower(lower[half:, half:])
    inverse[half:, :half] = -second @ lower[half:, :half] @ first
    return inverse


AnyFit = Fit | MixedFit
"""A fit with residuals, weights and redundancies."""
