"""Restricted maximum likelihood estimate of the standard deviation ("size") of each group of random
effects ("causes") in a least-squares fit.

The search uses Newton's iteration on the logarithm of the sizes, or Fisher scoring if the observed
information is not positive (Searle, Casella, McCulloch 1992, 8.2-8.3). The prior of a size has its
mode near the user's value and includes zero, because a random effect may be absent (after the
half-t of Gelman 2006, Bayesian Analysis 1, 515-534).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.linear.mixed import AnyFit, MixedFit

ROUNDS = 40
"""Largest number of iterations; a search usually needs two to six."""
LARGEST_STEP = 1.5
"""Largest change of the logarithm of a standard deviation in one iteration."""
SETTLED = 1e-3
"""The search ends when the logarithms of the standard deviations change by less than this value."""
FURTHEST = 7.0
"""Limit of the logarithm of (standard deviation / usual standard deviation)."""
HEAD, TAIL = 0.5, 4.0
"""Powers of the standard deviation in its prior density, for small and for large values. A
quarter of the prior is below 0.1 of the usual standard deviation, half below 0.47, and 95 %
below 3."""
_LEAST_CURVED = 0.1
_NOTHING, _EXPLAINED = 1e-12, 1e-6
_MUCH_SMALLER = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Sizes:
    """``factor`` (groups,) is the ratio of the standard deviation of each group of random
    effects to the usual value; ``sought`` (groups,) is True for an estimated standard deviation."""

    factor: Vector
    sought: NDArray[np.bool_]


def log_prior(log_factor: Vector) -> Vector:
    """Return the log prior density of a standard deviation, up to a constant, from
    ``log_factor`` = log(standard deviation / usual standard deviation)."""
    found: Vector = HEAD * log_factor - 0.5 * (TAIL + HEAD) * np.log1p(
        HEAD / TAIL * np.exp(2.0 * log_factor)
    )
    return found


def _prior_slope(log_factor: Vector) -> tuple[Vector, Vector]:
    square = HEAD / TAIL * np.exp(2.0 * log_factor)
    first = HEAD - (TAIL + HEAD) * square / (1.0 + square)
    return first, np.maximum(
        2.0 * (TAIL + HEAD) * square / (1.0 + square) ** 2, _LEAST_CURVED
    )


def scored(
    mixed: MixedFit,
    group: NDArray[np.int64],
    sought: NDArray[np.bool_],
    near: Vector | None = None,
) -> Sizes:
    """Return the standard deviations with the highest restricted likelihood.

    ``mixed`` contains the usual standard deviations. ``group`` (q,) is the group number of each
    random effect. ``sought`` (groups,) marks the groups to be estimated. ``near`` (groups,)
    contains the initial standard deviations; the default is the usual ones.
    """
    log = np.zeros(len(sought)) if near is None else np.where(sought, np.log(near), 0.0)
    free = np.flatnonzero(sought)
    member = (group[:, None] == free).astype(np.float64)
    furthest, before = np.full(len(free), LARGEST_STEP), np.zeros(len(free))
    for _ in range(ROUNDS if len(free) else 0):
        here = sized(mixed, np.exp(log)[group])
        gradient, observed, expected = _slope(here, member)
        first, curved = _prior_slope(log[free])
        near_the_top = np.linalg.eigvalsh(observed + np.diag(curved))[0] > _LEAST_CURVED
        information = (observed if near_the_top else expected) + np.diag(curved)
        step = np.linalg.solve(information, gradient + first)
        # after a step beyond the maximum, the next step is at most half as long: the expected
        # information may be too large
        furthest = np.where(step * before < 0, 0.5 * furthest, furthest)
        before = np.clip(step, -furthest, furthest)
        log[free] = np.clip(log[free] + before, -FURTHEST, FURTHEST)
        if np.max(np.abs(before)) < SETTLED:
            break
    return Sizes(np.exp(log), sought)


def sized(mixed: MixedFit, factor: Vector) -> MixedFit:
    return MixedFit(mixed.fixed, mixed.causes, mixed.size * factor)


def _slope(here: MixedFit, member: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the gradient of the restricted likelihood by the logarithm of every group's standard
    deviation, and its observed and expected information.

    P (q, q) is the covariance of the random effects in units of their standard deviations, m (q,)
    their amounts. The derivative of m by the logarithm of a group's standard deviation is (2 P - 1)
    m, and that of P is -P (1 - P) - (1 - P) P, both over the random effects of this group.
    """
    covariance = here.damped_root.T @ here.damped_root
    safe = np.where(here.size > 0, here.size, 1.0)
    scaled = here.amount / safe
    determined = 1.0 - np.diag(covariance)
    gradient = member.T @ (scaled**2 - determined)
    square = 2.0 * member.T @ (covariance**2) @ member
    across = (member * scaled[:, None]).T @ covariance @ (member * scaled[:, None])
    own = member.T @ np.column_stack([scaled**2 + 1.0 - determined, 2.0 * determined - 1.0])
    observed = 2.0 * np.diag(own[:, 0]) - square - 4.0 * across
    return gradient, observed, 2.0 * np.diag(own[:, 1]) + square


def gained(fit: AnyFit, left: Vector | float) -> Vector:
    """Return twice the gain in log-likelihood if the weighted square sum of the residuals decreases
    to ``left``.

    All weights have a free common noise factor (profile likelihood), unless the residuals are much
    smaller than the weights predict.
    """
    whole, freedom = max(fit.chi_square, _NOTHING), float(max(fit.freedom, 1))
    within = np.clip(left, _EXPLAINED * whole, whole)
    found: Vector = np.asarray(
        whole - within
        if whole < _MUCH_SMALLER * freedom
        else min(whole, freedom) * np.log(whole / within)
    )
    return found


def likelier(found: MixedFit, than: MixedFit) -> float:
    """Return twice the logarithm of the ratio of the restricted likelihoods of two fits."""
    damped = [-2.0 * float(np.sum(np.log(np.diag(one.damped_root)))) for one in (found, than)]
    return float(gained(than, found.chi_square)) + damped[1] - damped[0]
