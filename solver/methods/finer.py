"""A positioning function at the nodes and at the targets of a finer linear run."""

from dataclasses import replace

import numpy as np

from stepdiag.base.result.result import POSITIONING, Function
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.between import BETWEEN
from stepdiag.solver.model.quantities import Quantities
from stepdiag.solver.uncertainty.spread import Spread, deviation

NEAR = 0.05
"""Share of an increment within which a position is treated as the node: the slope between two
positions this close would be noise."""


def finer(
    found: Adjustment,
    spread: Spread,
    quantities: Quantities,
    stands_as: str,
    function: Function,
    name: str,
) -> Function:
    """Return a function of the result with its values between the nodes. ``stands_as`` is the
    name of the quantity."""
    if (
        name not in found.between.names
        or function.value is None
        or function.u is None
        or function.u_readings is None
    ):
        return function
    off = found.between.of(name)
    volume, axis = found.layout.volume, POSITIONING.index(name)
    steps = (off.position_mm - volume.origin_mm[axis]) / volume.step_mm[axis]
    apart = off.alone & (np.abs(steps - np.round(steps)) > NEAR)
    position_mm, basis = off.position_mm[apart], off.basis[apart]
    if not len(position_mm):
        return function
    rows = _between_rows(found, quantities, stands_as, position_mm, axis)
    on_causes = np.zeros((len(position_mm), len(spread.fit.size)))
    first = found.first_cause(BETWEEN)
    own = found.between.causes_of(name)
    on_causes[:, first + own.start : first + own.stop] = basis
    moved = spread.moved(rows, on_causes)
    alone = np.maximum(
        np.sum(rows.dense() * spread.fit.inverse.solve(rows.dense().T).T, axis=1), 0.0
    )
    by_readings = spread.variance_by_readings(moved)
    order = np.argsort(np.concatenate([function.position_mm, position_mm]), kind="stable")

    def joined(at_nodes: Vector, between: Vector) -> Vector:
        return np.concatenate([at_nodes, between])[order]

    return replace(
        function,
        position_mm=joined(function.position_mm, position_mm),
        value=joined(
            function.value, rows.times(spread.fit.unknowns) + on_causes @ spread.fit.amount
        ),
        u=joined(
            function.u, deviation(alone + np.maximum(spread.variance(moved), by_readings))
        ),
        u_readings=joined(function.u_readings, deviation(alone + by_readings)),
    )


def _between_rows(
    found: Adjustment, quantities: Quantities, stands_as: str, position_mm: Vector, axis: int
) -> Rows:
    volume, mine = found.layout.volume, quantities.of(stands_as)
    at_nodes = quantities.combination.select(mine)
    dense = np.zeros((volume.increments + 1, at_nodes.count))
    dense[quantities.node[mine]] = at_nodes.dense()
    steps = (position_mm - volume.origin_mm[axis]) / volume.step_mm[axis]
    lower = np.floor(steps).astype(np.int64)
    share = (steps - lower)[:, None]
    value = (1.0 - share) * dense[lower] + share * dense[lower + 1]
    return Rows(
        np.broadcast_to(np.arange(at_nodes.count), value.shape), value, at_nodes.count
    )
