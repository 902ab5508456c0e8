"""A design matrix by rows that hold only their non-zero entries: a reading touches some 20 of up to 2000 unknowns."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.geometry.volume import Vector

_PIECE = 512
"""Rows that are made dense together."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """A matrix A of ``count`` columns: entry ``value[i, k]`` stands in column ``column[i, k]``, shapes (m, width).

    Unused places hold the value 0 (in any column).
    """

    column: NDArray[np.int64]
    value: Vector
    count: int

    def __len__(self) -> int:
        return len(self.column)

    def times(self, unknowns: Vector) -> Vector:
        """Return A @ unknowns, shape (m,) or (m, k)."""
        if unknowns.ndim == 1:
            product: Vector = np.einsum("ik,ik->i", self.value, unknowns[self.column])
            return product
        total = np.zeros((len(self), unknowns.shape[1]))
        for place in range(self.column.shape[1]):
            total += self.value[:, place, None] * unknowns[self.column[:, place]]
        return total

    def transposed_times(self, readings: Vector) -> Vector:
        """Return A.T @ readings, shape (count,) or (count, k)."""
        if readings.ndim == 2:
            return self._transposed_times_many(readings)
        weights = (self.value * readings[:, None]).ravel()
        total: Vector = np.bincount(self.column.ravel(), weights=weights, minlength=self.count).astype(np.float64, copy=False)
        return total

    def _transposed_times_many(self, readings: Vector) -> Vector:
        """Return A.T @ readings, shape (count, k), from pieces of the dense matrix: they are small and fast, the whole is neither."""
        total = np.zeros((self.count, readings.shape[1]))
        for start in range(0, len(self), _PIECE):
            piece = slice(start, start + _PIECE)
            total += Rows(self.column[piece], self.value[piece], self.count).dense().T @ readings[piece]
        return total

    def normal(self, weight: Vector) -> Vector:
        """Return A.T diag(weight) A, shape (count, count)."""
        place = self.column[:, :, None] * self.count + self.column[:, None, :]
        entry = (weight[:, None] * self.value)[:, :, None] * self.value[:, None, :]
        flat: Vector = np.bincount(place.ravel(), weights=entry.ravel(), minlength=self.count**2).astype(np.float64, copy=False)
        return flat.reshape(self.count, self.count)

    def dense(self) -> Vector:
        """Return the matrix itself, shape (m, count)."""
        matrix = np.zeros((len(self), self.count))
        np.add.at(matrix, (np.arange(len(self))[:, None], self.column), self.value)
        return matrix

    def renumbered(self, new_place: NDArray[np.int64]) -> "Rows":
        """Return the rows with column ``c`` moved to ``new_place[c]``."""
        return Rows(new_place[self.column], self.value, self.count)

    def followed_by(self, other: "Rows") -> "Rows":
        """Return these rows followed by others of the same columns."""
        width = max(self.column.shape[1], other.column.shape[1])
        columns = [np.pad(rows.column, ((0, 0), (0, width - rows.column.shape[1]))) for rows in (self, other)]
        values = [np.pad(rows.value, ((0, 0), (0, width - rows.value.shape[1]))) for rows in (self, other)]
        return Rows(np.vstack(columns), np.vstack(values), self.count)
