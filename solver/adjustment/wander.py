"""A pass that wanders: all its steps at once, as a random walk of unknown size beside what every pass does."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.counts import Count, walk_of
from stepdiag.solver.linear.mixed import MixedFit

CRITICAL_GAIN = 20.0
"""What the likelihood of a walk must gain, twice its logarithm, to be no chance: of 600 good surveys of ordinary machines four gained 14
to 16 where angles are larger than usual."""
AS_LIKELY = 8.0
"""Passes whose likelihoods differ by less than this are not separated."""
TRIED = 2.0 ** np.arange(-4.0, 10.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wander:
    """A random walk on ``rows`` (k,): standard deviation of a step in um, and twice the logarithm of the likelihood gained."""

    rows: NDArray[np.int64]
    step_um: float
    gain: float

    def pattern(self, count: int) -> Vector:
        """Return its independent causes on all readings, at one standard deviation each, shape (count, r)."""
        walk = walk_of(len(self.rows))
        whole = np.zeros((count, walk.shape[1]))
        whole[self.rows] = self.step_um * walk
        return whole


def wandering(fit: MixedFit, every: Sequence[Count], scale: float) -> list[Wander]:
    """Return the count whose readings gain most by a random walk of their own, and those that gain about as much; none where all gain
    no more than by chance."""
    found = sorted((_walk(fit, count, scale) for count in every), key=lambda walk: -walk.gain)
    if not found or found[0].gain <= CRITICAL_GAIN:
        return []
    return [walk for walk in found if walk.gain > max(found[0].gain - AS_LIKELY, 0.0)]


def _walk(fit: MixedFit, count: Count, scale: float) -> Wander:
    """Return the random walk that a count most likely makes: likelihood ratio over sizes, in the directions that the fit sees."""
    rows = count.rows
    mixed = fit.root @ (fit.causes.left[rows].T @ count.walk)
    seen, turn = np.linalg.eigh((count.walked - mixed.T @ mixed) / scale**2)
    shown = turn.T @ (count.walk.T @ (fit.weight[rows] * fit.residual[rows])) / scale**2
    clear = seen > 1e-9 * max(float(seen[-1]), np.finfo(np.float64).tiny)
    seen, shown = seen[clear], shown[clear]
    grown = TRIED[:, None] ** 2 * seen
    gain = np.sum(shown**2 / seen * grown / (1.0 + grown) - np.log1p(grown), axis=1)
    best = int(np.argmax(gain))
    return Wander(rows=rows, step_um=float(TRIED[best]), gain=float(gain[best]))
