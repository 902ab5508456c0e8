"""A least-squares fit with random effects ("causes"), of which only the usual standard deviation
("size") is known (Searle, Casella, McCulloch 1992, 7.4-7.6).

    target = rows @ unknowns + pattern @ amount + noise
    amount ~ normal(0, size^2), noise ~ normal(0, 1 / weight)

The rows are sparse. The matrices of the random effects are small, so the fit with other standard
deviations takes milliseconds.
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
"""Largest number of rows of a triangular matrix that is inverted at once."""


@dataclass(frozen=True, eq=False)
class Causes:
    """The random effects after the fit of the fixed unknowns: ``pattern`` (m, q) is the effect of
    one unit of each random effect on the target.

    ``taken`` (count, q) is the effect of the pattern on the fixed unknowns. ``left`` (m, q) is the
    weighted residual of the pattern; ``scaled`` (m, q) is its residual times the root of the
    weight. ``seen`` (q, q) = scaled.T @ scaled. ``shown`` (q,) = scaled.T @ scaled residual of the
    target. The products are computed from residuals, because products of residuals have small
    rounding errors.
    """

    pattern: Vector
    taken: Vector
    left: Vector
    scaled: Vector
    seen: Vector
    shown: Vector

    @classmethod
    def of(cls, fit: Fit, pattern: Vector) -> "Causes":
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
    """A fit without random effects (``fixed``), and its change by random effects with the
    standard deviations ``size`` (q,)."""

    fixed: Fit
    causes: Causes
    size: Vector

    @property
    def rows(self) -> Rows:
        return self.fixed.rows

    @property
    def weight(self) -> Vector:
        return self.fixed.weight

    @property
    def inverse(self) -> Inverse:
        return self.fixed.inverse

    @cached_property
    def damped_root(self) -> Vector:
        """Return a factor of the inverse of D = 1 + size seen size, shape (q, q): inverse =
        root.T @ root. Eigenvalues of D below one are rounding errors and are replaced by one."""
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
        """Return a factor of the covariance of the random effects, shape (q, q): covariance =
        root.T @ root."""
        factor: Vector = self.damped_root * self.size
        return factor

    @cached_property
    def amount_covariance(self) -> Vector:
        matrix: Vector = self.root.T @ self.root
        return matrix

    @cached_property
    def amount(self) -> Vector:
        """Return the most likely amount of every random effect, shape (q,)."""
        found: Vector = self.root.T @ (self.root @ self.causes.shown)
        return found

    @cached_property
    def unknowns(self) -> Vector:
        found: Vector = self.fixed.unknowns - self.causes.taken @ self.amount
        return found

    @cached_property
    def residual(self) -> Vector:
        """Return target - rows @ unknowns - pattern @ amount, shape (m,)."""
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
        """Return the part of each row's weighted residual that the random effects explain, in
        independent combinations, shape (m, q)."""
        found: Vector = self.causes.left @ self.root.T
        return found

    @cached_property
    def redundancy(self) -> Vector:
        """Return the redundancy of each row, shape (m,): the share of the row's own noise in its
        residual."""
        return self._redundancy(np.arange(len(self.weight)), self.taken_over)

    def redundancy_of(self, rows: NDArray[np.int64]) -> Vector:
        return self._redundancy(rows, self.causes.left[rows] @ self.root.T)

    def _redundancy(self, rows: NDArray[np.int64], taken_over: Vector) -> Vector:
        spent = np.einsum("ij,ij->i", taken_over, taken_over)
        share = self.fixed.redundancy[rows] - spent / np.where(
            self.weight[rows] > 0, self.weight[rows], np.inf
        )
        clipped: Vector = np.clip(share, 0.0, 1.0)
        return clipped

    def for_target(self, target: Vector) -> "MixedFit":
        """Return the fit of another target (m,) with the same weights and standard deviations."""
        fixed = refit(self.rows, target, self.weight, self.inverse)
        shown = self.causes.scaled.T @ (np.sqrt(fixed.weight) * fixed.residual)
        return MixedFit(fixed, replace(self.causes, shown=shown), self.size)

    def of_rows(self, kept: NDArray[np.bool_]) -> "MixedFit":
        """Return the fit of the rows marked in ``kept`` (m,), with the same standard deviations."""
        weight = np.where(kept, self.weight, 0.0)
        fixed = fit(self.rows, self.fixed.packed.blocks, self.fixed.target, weight)
        return MixedFit(fixed, Causes.of(fixed, self.causes.pattern), self.size)

    @property
    def freedom(self) -> int:
        return self.fixed.freedom

    @cached_property
    def chi_square(self) -> float:
        """Return the square sum of the residuals, weighted by the covariance of noise and random
        effects."""
        return float(self.fixed.chi_square - self.causes.shown @ self.amount)


def _inverse_of_lower(lower: Vector) -> Vector:
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
