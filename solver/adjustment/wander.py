"""A pass that wanders: all its steps at once, as a random walk of unknown size beside what every pass does."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.adjustment.hypotheses import steps_of, tell
from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.mixed import MixedFit

CRITICAL_GAIN = 20.0
"""What the likelihood of a walk must gain, twice its logarithm, to be no chance among a few dozen passes."""
TRIED = 2.0 ** np.arange(-4.0, 10.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wander:
    """A random walk on ``rows`` (k,): standard deviation of a step in um, and twice the logarithm of the likelihood gained."""

    rows: NDArray[np.int64]
    step_um: float
    gain: float

    def pattern(self, count: int) -> Vector:
        """Return its independent causes on all readings, at one standard deviation each, shape (count, k - 1)."""
        whole = np.zeros((count, len(self.rows) - 1))
        whole[self.rows] = self.step_um * steps_of(len(self.rows))
        return whole


def most_wandering(fit: MixedFit, each: list[NDArray[np.int64]], scale: float) -> Wander | None:
    """Return the count whose readings gain most by a random walk of their own, None where none gains more than by chance."""
    found = [_walk(fit, rows, scale) for rows in each]
    best = max(found, key=lambda walk: walk.gain, default=None)
    return best if best is not None and best.gain > CRITICAL_GAIN else None


def _walk(fit: MixedFit, rows: NDArray[np.int64], scale: float) -> Wander:
    """Return the random walk that a count most likely makes: likelihood ratio over sizes, in the directions that the fit sees."""
    told = tell(fit, rows, steps_of(len(rows)))
    seen, turn = np.linalg.eigh(told.seen / scale**2)
    shown = turn.T @ told.shown / scale**2
    clear = seen > 1e-9 * max(float(seen[-1]), np.finfo(np.float64).tiny)
    seen, shown = seen[clear], shown[clear]
    grown = TRIED[:, None] ** 2 * seen
    gain = np.sum(shown**2 / seen * grown / (1.0 + grown) - np.log1p(grown), axis=1)
    best = int(np.argmax(gain))
    return Wander(rows=rows, step_um=float(TRIED[best]), gain=float(gain[best]))
