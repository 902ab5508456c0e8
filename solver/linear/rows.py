"""A sparse design matrix: a reading depends on about 20 of up to 2000 unknowns."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """A matrix A of ``count`` columns: the entry ``value[i, k]`` of row i is in column ``column[i,
    k]``, shapes (m, width).

    Unused entries have the value 0.
    """

    column: NDArray[np.int64]
    value: Vector
    count: int

    def __len__(self) -> int:
        return len(self.column)

    def select(self, rows: NDArray[np.int64]) -> "Rows":
        return Rows(self.column[rows], self.value[rows], self.count)

    def summed(self, amount: Vector) -> "Rows":
        """Return the matrix ``amount`` (sums, m) times the rows. Each row belongs to at most one
        sum."""
        of = [np.flatnonzero(each) for each in amount]
        most, width = max(map(len, of), default=0), self.column.shape[1]
        column = np.zeros((len(amount), most, width), dtype=np.int64)
        value = np.zeros((len(amount), most, width))
        for place, rows in enumerate(of):
            column[place, : len(rows)] = self.column[rows]
            value[place, : len(rows)] = self.value[rows] * amount[place, rows, None]
        return Rows(
            column.reshape(len(amount), -1), value.reshape(len(amount), -1), self.count
        )

    def times(self, unknowns: Vector) -> Vector:
        """Return A @ unknowns, shape (m,) or (m, k)."""
        if unknowns.ndim == 1:
            product: Vector = np.einsum("ik,ik->i", self.value, unknowns[self.column])
            return product
        total = np.zeros((len(self), unknowns.shape[1]))
        for place in np.flatnonzero(np.any(self.value, axis=0)):
            total += self.value[:, place, None] * unknowns[self.column[:, place]]
        return total

    def transposed_times(self, readings: Vector) -> Vector:
        weights = (self.value * readings[:, None]).ravel()
        total: Vector = np.bincount(
            self.column.ravel(), weights=weights, minlength=self.count
        ).astype(np.float64, copy=False)
        return total

    def dense(self) -> Vector:
        matrix = np.zeros((len(self), self.count))
        np.add.at(matrix, (np.arange(len(self))[:, None], self.column), self.value)
        return matrix

    def followed_by(self, other: "Rows") -> "Rows":
        width = max(self.column.shape[1], other.column.shape[1])
        columns = [
            np.pad(rows.column, ((0, 0), (0, width - rows.column.shape[1])))
            for rows in (self, other)
        ]
        values = [
            np.pad(rows.value, ((0, 0), (0, width - rows.value.shape[1])))
            for rows in (self, other)
        ]
        return Rows(np.vstack(columns), np.vstack(values), self.count)
