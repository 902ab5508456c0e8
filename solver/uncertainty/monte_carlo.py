"""Monte Carlo check of the law of propagation (JCGM 101): the estimator evaluates simulated surveys
with random noise and random effects.

The simulated standard deviations of the random effects are drawn from their distribution; the
estimator uses the estimated standard deviations.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stepdiag.base.volume import Vector
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.uncertainty.spread import Spread

_NUMBERS = 2_000_000
"""Number of random numbers drawn at a time; they need some tens of megabytes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Intervals:
    """Standard deviation and shortest coverage interval of the error of every quantity, shapes
    (quantities,)."""

    u: Vector
    low: Vector
    high: Vector


def monte_carlo(
    spread: Spread, asked: Rows, *, trials: int, seed: int = 0, probability: float = 0.95
) -> Intervals:
    """Return the intervals of some combinations of the unknowns. Equal seeds give equal intervals.

    JCGM 101, 7.2.2 requires at least 10^4 / (1 - p) ``trials`` for a coverage probability p: 200
    000 for 0.95.
    """
    noise = _noise_operator(spread, asked)
    causes = _cause_operator(spread, asked)
    rng = np.random.default_rng(seed)
    deviations = np.empty((len(asked), trials))
    for some in _blocks(trials, len(noise) + len(causes)):
        count = some.stop - some.start
        sizes = np.ones((count, len(spread.names)))
        for place, family in spread.families.items():
            sizes[:, place] = rng.choice(family.factor, count)
        amounts = rng.standard_normal((count, len(causes)))
        drawn = amounts * spread.fit.size * sizes[:, spread.group]
        by_noise = rng.standard_normal((count, len(noise))) @ noise
        deviations[:, some] = (by_noise + drawn @ causes).T
    low, high = shortest_interval(deviations, probability)
    u = deviations.std(axis=1, ddof=1)
    return Intervals(u=u, low=low, high=high)


def _noise_operator(spread: Spread, asked: Rows) -> Vector:
    """Return the effect of the noise on the quantities, shape (rows, quantities), reduced to at
    most as many rows as quantities."""
    fit = spread.fit
    wanted = fit.inverse.solve(asked.dense().T)
    direct = fit.rows.times(wanted) * fit.weight[:, None]
    amounts = fit.amount_covariance @ spread.moved(asked).T
    gain = direct + fit.causes.left @ amounts
    kept = fit.weight > 0
    scaled = gain[kept] / np.sqrt(fit.weight[kept])[:, None]
    # R of the QR decomposition gives the same covariance as all rows
    folded: Vector = np.linalg.qr(scaled).R if len(scaled) > scaled.shape[1] else scaled
    return folded


def _cause_operator(spread: Spread, asked: Rows) -> Vector:
    """Return the error of the estimated quantities for one unit of each random effect, shape
    (random effects, quantities)."""
    left = spread.fit.amount_covariance @ spread.fit.causes.seen - np.eye(len(spread.group))
    operator: Vector = (spread.moved(asked) @ left).T
    return operator


def shortest_interval(samples: Vector, probability: float) -> tuple[Vector, Vector]:
    """Return the ends of the shortest interval that contains the share ``probability`` of each
    row of samples (JCGM 101, 7.7)."""
    rows, count = np.arange(len(samples)), samples.shape[1]
    kept = int(np.ceil(probability * count))
    tail = count - kept + 1
    ordered = np.partition(samples, (tail - 1, kept - 1), axis=1)
    starts = np.sort(ordered[:, :tail], axis=1)
    ends = np.sort(ordered[:, kept - 1 :], axis=1)
    best = np.argmin(ends - starts, axis=1)
    return starts[rows, best], ends[rows, best]


def _blocks(trials: int, numbers: int) -> Iterator[slice]:
    size = max(1, _NUMBERS // max(numbers, 1))
    for start in range(0, trials, size):
        yield slice(start, min(start + size, trials))
