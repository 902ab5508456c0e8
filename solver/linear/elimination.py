"""Gaussian elimination of the normal matrix of step diagonals.

A step diagonal passes node i of one axis together with node i or n - i of the other axes. Blocks of
unknowns with the same min(i, n - i) are therefore coupled only to neighbouring blocks: the matrix
is block tridiagonal. The border contains the unknowns that are coupled to all blocks: offsets,
tilts, drifts, the end nodes. The elimination inverts n small blocks instead of a matrix of (18 n,
18 n).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """An order of the unknowns in k blocks, followed by a border: ``place[c]`` is the new place
    of column ``c``; ``edges`` (k + 1,) are the limits of the blocks."""

    place: NDArray[np.int64]
    edges: NDArray[np.int64]

    @property
    def border(self) -> slice:
        return slice(int(self.edges[-1]), len(self.place))

    def block(self, index: int) -> slice:
        return slice(int(self.edges[index]), int(self.edges[index + 1]))

    @property
    def count(self) -> int:
        return len(self.edges) - 1


def order_blocks(group: NDArray[np.int64]) -> Blocks:
    """Return the order of the unknowns in which group 0, 1, 2 .. are the blocks and group -1 is
    the border."""
    highest = int(group.max(initial=-1))
    ranked = np.where(group < 0, highest + 1, group)
    place = np.empty(len(group), dtype=np.int64)
    place[np.argsort(ranked, kind="stable")] = np.arange(len(group))
    return Blocks(place, np.searchsorted(np.sort(ranked), np.arange(highest + 2)))


@dataclass(frozen=True, slots=True, eq=False)
class Elimination:
    blocks: Blocks
    pivot_inverse: list[Vector]
    multiplier: list[Vector]
    border_solution: Vector
    border_inverse: Vector

    def solve(self, right: Vector) -> Vector:
        border = self.blocks.border
        solution = np.empty_like(right)
        solution[: border.start] = self.inner_solve(right[: border.start])
        solution[border] = self.border_inverse @ (
            right[border] - self.border_solution.T @ right[: border.start]
        )
        solution[: border.start] -= self.border_solution @ solution[border]
        return solution

    def inner_solve(self, right: Vector) -> Vector:
        """Return the inverse of the matrix without its border, times ``right`` (rows without the
        border, k)."""
        solution = right.copy()
        last = self.blocks.count - 1
        for index in range(last):
            solution[self.blocks.block(index + 1)] -= (
                self.multiplier[index] @ solution[self.blocks.block(index)]
            )
        for index in range(last, -1, -1):
            here = self.blocks.block(index)
            solution[here] = self.pivot_inverse[index] @ solution[here]
            if index < last:
                solution[here] -= (
                    self.multiplier[index].T @ solution[self.blocks.block(index + 1)]
                )
        return solution

    def near(self) -> Iterator[tuple[int, Vector, Vector]]:
        """Yield, from the last block to the first, the parts of the inverse of the matrix
        without its border: the block number, the part on the diagonal, and the part beside the
        previous block (Takahashi's recursion)."""
        following = np.zeros((0, 0))
        for index in range(self.blocks.count - 1, -1, -1):
            here = self.pivot_inverse[index]
            if following.size:
                here = here + self.multiplier[index].T @ following @ self.multiplier[index]
            yield (
                index,
                here,
                -here @ self.multiplier[index - 1] if index else np.zeros((len(here), 0)),
            )
            following = here

    def around(self) -> Iterator[tuple[int, Vector]]:
        """Yield, from the last block to the first, the block number and the part of the inverse
        for this block, the previous block and the border. The last item is -1 and the part of
        the border."""
        borders = -self.border_solution @ self.border_inverse
        inside = between = np.zeros((0, 0))
        for index, here, before in self.near():
            if index + 1 < self.blocks.count:
                yield index + 1, self._around(index + 1, here, inside, between, borders)
            inside, between = here, before
        if self.blocks.count:
            yield 0, self._around(0, np.zeros((0, 0)), inside, between, borders)
        yield -1, self.border_inverse

    def _around(
        self, index: int, before: Vector, here: Vector, between: Vector, borders: Vector
    ) -> Vector:
        edges = self.blocks.edges
        near = slice(int(edges[max(index - 1, 0)]), int(edges[index + 1]))
        inner = (
            np.block([[before, between.T], [between, here]])
            - borders[near] @ self.border_solution[near].T
        )
        return np.block([[inner, borders[near]], [borders[near].T, self.border_inverse]])

    def diagonal(self) -> Vector:
        solution, inverse = self.border_solution, self.border_inverse
        variance = np.concatenate(
            [np.einsum("ij,ij->i", solution @ inverse, solution), np.diag(inverse)]
        )
        for index, here, _ in self.near():
            variance[self.blocks.block(index)] += np.diag(here)
        return variance


@dataclass(frozen=True, slots=True, eq=False)
class Normal:
    """A symmetric matrix in which each block of unknowns is coupled only to its neighbouring blocks
    and the border.

    ``own`` are the blocks on the diagonal and ``lower`` the blocks left of them. ``coupling`` and
    ``border`` are the border's parts beside the blocks and on the diagonal.
    """

    blocks: Blocks
    own: list[Vector]
    lower: list[Vector]
    coupling: Vector
    border: Vector

    @property
    def diagonal(self) -> Vector:
        return np.concatenate([np.diag(block) for block in [*self.own, self.border]])

    def scaled(self, scale: Vector) -> "Normal":
        each = [scale[self.blocks.block(index)] for index in range(self.blocks.count)]
        inner, border = scale[: self.blocks.border.start], scale[self.blocks.border]
        return Normal(
            self.blocks,
            [
                block * size[:, None] * size
                for block, size in zip(self.own, each, strict=True)
            ],
            [
                block * size[:, None] * before
                for block, size, before in zip(self.lower, each[1:], each, strict=False)
            ],
            self.coupling * inner[:, None] * border,
            self.border * border[:, None] * border,
        )

    def raised(self, by: Vector) -> "Normal":
        own = [
            block + np.diag(by[self.blocks.block(index)])
            for index, block in enumerate(self.own)
        ]
        return Normal(
            self.blocks,
            own,
            self.lower,
            self.coupling,
            self.border + np.diag(by[self.blocks.border]),
        )

    def held(self, places: NDArray[np.int64]) -> "Normal":
        """Return the matrix with the rows and columns of the fixed unknowns replaced by those of
        the unit matrix; ``places`` are the places of the fixed unknowns."""
        free = np.ones(len(self.blocks.place))
        free[places] = 0.0
        return self.scaled(free).raised(1.0 - free)


def eliminate(matrix: Normal) -> Elimination:
    """Return the elimination of a matrix. Raises ``numpy.linalg.LinAlgError`` for a singular
    matrix."""
    pivots: list[Vector] = []
    multipliers: list[Vector] = []
    for index, own in enumerate(matrix.own):
        pivot = own
        if index:
            multipliers.append(matrix.lower[index - 1] @ pivots[-1])
            pivot = pivot - multipliers[-1] @ matrix.lower[index - 1].T
        inverted: Vector = np.linalg.inv(pivot).astype(np.float64, copy=False)
        pivots.append(inverted)
    partial = Elimination(
        matrix.blocks,
        pivots,
        multipliers,
        np.zeros((len(matrix.coupling), 0)),
        np.zeros((0, 0)),
    )
    solution = partial.inner_solve(matrix.coupling)
    inverse = np.linalg.inv(matrix.border - matrix.coupling.T @ solution)
    return Elimination(
        matrix.blocks, pivots, multipliers, solution, 0.5 * (inverse + inverse.T)
    )
