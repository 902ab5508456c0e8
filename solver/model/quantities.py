"""The results of a survey as linear combinations of the unknowns.

A function is reported at nodes 1 .. n without its end-point line; node n is zero and omitted.
Squareness and scale are computed from the slopes. A rigid rotation of the machine adds
antisymmetric slopes, so these sums do not change (contract 1): ``C0Y = -(EXY' + EYX')``, ``B0Z =
EXZ' + EZX'``, ``A0Z = -(EYZ' + EZY')``.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.kinematics import abbe_mask
from stepdiag.base.result.result import AXIS_LETTERS, DISPLACEMENTS, ROTATIONS
from stepdiag.base.volume import Vector, Volume
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.design import Columns

DISPLACEMENT_PART, ROTATION_PART = 0, 1
LATTICE = 4
"""Number of nodes on each axis of the lattice for the volumetric mean."""
_SHEARS = {"C0Y": (0, 1, -1.0), "B0Z": (0, 2, 1.0), "A0Z": (1, 2, -1.0)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Quantities:
    """The quantities, one row for each value, with the name (EXX .. ECZ, C0Y .. A0Z, X Y Z for the
    scales) and the node.

    Units: um, urad, um/m. The node of a squareness or scale is 0. A rotation has all nodes 1 .. n,
    because its slope is an error of the machine.
    """

    names: tuple[str, ...]
    node: NDArray[np.int64]
    combination: Rows

    def of(self, name: str) -> NDArray[np.int64]:
        return np.flatnonzero(np.array(self.names) == name)

    @property
    def groups(self) -> tuple[str, ...]:
        """Return the names of the quantities in order, without repetition."""
        return tuple(dict.fromkeys(self.names))

    def select(self, kept: NDArray[np.int64]) -> "Quantities":
        combination = Rows(
            self.combination.column[kept],
            self.combination.value[kept],
            self.combination.count,
        )
        return Quantities(
            names=tuple(self.names[row] for row in kept.tolist()),
            node=self.node[kept],
            combination=combination,
        )


def quantities(columns: Columns, volume: Volume) -> Quantities:
    """Return all quantities of a design: nine displacements, three squarenesses, three scales,
    and the rotations if these are unknowns."""
    inner, every = np.arange(1, columns.nodes), np.arange(1, columns.nodes + 1)
    pieces: list[tuple[str, NDArray[np.int64], NDArray[np.int64], Vector]] = []
    for index, name in enumerate(DISPLACEMENTS):
        at = columns.of(DISPLACEMENT_PART, *divmod(index, 3))
        ends = np.column_stack([at[:-1], np.full(len(inner), at[-1])])
        pieces.append(
            (
                name,
                inner,
                ends,
                np.column_stack([np.ones(len(inner)), -inner / columns.nodes]),
            )
        )
    for index, name in enumerate(ROTATIONS if ROTATION_PART in columns.parts else ()):
        at = columns.of(ROTATION_PART, *divmod(index, 3))
        pieces.append(
            (
                name,
                every,
                np.column_stack([at, at]),
                np.column_stack([np.ones(len(at)), np.zeros(len(at))]),
            )
        )
    slopes = {
        name: ((first, second, sign), (second, first, sign))
        for name, (first, second, sign) in _SHEARS.items()
    }
    slopes |= {
        letter: ((axis, axis, 1.0), (axis, axis, 0.0))
        for axis, letter in enumerate(AXIS_LETTERS)
    }
    for name, terms in slopes.items():
        ends = np.array(
            [
                [
                    columns.of(DISPLACEMENT_PART, axis, component)[-1]
                    for component, axis, _ in terms
                ]
            ]
        )
        rise = np.array([[1e3 * sign / volume.length_mm[axis] for _, axis, sign in terms]])
        pieces.append((name, np.zeros(1, dtype=np.int64), ends, rise))
    return Quantities(
        names=tuple(name for name, nodes, _, _ in pieces for _ in nodes),
        node=np.concatenate([nodes for _, nodes, _, _ in pieces]),
        combination=Rows(
            np.vstack([at for *_, at, _ in pieces]),
            np.vstack([value for *_, value in pieces]),
            columns.count,
        ),
    )


def lattice_field_um(found: Quantities, volume: Volume, chain: str) -> Vector:
    """Return the effect of one unit of each quantity on the error at the points of a lattice,
    shape (points, 3, q)."""
    lattice = np.linspace(0, volume.increments, LATTICE).round().astype(np.int64)
    points = np.stack(np.meshgrid(*[lattice] * 3), axis=-1).reshape(-1, 3)
    effects = [
        _effects_um(found.node[found.of(name)], name, points, volume, chain)
        for name in found.groups
    ]
    return np.concatenate(
        [np.zeros((len(points), 3, 0)), *effects], axis=2
    )  # with one increment the displacements have no values


def _effects_um(
    nodes: NDArray[np.int64], name: str, points: NDArray[np.int64], volume: Volume, chain: str
) -> Vector:
    from_corner_m: Vector = 1e-3 * points * volume.step_mm
    if name in _SHEARS:
        first, second, sign = _SHEARS[name]
        sheared: Vector = (
            sign * from_corner_m[:, second, None, None] * np.eye(3)[first][:, None]
        )
        return sheared
    if name in AXIS_LETTERS:
        axis = AXIS_LETTERS.index(name)
        stretched: Vector = from_corner_m[:, axis, None, None] * np.eye(3)[axis][:, None]
        return stretched
    rotates = name in ROTATIONS
    axis, component = divmod((ROTATIONS if rotates else DISPLACEMENTS).index(name), 3)
    unit = np.eye(3)[component]
    moved = (
        np.cross(unit, abbe_mask(chain)[axis] * from_corner_m)
        if rotates
        else np.broadcast_to(unit, from_corner_m.shape)
    )
    there = points[:, axis, None] == nodes
    effect: Vector = moved[:, :, None] * there[:, None, :]
    return effect
