"""Sizes of the causes of a mixed fit: restricted maximum likelihood, a size per group, the usual
size if the readings contain no information.

Newton's iteration on the logarithm of the sizes, and Fisher scoring far from the most likely value,
where the observed information is not positive (Searle, Casella, McCulloch 1992, 8.2-8.3). The prior
of a size has the user's value as its most likely order of magnitude and extends to zero: a cause
may be absent (after the half-t of Gelman 2006, Bayesian Analysis 1, 515-534).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.linear.mixed import AnyFit, MixedFit

ROUNDS = 40
"""Largest number of iterations; a search takes two to six."""
LARGEST_STEP = 1.5
"""Largest change of the logarithm of a size in one iteration: a longer step leaves the range of the
quadratic approximation.
"""
SETTLED = 1e-3
"""Changes of the logarithm below this value end the search: no figure of the result shows them."""
FURTHEST = 7.0
"""Sizes stay within a factor e^7 of the usual: beyond, the logarithm has no information."""
HEAD, TAIL = 0.5, 4.0
"""Powers of the size at the beginning and in the tail of the prior of its logarithm: a quarter of
the prior lies below a tenth of the usual size, half below 0.47 of it, one twentieth above three
times the usual size.
"""
_LEAST_CURVED = 0.1
_NOTHING, _EXPLAINED = 1e-12, 1e-6
"""Residuals that count as zero, and the smallest share of a square sum that an explanation can
leave: below it only rounding is left.
"""
_MUCH_SMALLER = 0.5
"""Smallest usual square sum as a share of the degrees of freedom; good surveys lie above it."""


@dataclass(frozen=True, slots=True, eq=False)
class Sizes:
    """Sizes of the groups: ``factor`` (groups,) is the ratio of each size to the usual size;
    ``sought`` states whether it was estimated.
    """

    factor: Vector
    sought: NDArray[np.bool_]


def log_prior(log_factor: Vector) -> Vector:
    """Return the logarithm of the density of a size's logarithm, up to a constant, by its distance
    from the usual logarithm.
    """
    found: Vector = HEAD * log_factor - 0.5 * (TAIL + HEAD) * np.log1p(
        HEAD / TAIL * np.exp(2.0 * log_factor)
    )
    return found


def _prior_slope(log_factor: Vector) -> tuple[Vector, Vector]:
    """Return the first derivative of `log_prior` and its downward curvature."""
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
    """Return the most likely sizes by the readings.

    ``mixed`` contains the usual sizes, ``group`` (q,) numbers the group of each cause; ``sought``
    (groups,) marks the groups of unknown size, ``near`` (groups,) the start of the search: the
    usual sizes without it.
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
        # a size that has passed the most likely value goes back by half the distance: the expected
        # information may be too large
        furthest = np.where(step * before < 0, 0.5 * furthest, furthest)
        before = np.clip(step, -furthest, furthest)
        log[free] = np.clip(log[free] + before, -FURTHEST, FURTHEST)
        if np.max(np.abs(before)) < SETTLED:
            break
    return Sizes(np.exp(log), sought)


def sized(mixed: MixedFit, factor: Vector) -> MixedFit:
    """Return the fit in which each size is multiplied by a factor of its own."""
    return MixedFit(mixed.fixed, mixed.causes, mixed.size * factor)


def _slope(here: MixedFit, member: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the gradient of the restricted likelihood by the logarithm of every group's size, and
    its observed and expected information.

    With the amounts m in units of their size and their covariance P, shapes (q,) and (q, q), a
    change of a group's logarithm moves m by (2 P - 1) m and P by -P (1 - P) - (1 - P) P, each over
    the group alone.
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
    """Return twice the gain in log-likelihood for a fall of the weighted square sum of the
    residuals to ``left``.

    If the fault that enlarged the square sum is removed, the noise of all weights may be smaller by
    a common factor (profile likelihood). If the residuals are much smaller than their weights
    state, no fault enlarged the square sum: the weights are kept.
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
    """Return twice the logarithm of the ratio of two restricted likelihoods, each with the present
    sizes of its causes.
    """
    damped = [-2.0 * float(np.sum(np.log(np.diag(one.damped_root)))) for one in (found, than)]
    return float(gained(than, found.chi_square)) + damped[1] - damped[0]
