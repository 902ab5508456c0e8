"""The uncertainty budget: what each source puts on each quantity through the estimator's linear operator.

An estimate is ``gain @ readings``. A source moves the readings by known patterns (one standard deviation each), so it
moves the quantities by ``gain @ pattern``: the law of propagation with every correlation kept (GUM 5.2, in matrix form
JCGM 102, 6.2). The same patterns serve the Monte Carlo cross-check (`solver.uncertainty.monte_carlo`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

COVERAGE_FACTOR = 2.0
"""k of the expanded uncertainty (ISO/TR 230-9)."""

Distribution = Literal["normal", "rectangular", "one-sided"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """One source of uncertainty as it moves the readings.

    ``pattern_um`` has shape (N, k): each column is what one independent cause does to all N readings at one standard
    deviation. Shape (N,) stands for N causes of which each moves one reading. ``one-sided`` is uniform from zero up with this root mean
    square: an effect whose sign is known, such as a cosine error. ``text`` says what was assumed.
    """

    name: str
    text: str
    pattern_um: Vector
    distribution: Distribution = "normal"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Budget:
    """Standard uncertainties by source, shape (sources, quantities), in each quantity's unit, and the assumption behind each."""

    names: tuple[str, ...]
    texts: tuple[str, ...]
    u: Vector

    @property
    def combined(self) -> Vector:
        """Return the combined standard uncertainty of every quantity, shape (quantities,)."""
        total: Vector = np.sqrt(np.sum(self.u**2, axis=0))
        return total

    @property
    def expanded(self) -> Vector:
        """Return the expanded uncertainty at `COVERAGE_FACTOR`, shape (quantities,)."""
        return COVERAGE_FACTOR * self.combined

    def dominant(self, quantity: int) -> str:
        """Return the name of the largest source of one quantity."""
        return self.names[int(np.argmax(self.u[:, quantity]))]


def response(gain: Vector, source: Source) -> Vector:
    """Return how each independent cause moves each quantity, shape (quantities, causes)."""
    moved: Vector = gain * source.pattern_um if source.pattern_um.ndim == 1 else gain @ source.pattern_um
    return moved


def budget(gain: Vector, sources: Sequence[Source]) -> Budget:
    """Return the budget of the quantities ``gain @ readings``, gain of shape (quantities, N)."""
    return Budget(
        names=tuple(source.name for source in sources),
        texts=tuple(source.text for source in sources),
        u=np.array([np.linalg.norm(response(gain, source), axis=1) for source in sources]),
    )


def covariance(gain: Vector, sources: Sequence[Source]) -> Vector:
    """Return the covariance of the quantities from all sources together, shape (quantities, quantities)."""
    moved = np.column_stack([response(gain, source) for source in sources])
    full: Vector = moved @ moved.T
    return full


def with_tilt_share(spent: Budget, tilts_known: Vector, reading: str = "reading") -> Budget:
    """Return the budget with the reading's share split in two: with the mirror's tilts known, and the price of estimating them.

    ``tilts_known`` (quantities,) is the standard uncertainty from the readings' noise in a model without tilt parameters;
    their presence makes every slope-like quantity worse even when the tilt itself is nil.
    """
    row = spent.names.index(reading)
    known = np.minimum(tilts_known, spent.u[row])
    price = np.sqrt(spent.u[row] ** 2 - known**2)
    text = "two mirror tilts per setup are found from the same readings"
    return Budget(
        names=(*spent.names[: row + 1], "tilt estimation", *spent.names[row + 1 :]),
        texts=(*spent.texts[: row + 1], text, *spent.texts[row + 1 :]),
        u=np.vstack([spent.u[:row], known, price, spent.u[row + 1 :]]),
    )
