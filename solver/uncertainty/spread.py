"""The variance of any combination of unknowns and random effects after the adjustment, by the
readings alone and by all causes.

``combination @ unknowns + on_causes @ amount`` has the variance ``K C K' + T M T'`` with K the
``combination`` and ``T = on_causes - K taken``. C is the covariance of the unknowns for known
random effects, M is the covariance of the random effects. M is an average over all likely standard
deviations of the random effects (law of total variance; `solver.linear.families`).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.linear.components import Sizes
from stepdiag.solver.linear.families import Family, families
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.linear.rows import Rows

_NONE = 1e-9
"""Variance (um^2, urad^2) below which a variance is treated as zero."""


@dataclass(frozen=True, eq=False)
class Spread:
    """A fit with random effects, the ``group`` (q,) of each random effect and the ``names`` of
    the groups."""

    fit: MixedFit
    group: NDArray[np.int64]
    names: tuple[str, ...]
    sizes: Sizes

    def causes_of(self, *names: str) -> NDArray[np.bool_]:
        """Return a mask, shape (q,), of the random effects in the named groups."""
        return np.array([name in names for name in self.names], dtype=np.bool_)[self.group]

    @cached_property
    def families(self) -> dict[int, Family]:
        """Return the family of every group with an estimated standard deviation, by the number
        of the group."""
        return families(self.fit, self.group, self.sizes)

    @cached_property
    def amount(self) -> Vector:
        """Return the covariance of the random effects, including the uncertainty of their
        standard deviations, shape (q, q)."""
        return sum(
            (family.surplus() for family in self.families.values()),
            self.fit.amount_covariance,
        )

    def moved(self, combination: Rows, on_causes: Vector | None = None) -> Vector:
        """Return T, the effect of the random effects on combinations of the unknowns (rows) and
        of the random effects (k, q), shape (k, q)."""
        taken: Vector = -combination.times(self.fit.causes.taken)
        return taken if on_causes is None else on_causes + taken

    def variance(self, moved: Vector) -> Vector:
        """Return the variance of each combination by the random effects, shape (k,)."""
        found: Vector = np.maximum(np.sum((moved @ self.amount) * moved, axis=1), 0.0)
        return found

    def variance_by_readings(self, moved: Vector) -> Vector:
        """Return the part of the variance of each combination that comes from the noise of the
        readings in the estimated random effects, shape (k,)."""
        by_shown = moved @ self.fit.amount_covariance
        found: Vector = np.sum((by_shown @ self.fit.causes.seen) * by_shown, axis=1)
        return np.maximum(found, 0.0)

    def shares(self, moved: Vector) -> dict[str, Vector]:
        """Return the standard uncertainty by each group of random effects, and the share by the
        unknown standard deviations, shapes (k,). If standard deviations below the estimates are
        more likely, all shares are reduced by a common factor."""
        size = np.where(self.fit.size > 0, self.fit.size, np.inf)
        each = (moved @ (self.fit.amount_covariance / size)) ** 2
        beside = np.maximum(self.variance(moved) - self.variance_by_readings(moved), 0.0)
        known = np.sum(each, axis=1)
        less = np.sqrt(np.minimum(1.0, beside / np.where(known > 0, known, 1.0)))
        # groups with the same name are added, for example all steps of the count
        found = {
            name: less * np.sqrt(np.sum(each[:, self.causes_of(name)], axis=1))
            for name in dict.fromkeys(self.names)
        }
        return {**found, SIZES_UNKNOWN: np.sqrt(np.maximum(beside - known, 0.0))}


SIZES_UNKNOWN = "sizes of these"
"""Name of the share by the unknown standard deviations of the random effects."""


def deviation(variance: Vector) -> Vector:
    """Return standard deviations; the rounding of a zero variance is set to zero."""
    found: Vector = np.sqrt(np.where(variance < _NONE, 0.0, variance))
    return found
