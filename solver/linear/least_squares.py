"""The generalised inverse of the normal matrix of weighted least squares, and its null space."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.linear.elimination import Blocks, Elimination, Normal, eliminate
from stepdiag.solver.linear.packed import Packed, pack
from stepdiag.solver.linear.rows import Rows

NULL_TOLERANCE = 1e-7
"""Smallest length of the image of a direction that the rows determine; the columns have unit
length."""
_SHIFT = 1e-8
_CANDIDATE = 1e-3
_FIRST_BLOCK = 12
REFINEMENTS = 2
_PIECE = 512
"""Number of rows computed together; a larger number needs more memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Inverse:
    """A generalised inverse C of the normal matrix.

    ``null`` (count, k) spans the directions that the rows do not determine. The k unknowns
    ``fixed`` are set to zero. The value and variance of a determined combination do not depend on
    the choice of ``fixed``.
    """

    packed: Packed
    null: Vector
    fixed: NDArray[np.int64]
    scale: Vector
    elimination: Elimination

    @property
    def rank(self) -> int:
        return len(self.scale) - len(self.fixed)

    def solve(self, right: Vector) -> Vector:
        place = self.elimination.blocks.place
        scale = self.scale.copy()
        scale[self.fixed] = 0.0
        ordered = np.empty((len(place), 1 if right.ndim == 1 else right.shape[1]))
        ordered[place] = scale[:, None] * right.reshape(len(place), -1)
        solved: Vector = scale[:, None] * self.elimination.solve(ordered)[place]
        return solved[:, 0] if right.ndim == 1 else solved

    def variance(self) -> Vector:
        diagonal = self.elimination.diagonal()[self.elimination.blocks.place]
        diagonal[self.fixed] = 0.0
        scaled: Vector = diagonal * self.scale**2
        return scaled

    def squares(self) -> Vector:
        """Return a' C a for every row a, shape (m,)."""
        scale = self.scale.copy()
        scale[self.fixed] = 0.0
        return self.packed.squares(self.elimination, scale)

    def among(self, rows: Rows) -> Vector:
        """Return a' C b for every pair of ``rows``, shape (k, k)."""
        elimination, place = self.elimination, self.elimination.blocks.place
        start = elimination.blocks.border.start
        scale = self.scale.copy()
        scale[self.fixed] = 0.0
        ordered = Rows(place[rows.column], rows.value * scale[rows.column], rows.count)
        left = ordered.times(
            np.vstack([-elimination.border_solution, np.eye(len(place) - start)])
        )
        found: Vector = left @ elimination.border_inverse @ left.T
        for first in range(0, len(rows), _PIECE):
            piece = slice(first, min(first + _PIECE, len(rows)))
            some = np.zeros((len(place), piece.stop - first))
            np.add.at(
                some,
                (ordered.column[piece].T, np.arange(piece.stop - first)),
                ordered.value[piece].T,
            )
            some[:start] = elimination.inner_solve(some[:start])
            some[start:] = 0.0
            found[:, piece] += ordered.times(some)
        return found

    def sees(self, combinations: Rows) -> NDArray[np.bool_]:
        """Return for each linear function of the unknowns (a row of ``combinations``) whether
        the data determine it, shape (q,)."""
        length = np.sqrt(
            np.sum((combinations.value * self.scale[combinations.column]) ** 2, axis=1)
        )
        hidden = np.linalg.norm(combinations.times(self.null), axis=1)
        seen: NDArray[np.bool_] = hidden <= 10 * NULL_TOLERANCE * length
        return seen


def invert(
    rows: Rows, weight: Vector, blocks: Blocks, like: Inverse | None = None
) -> Inverse:
    """Return a generalised inverse of A.T diag(weight) A.

    ``like`` is an earlier result with the same null space, which is used again: for the same rows
    with other positive weights, or for fewer rows.
    """
    packed = like.packed if like and like.packed.rows is rows else pack(rows, blocks)
    system = _scaled(packed, weight)
    if like is None:
        basis, held, elimination = _null_space(system)
    else:
        basis = np.linalg.qr(like.null[np.argsort(blocks.place)] / system.scale[:, None])[0]
        held = _pivots(basis)
        elimination = eliminate(system.normal.held(held))
        # if a weight changes by powers of ten, the basis loses as many digits
        basis = np.linalg.qr(
            _refined(system, basis @ np.linalg.inv(basis[held]), held, elimination)
        )[0]
    place = blocks.place
    return Inverse(
        packed=system.packed,
        null=(basis * system.scale[:, None])[place],
        fixed=np.argsort(place)[held],
        scale=system.scale[place],
        elimination=elimination,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    packed: Packed
    weight: Vector
    normal: Normal
    scale: Vector

    def image(self, block: Vector) -> Vector:
        in_own_order = (block * self.scale[:, None])[self.packed.blocks.place]
        weighted: Vector = np.sqrt(self.weight)[:, None] * self.packed.times(in_own_order)
        return weighted

    def columns(self, places: NDArray[np.int64]) -> Vector:
        unit = np.zeros((len(self.scale), len(places)))
        unit[places, np.arange(len(places))] = 1.0
        return self.times_normal(unit)

    def times_normal(self, block: Vector) -> Vector:
        ordered = np.empty_like(block)
        ordered[self.packed.blocks.place] = self.packed.transposed_times(
            np.sqrt(self.weight)[:, None] * self.image(block)
        )
        return self.scale[:, None] * ordered

    def unseen(self, block: Vector, tolerance: float) -> Vector:
        """Return an orthonormal basis of the directions in the span of ``block`` (count, k) that
        the rows do not determine."""
        image = self.image(block)
        if np.linalg.norm(image) < tolerance:
            return block
        _, singular, right = np.linalg.svd(np.linalg.qr(image, mode="r"))
        lengths = np.concatenate([singular, np.zeros(block.shape[1] - len(singular))])
        basis: Vector = block @ right.T[:, lengths < tolerance]
        return basis


def _scaled(packed: Packed, weight: Vector) -> _System:
    normal = packed.normal(weight)
    diagonal = normal.diagonal
    scale = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    return _System(packed, weight, normal.scaled(scale), scale)


def _null_space(system: _System) -> tuple[Vector, NDArray[np.int64], Elimination]:
    """Return an orthonormal basis (count, k) of the null space, the unknowns fixed at zero, and the
    elimination.

    Inverse iteration finds candidate directions. With one unknown fixed for each candidate the
    matrix is regular, and the elimination gives the candidates to full precision. The final test
    uses the rows, because the normal matrix loses half of the digits.
    """
    count = len(system.scale)
    # the search excludes unknowns that no row involves: if the rows measure only a few functions,
    # most unknowns are excluded
    idle = np.flatnonzero(system.normal.diagonal == 0)
    basis = _candidates(system, idle)
    held = np.append(idle, _pivots(basis))
    elimination = eliminate(system.normal.held(held))
    if found := basis.shape[1]:
        coupling = system.columns(held[-found:])
        coupling[held] = 0.0
        exact = -elimination.solve(coupling)
        exact[held[-found:]] = np.eye(found)
        basis = system.unseen(
            np.linalg.qr(_refined(system, exact, held, elimination))[0], NULL_TOLERANCE
        )
        if basis.shape[1] < found:
            held = np.append(idle, _pivots(basis))
            elimination = eliminate(system.normal.held(held))
    return np.hstack([np.eye(count)[:, idle], basis]), held, elimination


def _refined(
    system: _System, basis: Vector, held: NDArray[np.int64], elimination: Elimination
) -> Vector:
    refined = basis
    for _ in range(REFINEMENTS):
        left = system.times_normal(refined)
        left[held] = 0.0
        refined = refined - elimination.solve(left)
    return refined


def _candidates(system: _System, idle: NDArray[np.int64]) -> Vector:
    count, most = len(system.scale), len(system.scale) - len(idle)
    nearly = eliminate(system.normal.held(idle).raised(np.full(count, _SHIFT)))
    size = min(_FIRST_BLOCK, most)
    draw = np.random.default_rng(0)
    while True:
        start = draw.standard_normal((count, size))
        start[idle] = 0.0
        block = np.linalg.qr(nearly.solve(start))[0]
        image = system.image(block)
        square, mix = np.linalg.eigh(image.T @ image)
        basis: Vector = block @ mix[:, square < _CANDIDATE**2]
        if basis.shape[1] < size or size == most:
            return basis
        size = min(2 * size, most)


def _pivots(basis: Vector) -> NDArray[np.int64]:
    """Return k unknowns at which only the zero vector of the span of ``basis`` (count, k) is
    zero: the pivots of the Cholesky root of basis @ basis.T."""
    count, size = basis.shape
    root = np.zeros((size, count))
    left = np.einsum("ij,ij->i", basis, basis)
    chosen = np.zeros(size, dtype=np.int64)
    for index in range(size):
        best = chosen[index] = int(np.argmax(left))
        column = basis @ basis[best] - root[:index, best] @ root[:index]
        root[index] = column / np.sqrt(column[best])
        left -= root[index] ** 2
    return chosen
