"""The posterior distribution of the standard deviation of a group of random effects ("causes").

With the standard deviations of all other groups fixed at their estimates, the effects of a group
separate into independent directions:

    variance = f^2 / (1 + f^2 seen), amount = variance * shown,
    f = standard deviation / estimated standard deviation

Therefore one eigenvalue decomposition is enough for all f (likelihood: Harville 1974; Searle,
Casella, McCulloch 1992, 9.2).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.linear.components import FURTHEST, Sizes, log_prior
from stepdiag.solver.linear.mixed import MixedFit

POINTS = 15
"""Number of equally likely values that represent a distribution."""
CLASS_SPREAD = 0.6
"""Standard deviation of the logarithm of a machine's errors relative to the usual errors of its
class: for 95 % of machines the ratio is between 1/3 and 3 (docs/uncertainty.md)."""
ABSENT, NEXT_TO_NONE, WAVES_SPREAD = 0.25, 0.04, (0.3, 2.0)
"""The share of machines without waves between the targets, the relative size of the waves in
these machines, and the range of the relative size in all other machines (ball screws with waves
of 0.5 to 3 um)."""
_FINE = 281


@dataclass(frozen=True, eq=False)
class Family:
    """A group of random effects in its independent directions: ``direction`` (q, k) is the
    change of all random effects for one unit along each direction. ``seen`` and ``shown`` (k,)
    are defined by the module's equation. ``factor`` (points,) are equally likely values of f."""

    direction: Vector
    seen: Vector
    shown: Vector
    factor: Vector

    def variance(self, factor: Vector) -> Vector:
        square = factor[:, None] ** 2
        found: Vector = square / (1.0 + square * self.seen)
        return found

    def shift(self) -> Vector:
        found: Vector = (self.variance(self.factor) - self.variance(np.ones(1))) * self.shown
        return found

    def surplus(self) -> Vector:
        """Return the covariance of all random effects averaged over ``factor``, minus the
        covariance at the estimated standard deviation, shape (q, q)."""
        over_all = np.mean(self.variance(self.factor), axis=0)
        beside = np.diag(over_all - self.variance(np.ones(1))[0])
        moved = self.shift()
        own = beside + moved.T @ moved / len(moved)
        matrix: Vector = self.direction @ own @ self.direction.T
        return matrix

    def alone(self) -> Vector:
        """Return the group's part of the covariance of all random effects at the estimated
        standard deviation, shape (q, q)."""
        matrix: Vector = (self.direction * self.variance(np.ones(1))[0]) @ self.direction.T
        return matrix


def family_of(fit: MixedFit, mine: NDArray[np.bool_], log_found: float) -> Family:
    """Return the `Family` of the group of random effects that ``mine`` (q,) marks. The estimated
    standard deviation of the group is ``exp(log_found)`` times the usual value."""
    seen, shown, size = fit.causes.seen, fit.causes.shown, fit.size
    others = np.flatnonzero(~mine)
    own = np.flatnonzero(mine)
    own_size, other_size = size[own], size[others]
    seen_by_others = other_size[:, None] * seen[np.ix_(others, others)] * other_size
    damped = np.eye(len(others)) + seen_by_others
    across = seen[np.ix_(others, own)] * own_size
    asked = other_size[:, None] * np.column_stack([across, shown[others]])
    adapting = other_size[:, None] * np.linalg.solve(damped, asked)
    to_own, to_readings = adapting[:, :-1], adapting[:, -1]
    seen_by_own = own_size[:, None] * seen[np.ix_(own, own)] * own_size
    matrix = seen_by_own - across.T @ to_own
    value, vector = np.linalg.eigh(0.5 * (matrix + matrix.T))
    direction = np.zeros((len(size), len(own)))
    direction[own] = own_size[:, None] * vector
    direction[others] = -to_own @ vector
    known = np.maximum(value, 0.0)
    shown_by_own = own_size * shown[own]
    response = vector.T @ (shown_by_own - across.T @ to_readings)
    return Family(direction, known, response, _points(known, response, log_found))


def _points(seen: Vector, shown: Vector, log_found: float) -> Vector:
    found: Vector = _sizes_at((np.arange(POINTS) + 0.5) / POINTS, seen, shown, log_found)
    return found


def _sizes_at(probability: Vector, seen: Vector, shown: Vector, log_found: float) -> Vector:
    log = np.linspace(-FURTHEST, FURTHEST, _FINE) - log_found
    square = np.exp(2.0 * log)[:, None]
    explained = square * shown**2 / (1.0 + square * seen)
    by_readings = 0.5 * np.sum(explained - np.log1p(square * seen), axis=1)
    likely = by_readings + log_prior(log + log_found)
    share = np.cumsum(np.exp(likely - np.max(likely)))
    found: Vector = np.exp(np.interp(probability, share / np.max(share), log))
    return found


def size_by_all(families: Sequence[Family], probability: float) -> float:
    """Return the quantile of a group's standard deviation, relative to the usual value, from the
    results of `family_of` for this group in independent fits."""
    seen = np.concatenate([np.zeros(0), *(one.seen for one in families)])
    shown = np.concatenate([np.zeros(0), *(one.shown for one in families)])
    return _sizes_at(np.array([probability]), seen, shown, 0.0).item()


def likely_factors() -> Vector:
    """Return equally likely standard deviations, relative to the usual value, of a random effect
    that no reading depends on, shape (points,)."""
    return _points(np.zeros(1), np.zeros(1), 0.0)


def hidden_factors() -> Vector:
    """Return equally likely sizes of the waves between the targets, relative to the usual size,
    shape (points,).

    One machine of four has nearly no waves, because it has a glass scale although a ball screw is
    assumed.
    """
    share = (np.arange(POINTS) + 0.5) / POINTS
    low, high = WAVES_SPREAD
    present = low + (high - low) * (share - ABSENT) / (1.0 - ABSENT)
    found: Vector = np.where(share < ABSENT, NEXT_TO_NONE, present)
    return found


def class_factors() -> Vector:
    """Return equally likely sizes of a machine's unmeasured errors, relative to the usual size,
    shape (points,). The order of these sizes is independent of the order of `likely_factors`."""
    order = np.arange(POINTS) * (POINTS // 2) % POINTS
    sizes = np.exp(CLASS_SPREAD * normal_points(POINTS))
    found: Vector = sizes[order]
    return found


def normal_points(count: int) -> Vector:
    """Return ``count`` equally likely values of a standard normal variable, in ascending order."""
    at = np.linspace(-6.0, 6.0, 2401)
    density = np.exp(-0.5 * at**2)
    share = np.cumsum(density)
    below = (share - 0.5 * density) / share[-1]
    wanted = (np.arange(count) + 0.5) / count
    found: Vector = np.interp(wanted, below, at)
    return found


def families(fit: MixedFit, group: NDArray[np.int64], sizes: Sizes) -> dict[int, Family]:
    """Return, by the number of the group, the `Family` of every group of random effects whose
    standard deviation is estimated."""
    return {
        int(place): family_of(fit, group == place, float(np.log(sizes.factor[place])))
        for place in np.flatnonzero(sizes.sought)
    }
