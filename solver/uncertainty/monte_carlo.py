"""Monte Carlo cross-check of the budget (JCGM 101): draws through the estimator's operator, shortest coverage intervals."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.uncertainty.budget import Distribution, Source, Vector, response

TRIALS = 200_000
"""At least 10^4 / (1 - p) for a coverage probability p of 0.95 (JCGM 101, 7.2.2)."""
_BLOCK = 20_000
"""Trials in one product: some tens of megabytes of draws."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Intervals:
    """Mean, standard deviation and shortest coverage interval of every quantity's deviation from its estimate, shapes (quantities,)."""

    mean: Vector
    u: Vector
    low: Vector
    high: Vector
    probability: float
    trials: int


def monte_carlo(gain: Vector, sources: Sequence[Source], *, trials: int = TRIALS, seed: int = 0, probability: float = 0.95) -> Intervals:
    """Return the intervals of the quantities ``gain @ readings`` under all sources, gain of shape (quantities, N).

    The same seed gives the same intervals.
    """
    causes = [*_normal_causes(gain, sources), *_other_causes(gain, sources)]
    operator = np.column_stack([moved for _, moved in causes]).T
    rng = np.random.default_rng(seed)
    deviations = np.empty((len(gain), trials))
    for rows in _blocks(trials):
        drawn = np.column_stack([_draw(rng, kind, (rows.stop - rows.start, moved.shape[1])) for kind, moved in causes])
        deviations[:, rows] = (drawn @ operator).T
    low, high = shortest_interval(deviations, probability)
    return Intervals(
        mean=deviations.mean(axis=1), u=deviations.std(axis=1, ddof=1), low=low, high=high, probability=probability, trials=trials
    )


def shortest_interval(samples: Vector, probability: float) -> tuple[Vector, Vector]:
    """Return the ends of the shortest interval that holds the share ``probability`` of each row's samples (JCGM 101, 7.7).

    Only the tails are sorted: the interval begins among the lowest and ends among the highest ``1 - probability``.
    """
    count = samples.shape[-1]
    kept = int(np.ceil(probability * count))
    tail = count - kept + 1
    ordered = np.partition(samples, (tail - 1, kept - 1), axis=-1)
    starts, ends = np.sort(ordered[..., :tail], axis=-1), np.sort(ordered[..., kept - 1 :], axis=-1)
    best = np.argmin(ends - starts, axis=-1, keepdims=True)
    low: Vector = np.take_along_axis(starts, best, axis=-1)[..., 0]
    high: Vector = np.take_along_axis(ends, best, axis=-1)[..., 0]
    return low, high


def confirms(intervals: Intervals, u: Vector, k: float = 1.959964) -> NDArray[np.bool_]:
    """Return per quantity whether the Monte Carlo interval confirms ``+- k u`` to two digits of u (JCGM 101, 8.1)."""
    with np.errstate(divide="ignore"):
        exponent = np.floor(np.log10(u)) - 1
    tolerance = 0.5 * 10.0**exponent
    agreed: NDArray[np.bool_] = (np.abs(intervals.low + k * u) <= tolerance) & (np.abs(intervals.high - k * u) <= tolerance)
    return agreed


def _normal_causes(gain: Vector, sources: Sequence[Source]) -> list[tuple[Distribution, Vector]]:
    """Return the normal sources as one with at most as many causes as there are readings: their sum is normal as well."""
    normal = [source.pattern_um for source in sources if source.distribution == "normal"]
    if not normal:
        return []
    white = np.sqrt(np.sum([pattern**2 for pattern in normal if pattern.ndim == 1], axis=0)) * np.ones(gain.shape[1])
    shared = [pattern for pattern in normal if pattern.ndim == 2]
    if not shared:
        return [("normal", gain * white)]
    # P P^T = R^T R: fewer causes of the same covariance
    triangle: Vector = np.linalg.qr(np.column_stack([np.diag(white), *shared]).T).R
    return [("normal", gain @ triangle.T)]


def _other_causes(gain: Vector, sources: Sequence[Source]) -> list[tuple[Distribution, Vector]]:
    return [(source.distribution, response(gain, source)) for source in sources if source.distribution != "normal"]


def _blocks(trials: int) -> Iterator[slice]:
    for start in range(0, trials, _BLOCK):
        yield slice(start, min(start + _BLOCK, trials))


def _draw(rng: np.random.Generator, distribution: Distribution, shape: tuple[int, int]) -> Vector:
    """Return draws of root mean square one."""
    if distribution == "normal":
        return rng.standard_normal(shape)
    width = np.sqrt(3.0)
    drawn: Vector = rng.uniform(0.0 if distribution == "one-sided" else -width, width, shape)
    return drawn
