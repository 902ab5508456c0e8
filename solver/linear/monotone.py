"""Monotone regression by the pool-adjacent-violators algorithm."""

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector


def falling_pools(values: Vector) -> NDArray[np.int64]:
    """Return the index of the first value of each value's pool, shape (k,). The pool means are
    the falling sequence nearest to ``values``."""
    pools: list[tuple[float, int]] = []
    for value in values.tolist():
        mean, count = value, 1
        while pools and pools[-1][0] < mean:
            before, length = pools.pop()
            mean, count = (before * length + mean * count) / (length + count), length + count
        pools.append((mean, count))
    counts = np.array([count for _, count in pools], dtype=np.int64)
    return np.repeat(np.cumsum(counts) - counts, counts)


def pool_means(values: Vector, first: NDArray[np.int64]) -> Vector:
    """Return the mean of each value's pool; ``first`` is the result of `falling_pools`."""
    totals = np.bincount(first, weights=values, minlength=len(values))
    means: Vector = totals[first] / np.bincount(first, minlength=len(values))[first]
    return means
