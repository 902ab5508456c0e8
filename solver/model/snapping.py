"""Where the machine stood: each reported position belongs to one target, by one rounding.

A register holds a commanded position with few decimals, or the position of an encoder that scatters by micrometres. Both differ from the
target, and so does the reading, by the same way. So a stop gets the coordinates of its target, and its deviation counts from
the position that the machine reported (`solver.model.layout`). All further columns of the model see targets only: which directions the
readings determine then follows from whole numbers of increments, and no scatter of positions makes an unseen direction look seen.
"""

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.geometry.volume import Vector, Volume

POSITION_TOLERANCE_MM = 0.1
"""Positions closer than this are one target. A program with one decimal is off by 0.05 mm, and a G91 program adds up its rounding; an error
function changes by a nanometre over such a way, which `solver.adjustment` takes off as well."""
SHARE_OF_STEP = 0.25
"""Of an increment: targets of the finest survey must not become one."""
EDGE_TOLERANCE_MM = 0.005
"""An edge of the box is a multiple of `EDGE_STEP_MM` where it lies so close to one: a drawing has few decimals, a register flickers."""
EDGE_STEP_MM = 0.1


def snapped_mm(volume: Volume, position_mm: Vector) -> Vector:
    """Return the target of each reported position, shape (m, 3): a node, or where no node is near the mean of the positions there."""
    snapped = position_mm.copy()
    for axis in range(3):
        tolerance = min(POSITION_TOLERANCE_MM, SHARE_OF_STEP * float(volume.step_mm[axis]))
        nodes = volume.nodes_mm(axis)
        nearest = nodes[np.clip(np.rint((position_mm[:, axis] - nodes[0]) / volume.step_mm[axis]), 0, volume.increments).astype(np.int64)]
        on_node = np.abs(position_mm[:, axis] - nearest) <= tolerance
        snapped[on_node, axis] = nearest[on_node]
        snapped[~on_node, axis] = _clustered(position_mm[~on_node, axis], tolerance)
    return snapped


def _clustered(position_mm: Vector, tolerance_mm: float) -> Vector:
    """Return the mean of the positions that lie together with each, shape (k,): a gap wider than the tolerance parts two targets."""
    if not len(position_mm):
        return position_mm
    order = np.argsort(position_mm, kind="stable")
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.cumsum(np.diff(position_mm[order], prepend=position_mm[order[0]]) > tolerance_mm)
    mean: Vector = np.round(np.bincount(number, weights=position_mm) / np.bincount(number), 6)[number]
    return mean


def box_edge_mm(position_mm: Vector, extreme_mm: Vector) -> Vector:
    """Return the edge of the box where positions (m, 3) reach ``extreme_mm`` (3,): the median of those that lie there, shape (3,)."""
    edge = np.empty(3)
    for axis in range(3):
        at_edge = position_mm[np.abs(position_mm[:, axis] - extreme_mm[axis]) <= POSITION_TOLERANCE_MM, axis]
        median = float(np.quantile(at_edge, 0.5))
        plain = round(round(median / EDGE_STEP_MM) * EDGE_STEP_MM, 1)
        edge[axis] = plain if abs(plain - median) <= EDGE_TOLERANCE_MM else median
    return edge


def arrivals(position_mm: Vector, pass_index: NDArray[np.int64], turned: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return which move brought each axis to its target, numbered over the survey, -1 for an axis that stands in its pass, shape (m, 3).

    An axis that stands keeps its place (`solver.adjustment.scatter`). A pass begins with an arrival of its own, unless the machine
    ``turned`` round at its first stop: then it stands where the pass before ended.
    """
    first = np.diff(pass_index, prepend=-1) != 0
    moved = np.diff(position_mm, axis=0, prepend=np.nan) != 0
    stays = turned & ~moved.any(axis=1)
    came = np.where(first[:, None], ~stays[:, None], moved)
    travels = np.zeros((int(pass_index.max(initial=-1)) + 1, 3), dtype=np.bool_)
    np.logical_or.at(travels, pass_index, moved & ~first[:, None])
    number = np.where(travels[pass_index], 3 * np.cumsum(came, axis=0) + np.arange(3), -1)
    stands = int(np.any(number < 0))
    return np.unique(number, return_inverse=True)[1].reshape(came.shape).astype(np.int64) - stands
