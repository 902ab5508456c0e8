"""Targets between the nodes: the deviation of an error function from the straight line between two
nodes is a random effect of the adjustment.

A survey has such targets if a linear run has more targets than the diagonals, if the diagonals have
different increments, or if a 4-DOF head measured at more stops. The deviation is a Brownian bridge
between two neighbouring nodes, zero at both nodes. The standard deviation of the bridge is
estimated from the readings.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import message
from stepdiag.base.result.result import AXIS_LETTERS, DISPLACEMENTS
from stepdiag.base.volume import POSITION_TOLERANCE_MM, Vector
from stepdiag.solver.model.design import between_nodes
from stepdiag.solver.model.effects import Effect
from stepdiag.solver.model.lateral import MeasuredStraightness, nodes_of
from stepdiag.solver.model.layout import Layout

USUAL_UM = 0.5
"""Initial standard deviation of an error function in the middle between two nodes, in um."""
MOST_CAUSES = 600
"""Largest number of random effects between the nodes; above it the adjustment omits the shortest
waves, which are the smallest."""
BETWEEN = "between the nodes"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisBetween:
    """The targets between the nodes of an axis in mm, ascending, and the ``basis`` (positions, r)
    of the random effects at these targets.

    ``alone`` (positions,) marks the targets of a linear run, because only a linear run measures the
    positioning function alone.
    """

    position_mm: Vector
    basis: Vector
    alone: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Between:
    """The targets between the nodes of all axes. The readings at these targets depend on the
    functions ``names``."""

    axes: tuple[AxisBetween, ...]
    names: tuple[str, ...]

    @property
    def count(self) -> int:
        return sum(self.of(name).basis.shape[1] for name in self.names)

    def of(self, name: str) -> AxisBetween:
        return self.axes[DISPLACEMENTS.index(name) // 3]

    def causes_of(self, name: str) -> slice:
        before = self.names[: self.names.index(name)]
        first = sum(self.of(one).basis.shape[1] for one in before)
        return slice(first, first + self.of(name).basis.shape[1])


def between_of(layout: Layout, measured: Sequence[MeasuredStraightness] = ()) -> Between:
    """Return the random effects between the nodes that the readings or a head's passes depend
    on."""
    off = _off_nodes(layout)
    heads = [(one.name, one.position_mm[_head_off_nodes(layout, one)]) for one in measured]
    by_head = {name for name, at_mm in heads if len(at_mm)}
    of_axis = [
        [at_mm for name, at_mm in heads if name[2] == letter] for letter in AXIS_LETTERS
    ]
    axes = tuple(_positions(layout, axis, off, of_axis[axis]) for axis in range(3))
    seen = [
        name
        for index, name in enumerate(DISPLACEMENTS)
        if name in by_head
        or (
            np.any(np.abs(layout.direction[off[:, index // 3], index % 3]) > 1e-9)
            and axes[index // 3].basis.size
        )
    ]
    found = Between(axes=axes, names=tuple(seen))
    if found.count <= MOST_CAUSES:
        return found
    share = MOST_CAUSES / found.count
    return Between(
        axes=tuple(_longest(axis, layout, number, share) for number, axis in enumerate(axes)),
        names=tuple(seen),
    )


def effect_between(layout: Layout, between: Between) -> Effect:
    """Return the effect on the readings of the functions' deviations between the nodes."""
    off = _off_nodes(layout)
    pattern = np.zeros((len(layout), between.count))
    for name in between.names:
        axis, component = divmod(DISPLACEMENTS.index(name), 3)
        rows = np.flatnonzero(off[:, axis])
        place = _places(between.of(name).position_mm, layout.position_mm[rows, axis])
        pattern[rows, between.causes_of(name)] = (
            layout.direction[rows, component, None] * between.of(name).basis[place]
        )
    text = message("assumed-between")
    return Effect(name=BETWEEN, text=text, pattern_um=pattern, sought=True)


def between_beside_head(
    layout: Layout, measured: Sequence[MeasuredStraightness], between: Between
) -> Vector:
    """Return the effect on the head's values of the functions' deviations between the nodes,
    shape (rows, random effects)."""
    pieces = [np.zeros((0, between.count))]
    for one in measured:
        rows = np.flatnonzero(_head_off_nodes(layout, one))
        effect = np.zeros((len(one.position_mm), between.count))
        if len(rows):
            of = between.of(one.name)
            effect[rows, between.causes_of(one.name)] = of.basis[
                _places(of.position_mm, one.position_mm[rows])
            ]
        pieces.append(effect)
    return np.vstack(pieces)


def _off_nodes(layout: Layout) -> NDArray[np.bool_]:
    _, fraction = between_nodes(layout.volume, layout.position_mm)
    travels = np.array([setup.signs for setup in layout.setups])[layout.setup_index] != 0
    found: NDArray[np.bool_] = (fraction > 0) & (fraction < 1) & travels
    return found


def _head_off_nodes(layout: Layout, one: MeasuredStraightness) -> NDArray[np.bool_]:
    _, fraction = nodes_of(layout.volume, AXIS_LETTERS.index(one.name[2]), one)
    found: NDArray[np.bool_] = (fraction > 0) & (fraction < 1)
    return found


def _positions(
    layout: Layout, axis: int, off: NDArray[np.bool_], of_head_mm: Sequence[Vector]
) -> AxisBetween:
    ordered = np.sort(np.concatenate([layout.position_mm[off[:, axis], axis], *of_head_mm]))
    positions = ordered[np.diff(ordered, prepend=-np.inf) > POSITION_TOLERANCE_MM]
    moved = np.abs(np.array([setup.signs for setup in layout.setups]))[layout.setup_index]
    single = layout.position_mm[off[:, axis] & (np.sum(moved, axis=1) == 1), axis]
    alone = np.isin(np.arange(len(positions)), _places(positions, single))
    return _axis(layout, axis, positions, alone, np.inf)


def _axis(
    layout: Layout, axis: int, position_mm: Vector, alone: NDArray[np.bool_], waves: float
) -> AxisBetween:
    steps = (
        (position_mm - layout.volume.origin_mm[axis])
        / layout.volume.length_mm[axis]
        * layout.volume.increments
    )
    cell = np.floor(steps).astype(np.int64)
    pieces = []
    for number in np.unique(cell):
        mine = np.flatnonzero(cell == number)
        share = steps[mine] - number
        bridge = 4.0 * (np.minimum(share[:, None], share) - share[:, None] * share)
        size, shape = np.linalg.eigh(bridge)
        kept = np.arange(len(mine))[::-1][: int(min(len(mine), waves))]
        piece = np.zeros((len(position_mm), len(kept)))
        piece[mine] = USUAL_UM * shape[:, kept] * np.sqrt(np.maximum(size[kept], 0.0))
        pieces.append(piece)
    return AxisBetween(
        position_mm=position_mm,
        basis=np.hstack([np.zeros((len(position_mm), 0)), *pieces]),
        alone=alone,
    )


def _longest(axis: AxisBetween, layout: Layout, number: int, share: float) -> AxisBetween:
    volume = layout.volume
    steps = (
        (axis.position_mm - volume.origin_mm[number])
        / volume.length_mm[number]
        * volume.increments
    )
    cells = max(len(np.unique(np.floor(steps))), 1)
    return _axis(
        layout,
        number,
        axis.position_mm,
        axis.alone,
        max(np.floor(share * axis.basis.shape[1] / cells), 1.0),
    )


def _places(positions: Vector, wanted: Vector) -> NDArray[np.int64]:
    found: NDArray[np.int64] = np.searchsorted(positions, wanted, side="right") - 1
    return found
