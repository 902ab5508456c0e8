"""Theory of operation: the nine displacement functions as smooth random effects.

A guideway bends smoothly from target to target, but noise does not. A function without its
end-point line is a sum of half waves over the travel,

    shape(i) = sum over k of a_k sin(pi k i / n),    a_k ~ normal(0, power_k),    k = 1 .. n - 1

The powers fall with k. The adjustment estimates each a_k with a variance v_k, so a_k^2 - v_k is an
estimate of power_k. The powers of a function are the falling sequence nearest to these estimates
(pool adjacent violators). The mean of m squared estimates has a relative scatter of sqrt(2 / m).
This scatter is added to the power of a pool of m waves: with a power of zero, a function would be
treated as exactly straight as soon as the readings show no bend. A step of a guideway or the waves
of a ball screw cause large powers up to the shortest wave, so a function with a step or short waves
is not smoothed. Each of the nine functions has separate powers.

A random effect on many readings (angles, drift) bends several functions at once, and its size would
be estimated from the powers of all nine functions. To avoid this, `OF_CAUSES` times the variance of
the random effect is added to each power: smoothness is evidence about noise only.

The shorter half of the waves shows the real noise. If the squared amounts a_k^2 of these waves are
smaller than their variances v_k, the real noise is smaller than stated. The powers are then divided
by this ratio, so readings without noise are not smoothed.

In the adjustment, each value of a shape has a row with the target zero and the power of the
shortest wave as its variance. The longer waves have larger powers: random effects add the
difference. Only identified functions are smoothed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import accumulate
from typing import Self

import numpy as np

from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.base.volume import Vector
from stepdiag.solver.linear.components import Sizes
from stepdiag.solver.linear.monotone import falling_pools, pool_means
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.design import Design
from stepdiag.solver.model.noise import LEAST_U_UM
from stepdiag.solver.model.quantities import Quantities
from stepdiag.solver.uncertainty.machine import with_rows
from stepdiag.solver.uncertainty.spread import Spread

BENDS = "bends"
"""Name of the group of random effects that are the longer half waves of all functions."""
FEWEST = 4
"""Smallest number of half waves of a smoothed function."""
LEAST_SHARE = 1e-9
"""Smallest ratio of the real to the stated variances; a smaller ratio is rounding."""
OF_CAUSES = 10.0
"""Multiple of a random effect's variance that is added to the powers: with 10, nine functions
together reduce the random effect by less than half."""


def smoothed(spread: Spread, design: Design, quantities: Quantities) -> Spread:
    """Return the covariances of a survey with the identified displacement functions as smooth
    random effects; unchanged if no function has `FEWEST` half waves."""
    nodes = design.columns.nodes
    number = np.arange(1, nodes)
    waves = np.sin(np.pi * np.outer(number, number) / nodes)
    every = [quantities.select(quantities.of(name)).combination for name in DISPLACEMENTS]
    seen = [
        rows
        for rows in every
        if len(rows) >= FEWEST and np.all(spread.fit.inverse.sees(rows))
    ]
    if not seen:
        return spread
    shapes = [_Shape.of(spread, rows, waves) for rows in seen]
    share = noise_share(shapes)
    powers = [each.powers_um2() / share for each in shapes]
    longer = [waves * np.sqrt(power - power[-1]) for power in powers]
    pattern = _diagonal([each[:, np.any(each, axis=0)] for each in longer])
    u = np.sqrt(nodes / 2.0 * np.repeat([power[-1] for power in powers], nodes - 1))
    return Spread(
        with_rows(
            spread.fit,
            design,
            reduce(Rows.followed_by, seen),
            u,
            pattern,
            spread.fit.inverse,
        ),
        np.append(spread.group, np.full(pattern.shape[1], len(spread.names))),
        (*spread.names, BENDS),
        Sizes(np.append(spread.sizes.factor, 1.0), np.append(spread.sizes.sought, False)),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    amount: Vector
    of_noise: Vector
    of_causes: Vector

    @classmethod
    def of(cls, spread: Spread, shape: Rows, waves: Vector) -> Self:
        transform = waves * 2.0 / (len(waves) + 1)
        by_noise = transform @ shape.times(spread.fit.inverse.solve(shape.dense().T))
        return cls(
            amount=transform @ shape.times(spread.fit.unknowns),
            of_noise=np.sum(by_noise * transform, axis=1),
            of_causes=spread.variance(transform @ spread.moved(shape)),
        )

    @property
    def variance(self) -> Vector:
        """Return the variance of each half wave's amount."""
        return self.of_noise + self.of_causes

    def powers_um2(self) -> Vector:
        power = falling_power(self.amount, self.variance) + OF_CAUSES * self.of_causes
        falling = np.maximum.accumulate(power[::-1])[::-1]
        return np.maximum(falling, LEAST_U_UM**2)


def noise_share(shapes: Sequence[_Shape]) -> float:
    """Return the ratio (at most 1) of the squared amounts to the stated variances, for the
    shorter half of the waves of all functions."""
    short = len(shapes[0].amount) // 2
    shown = sum(float(np.sum(each.amount[short:] ** 2)) for each in shapes)
    stated = sum(float(np.sum(each.variance[short:])) for each in shapes)
    return min(max(shown / stated, LEAST_SHARE), 1.0)


def falling_power(amount: Vector, variance: Vector) -> Vector:
    """Return the falling powers of half waves from their estimated amounts and variances, shapes
    (waves,)."""
    shown = amount**2 - variance
    pool = falling_pools(shown)
    noise, power = pool_means(variance, pool), np.maximum(pool_means(shown, pool), 0.0)
    many = np.bincount(pool, minlength=len(pool))[pool]
    found: Vector = power + np.sqrt(2.0 / many) * (power + noise)
    return found


def _diagonal(blocks: Sequence[Vector]) -> Vector:
    height, width = (sum(each.shape[side] for each in blocks) for side in (0, 1))
    matrix = np.zeros((height, width))
    left = accumulate((each.shape[1] for each in blocks), initial=0)
    for place, (first, each) in enumerate(zip(left, blocks, strict=False)):
        matrix[place * len(each) : (place + 1) * len(each), first : first + each.shape[1]] = (
            each
        )
    return matrix
