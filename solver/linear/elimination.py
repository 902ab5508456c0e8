"""Gaussian elimination that uses how a step diagonal couples its unknowns.

A diagonal passes node i of one axis together with nodes i or n - i of the others. Nodes folded to min(i, n - i) are therefore coupled to
their neighbours only: a block tridiagonal matrix. What is coupled to everything (offsets, tilts, drifts, the end nodes) stands in a border.
Elimination costs n small blocks instead of (18 n)^3.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.geometry.volume import Vector


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """An order of the unknowns: ``place[c]`` is the new place of column ``c``; ``edges`` (k + 1,) bounds k blocks, the border follows."""

    place: NDArray[np.int64]
    edges: NDArray[np.int64]

    @property
    def border(self) -> slice:
        """Return the places of the border."""
        return slice(int(self.edges[-1]), len(self.place))

    def block(self, index: int) -> slice:
        """Return the places of a block."""
        return slice(int(self.edges[index]), int(self.edges[index + 1]))

    @property
    def count(self) -> int:
        """Return how many blocks stand before the border."""
        return len(self.edges) - 1


def order_blocks(group: NDArray[np.int64]) -> Blocks:
    """Return the order in which unknowns of group 0, 1, 2 .. form the blocks and those of group -1 the border."""
    highest = int(group.max(initial=-1))
    ranked = np.where(group < 0, highest + 1, group)
    place = np.empty(len(group), dtype=np.int64)
    place[np.argsort(ranked, kind="stable")] = np.arange(len(group))
    return Blocks(place, np.searchsorted(np.sort(ranked), np.arange(highest + 2)))


@dataclass(frozen=True, slots=True, eq=False)
class Elimination:
    """A symmetric positive definite matrix, eliminated: pivots inverted, multipliers, the border's solution and its inverse."""

    blocks: Blocks
    pivot_inverse: list[Vector]
    multiplier: list[Vector]
    border_solution: Vector
    border_inverse: Vector

    def solve(self, right: Vector) -> Vector:
        """Return the inverse times ``right`` (count, k)."""
        border = self.blocks.border
        inner = self.inner_solve(right[: border.start])
        outer = self.border_inverse @ (right[border] - self.border_solution.T @ right[: border.start])
        return np.vstack([inner - self.border_solution @ outer, outer])

    def inner_solve(self, right: Vector) -> Vector:
        """Return the inverse of the blocks alone times ``right``, shape (places before the border, k)."""
        solution = right.copy()
        last = self.blocks.count - 1
        for index in range(last):
            solution[self.blocks.block(index + 1)] -= self.multiplier[index] @ solution[self.blocks.block(index)]
        for index in range(last, -1, -1):
            here = self.blocks.block(index)
            solution[here] = self.pivot_inverse[index] @ solution[here]
            if index < last:
                solution[here] -= self.multiplier[index].T @ solution[self.blocks.block(index + 1)]
        return solution

    def diagonal(self) -> Vector:
        """Return the diagonal of the inverse, shape (count,), by the recursion from the last block back."""
        solution, inverse = self.border_solution, self.border_inverse
        variance = np.concatenate([np.einsum("ij,ij->i", solution @ inverse, solution), np.diag(inverse)])
        following = np.zeros((0, 0))
        for index in range(self.blocks.count - 1, -1, -1):
            following = self.pivot_inverse[index] + (
                self.multiplier[index].T @ following @ self.multiplier[index] if following.size else 0.0
            )
            variance[self.blocks.block(index)] += np.diag(following)
        return variance

    def border_columns(self) -> Vector:
        """Return the columns of the inverse that belong to the border, shape (count, border)."""
        return np.vstack([-self.border_solution @ self.border_inverse, self.border_inverse])


def eliminate(matrix: Vector, blocks: Blocks) -> Elimination:
    """Eliminate a symmetric positive definite matrix whose blocks touch only their neighbours and the border.

    The columns of ``matrix`` stand in the order of ``blocks``. Raises ``numpy.linalg.LinAlgError`` for a singular one.
    """
    pivots: list[Vector] = []
    multipliers: list[Vector] = []
    for index in range(blocks.count):
        here = blocks.block(index)
        pivot: Vector = matrix[here, here]
        if index:
            before = blocks.block(index - 1)
            multipliers.append(matrix[here, before] @ pivots[-1])
            pivot = pivot - multipliers[-1] @ matrix[before, here]
        inverted: Vector = np.linalg.inv(pivot).astype(np.float64, copy=False)
        pivots.append(inverted)
    border = blocks.border
    partial = Elimination(blocks, pivots, multipliers, np.zeros((border.start, 0)), np.zeros((0, 0)))
    coupling = matrix[: border.start, border]
    solution = partial.inner_solve(coupling)
    inverse = np.linalg.inv(matrix[border, border] - coupling.T @ solution)
    return Elimination(blocks, pivots, multipliers, solution, 0.5 * (inverse + inverse.T))
