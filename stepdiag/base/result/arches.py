"""Deviations of error functions between their targets: a parabola (an arch) between each two
neighbouring targets."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector


class Between(NamedTuple):
    """Possible deviations of error functions between their targets, as arches. ``arch`` (functions,
    N) is the height at each point of an arch of height one. ``cell`` (functions, N) is the number
    of the pair of targets, ``component`` (functions,) the component of the error, ``size_um``
    (draws, functions) the standard deviation in the middle of an arch."""

    arch: Vector
    cell: NDArray[np.int64]
    component: NDArray[np.int64]
    size_um: Vector

    def square_um(self, some: slice) -> Vector:
        """Return the mean square of the deviations at the points for some draws, shape (draws, N,
        3)."""
        found = np.zeros((len(self.size_um[some]), self.arch.shape[1], 3))
        for place, component in enumerate(self.component):
            found[:, :, component] += (
                self.size_um[some, place, None] * self.arch[place]
            ) ** 2
        return found

    def drawn_um(self, draws: int) -> Vector | None:
        """Return deviations drawn independently at each point, shape (draws, N, 3), equal in every
        call; None without deviations."""
        if not self.size_um.size:
            return None
        waves = np.sqrt(self.square_um(slice(draws)))
        waves *= _drawn(*waves.shape)
        return waves

    def met(self, fields_um: Vector) -> Vector:
        """Return for each function the sum of the squared scalar products of its arches (1 um high)
        with the error fields (k, 3 N), shape (functions,)."""
        fields, found = (
            fields_um.reshape(len(fields_um), fields_um.shape[1] // 3, 3),
            np.zeros(len(self.component)),
        )
        for place, component in enumerate(self.component):
            order = np.argsort(self.cell[place], kind="stable")
            first = np.flatnonzero(np.diff(self.cell[place][order], prepend=-1))
            by_cell = np.add.reduceat(
                fields[:, order, component] * self.arch[place][order], first, axis=1
            )
            found[place] = np.sum(by_cell**2)
        return found

    def across_um2(self, met: Vector) -> Vector:
        """Return twice the scalar product of each drawn error field and the drawn deviations
        between the targets, summed over the points, shape (draws,). The mean over the draws is
        zero. `Between.square_um` contains the mean square of the deviations.

        The products do not cancel (`met`), because an arch does not change its sign between two
        targets and an error field changes little between two targets. The sum has many terms (36
        arches for four increments), so it is drawn from a normal distribution.
        """
        found: Vector = (
            2.0
            * np.sqrt(self.size_um**2 @ met)
            * np.random.default_rng(3).standard_normal(len(self.size_um))
        )
        return found


@lru_cache(maxsize=2)
def _drawn(*shape: int) -> Vector:
    drawn = np.random.default_rng(2).standard_normal(shape)
    drawn.setflags(write=False)
    return drawn


def arches_of(result: Result, points_mm: Vector, draws: int) -> Between:
    """Return the arches of a result's posterior at points (N, 3); none without a posterior."""
    posterior = result.posterior
    all_sizes = {} if posterior is None else posterior.between_um
    arch, size = np.zeros((len(all_sizes), len(points_mm))), np.zeros((draws, len(all_sizes)))
    cell = np.zeros(arch.shape, dtype=np.int64)
    alike = np.random.default_rng(1).permutation(draws)
    for place, (name, sizes) in enumerate(all_sizes.items()):
        at, nodes = points_mm[:, "XYZ".index(name[2])], result.errors[name].position_mm
        low = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)
        share = np.clip((at - nodes[low]) / (nodes[low + 1] - nodes[low]), 0.0, 1.0)
        arch[place], cell[place] = 4.0 * share * (1.0 - share), low
        # the order is the same for all functions: deviations of one machine are small on all axes
        # or large on all
        size[:, place] = sizes[alike % len(sizes)]
    return Between(
        arch,
        cell,
        np.array(["XYZ".index(name[1]) for name in all_sizes], dtype=np.int64),
        size,
    )
