"""How large the causes of a mixed fit are: restricted maximum likelihood, one size a group, the usual one where the readings are silent.

Fisher scoring on the logarithm of the sizes (Searle, Casella, McCulloch 1992, 8.3); the usual size is a normal prior of that logarithm.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.mixed import MixedFit

ROUNDS = 40
LARGEST_STEP = 1.5
SETTLED = 1e-3
FURTHEST = 7.0
"""Sizes stay within e^7 of what is usual: beyond, the logarithm has nothing to say any more."""


@dataclass(frozen=True, slots=True, eq=False)
class Sizes:
    """What became of the groups: ``factor`` (groups,) by which each is larger than usual, ``spread`` of the logarithm of it (k = 1),
    and the variance of the noise relative to what the weights say."""

    factor: Vector
    spread: Vector
    noise: float


Noise = Callable[[float, int], float]
"""The variance of the noise relative to what the weights say, from chi-square and degrees of freedom."""


def scored(mixed: MixedFit, group: NDArray[np.int64], spread: Vector, noise_of: Noise) -> Sizes:
    """Return the sizes that the readings make most likely.

    ``mixed`` brings the usual sizes, ``group`` (q,) numbers the group of each cause; ``spread`` (groups,) is the standard deviation of the
    logarithm of the usual size, 0 where it is known.
    """
    log = np.zeros(len(spread))
    free = np.flatnonzero(spread > 0)
    information = np.zeros((len(free), len(free)))
    precision = np.diag(1.0 / spread[free] ** 2)
    noise = noise_of(mixed.chi_square, mixed.freedom)
    member = (group[:, None] == free).astype(np.float64)
    for _ in range(ROUNDS if len(free) else 0):
        here = sized(mixed, np.exp(log)[group] / np.sqrt(noise))
        gradient, information = _slope(here, member, noise)
        step = np.linalg.solve(information + precision, gradient - precision @ log[free])
        largest = max(float(np.max(np.abs(step))), 1e-30)
        log[free] = np.clip(log[free] + step * min(1.0, LARGEST_STEP / largest), -FURTHEST, FURTHEST)
        noise = noise_of(here.chi_square, here.freedom)
        if largest < SETTLED:
            break
    left = np.zeros(len(spread))
    left[free] = np.sqrt(np.diag(np.linalg.inv(information + precision)))
    return Sizes(np.exp(log), left, noise)


def sized(mixed: MixedFit, factor: Vector) -> MixedFit:
    """Return the fit with sizes larger by a factor each."""
    return MixedFit(mixed.fixed, mixed.causes, mixed.size * factor)


def _slope(here: MixedFit, member: Vector, noise: float) -> tuple[Vector, Vector]:
    """Return gradient and expected information of the restricted likelihood by the logarithm of every group's size."""
    told = np.eye(len(here.size)) - here.damped_root.T @ here.damped_root
    safe = np.where(here.size > 0, here.size, 1.0)
    scaled = here.amount / safe / np.sqrt(noise)
    gradient = member.T @ (scaled**2 - np.diag(told))
    information = 2.0 * member.T @ (told**2) @ member
    return gradient, information


def surprise(found: MixedFit, sizes: Sizes) -> float:
    """Return twice the negative logarithm of the restricted likelihood, up to a constant of the rows, with the sizes as they are."""
    log_damped = -2.0 * float(np.sum(np.log(np.diag(found.damped_root))))
    return found.freedom * float(np.log(sizes.noise)) + found.chi_square / sizes.noise + log_damped
