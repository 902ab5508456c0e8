"""The target of each position that the machine reports.

A position register contains a commanded position with few decimals, or an encoder position with a
scatter of micrometres. Reported position and reading differ from the target by the same amount. So
the model uses the coordinates of the target, and the deviation refers to the reported position
(`solver.model.layout`). All other columns of the model depend on targets alone: the scatter of
positions cannot make an undetermined quantity appear determined.
"""

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import POSITION_TOLERANCE_MM, Vector, Volume

EDGE_TOLERANCE_MM = 0.005
"""Largest distance in mm over which an edge of the box is rounded to a multiple of 0.1 mm: drawings
have few decimals, and registers scatter. If a whole millimetre is within the scatter of the stops,
the edge is rounded to it."""


def snapped_mm(
    volume: Volume, position_mm: Vector, tolerance_mm: Vector | None = None
) -> Vector:
    """Return the target of each reported position, shape (m, 3): the nearest node, or the mean of
    the reported positions at this place if no node is near.

    ``tolerance_mm`` (3,) is the largest distance of a stop from its target, by default that of the
    volume.
    """
    snapped = position_mm.copy()
    # twice the tolerance: one for the stop, one for the node or the neighbouring stop
    near_mm = 2.0 * (volume.tolerance_mm if tolerance_mm is None else tolerance_mm)
    for axis in range(3):
        nodes = volume.nodes_mm(axis)
        step = float(volume.length_mm[axis]) / volume.increments
        nearest = nodes[
            np.clip(
                np.rint((position_mm[:, axis] - nodes[0]) / step), 0, volume.increments
            ).astype(np.int64)
        ]
        on_node = np.abs(position_mm[:, axis] - nearest) <= near_mm[axis]
        snapped[on_node, axis] = nearest[on_node]
        snapped[~on_node, axis] = _clustered(
            position_mm[~on_node, axis], float(near_mm[axis])
        )
    return snapped


def _clustered(position_mm: Vector, near_mm: float) -> Vector:
    """Return, for each position, the mean of its cluster, shape (k,). Two clusters are separated by
    a gap wider than the tolerance."""
    if not len(position_mm):
        return position_mm
    order = np.argsort(position_mm, kind="stable")
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.cumsum(
        np.diff(position_mm[order], prepend=position_mm[order[0]]) > near_mm
    )
    mean: Vector = np.round(
        np.bincount(number, weights=position_mm) / np.bincount(number), 6
    )[number]
    return mean


def shared_mm(volume: Volume, axis: int, position_mm: Vector, target_mm: Vector) -> Vector:
    """Return the target of each position along an axis, shape (k,): a near entry of ``target_mm``,
    otherwise the mean of the cluster (`snapped_mm`)."""
    known = np.unique(np.concatenate([target_mm, volume.nodes_mm(axis)]))
    place = np.clip(np.searchsorted(known, position_mm), 1, len(known) - 1)
    below, above = known[place - 1], known[place]
    nearest = np.where(position_mm - below < above - position_mm, below, above)
    near_mm = 2.0 * float(volume.tolerance_mm[axis])
    is_near = np.abs(nearest - position_mm) <= near_mm
    return np.where(is_near, nearest, _clustered(position_mm, near_mm))


def edges_mm(position_mm: Vector, steps: NDArray[np.int64]) -> tuple[float, float]:
    """Return the low and the high edge of the box along an axis, from positions (k,) that include
    both edges.

    ``steps`` (k,) is the number of equal steps from edge to edge in the pass of each position. The
    edges are fitted to all stops, because the stop at a corner scatters. If the positions are not
    equally spaced, the edges are their extremes.
    """
    low, high = float(np.min(position_mm)), float(np.max(position_mm))
    if high - low <= 2.0 * POSITION_TOLERANCE_MM:
        standing = _rounded(float(np.quantile(position_mm, 0.5)), EDGE_TOLERANCE_MM)
        return standing, standing
    step = np.rint((position_mm - low) / (high - low) * steps)
    share = step / steps
    ends = np.column_stack([1.0 - share, share])
    fitted = np.linalg.lstsq(ends, position_mm, rcond=None)[0]
    off = float(np.max(np.abs(position_mm - ends @ fitted)))
    if off > 2.0 * POSITION_TOLERANCE_MM:
        return _rounded(low, EDGE_TOLERANCE_MM), _rounded(high, EDGE_TOLERANCE_MM)
    slack = max(off, EDGE_TOLERANCE_MM)
    return _rounded(float(fitted[0]), slack), _rounded(float(fitted[1]), slack)


def _rounded(edge_mm: float, slack_mm: float) -> float:
    """Return an edge of the box, rounded to whole mm if this changes the edge by at most
    ``slack_mm``. Otherwise try a multiple of 0.1 mm in the same way, or return the edge
    unchanged."""
    for decimals in (0, 1):
        if abs(round(edge_mm, decimals) - edge_mm) <= slack_mm:
            return round(edge_mm, decimals) + 0.0
    return round(edge_mm, 6) + 0.0


def arrivals(
    position_mm: Vector, pass_index: NDArray[np.int64], turned: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return the number of the move that brought each axis to its target, counted over the survey,
    -1 for an axis that does not move in its pass, shape (m, 3).

    A pass begins with a new arrival, unless the machine reversed at its first stop (``turned``):
    the arrival is then that of the previous pass.
    """
    first = np.diff(pass_index, prepend=-1) != 0
    moved = np.diff(position_mm, axis=0, prepend=np.nan) != 0
    stays = turned & ~moved.any(axis=1)
    came = np.where(first[:, None], ~stays[:, None], moved)
    passes = int(pass_index.max(initial=-1)) + 1
    travels = np.zeros((passes, 3), dtype=np.bool_)
    np.logical_or.at(travels, pass_index, moved & ~first[:, None])
    numbered = 3 * np.cumsum(came, axis=0) + np.arange(3)
    number = np.where(travels[pass_index], numbered, -1)
    stands = int(np.any(number < 0))
    _, rank = np.unique(number, return_inverse=True)
    return rank.reshape(came.shape).astype(np.int64) - stands
