"""The stops of step diagonals and edges, written once more from the definition of the method."""

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.names import AXES
from stepdiag.base.volume import Vector, Volume


def diagonal_stops_mm(volume: Volume, diagonal: str, order: str = "xyz") -> Vector:
    """Return the commanded positions of the outward pass, shape (3n+1, 3)."""
    nodes = diagonal_nodes(volume.increments, diagonal, order)
    stops: Vector = np.array(volume.origin_mm) + np.array(volume.step_mm) * nodes
    return stops


def diagonal_nodes(increments: int, diagonal: str, order: str) -> NDArray[np.int64]:
    """Return the node of every axis at every stop, shape (3n+1, 3): each step moves one axis, in
    the order given, from its low end (p) or from its high end (n)."""
    node = [0 if letter == "p" else increments for letter in diagonal]
    nodes = [list(node)]
    for _ in range(increments):
        for letter in order:
            axis = AXES.index(letter)
            node[axis] += 1 if diagonal[axis] == "p" else -1
            nodes.append(list(node))
    return np.array(nodes, dtype=np.int64)


def linear_stops_mm(volume: Volume, setup: str) -> Vector:
    """Return the commanded positions of a run along one edge, shape (n+1, 3)."""
    axis = AXES.index(setup[-1])
    stops = np.tile(np.array(volume.origin_mm, dtype=np.float64), (volume.increments + 1, 1))
    stops[:, axis] = volume.nodes_mm(axis)
    return stops
