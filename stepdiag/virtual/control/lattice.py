"""A virtual control with a lattice over the volume: values at each vertex, trilinear between the
vertices, that are added to the axes (A-79351E p. 3)."""

from dataclasses import dataclass

import numpy as np

from stepdiag.virtual.physics.error_functions import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class LatticeTable:
    """Corrections in mm at the vertices of a grid over three axes, shape (nx, ny, nz, 3); constant
    outside the grid."""

    axes_mm: tuple[Array, Array, Array]
    vectors_mm: Array

    def correction_mm(self, commanded_mm: Array, direction: Array) -> Array:  # noqa: ARG002 - a lattice knows no direction of travel
        """Return the corrections of the axes at commanded positions, shape (N, 3)."""
        moved = np.empty_like(commanded_mm, dtype=np.float64)
        for row, point in enumerate(commanded_mm):
            values = self.vectors_mm
            for axis, at in zip(self.axes_mm, point, strict=True):
                values = _between(axis, values, float(at))
            moved[row] = values
        return moved


def _between(axis: Array, values: Array, at: float) -> Array:
    upper = int(np.clip(np.searchsorted(axis, at), 1, len(axis) - 1))
    share = min(max((at - axis[upper - 1]) / (axis[upper] - axis[upper - 1]), 0.0), 1.0)
    between: Array = (1.0 - share) * values[upper - 1] + share * values[upper]
    return between


def load_lattice(text: str) -> LatticeTable:
    """Return the lattice in a CSV with the columns ``x_mm,y_mm,z_mm,cx_um,cy_um,cz_um`` and rows in
    any order. Raises ValueError for a missing vertex."""
    rows = np.array(
        [[float(cell) for cell in line.split(",")] for line in text.splitlines()[1:] if line]
    )
    axes = tuple(np.unique(rows[:, axis]) for axis in range(3))
    shape = tuple(len(axis) for axis in axes)
    if len(rows) != np.prod(shape):
        raise ValueError(f"lattice: expected {np.prod(shape)} vertices, found {len(rows)}")
    ordered = rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]
    return LatticeTable(
        axes_mm=(axes[0], axes[1], axes[2]),
        vectors_mm=ordered[:, 3:].reshape(*shape, 3) * 1e-3,
    )
