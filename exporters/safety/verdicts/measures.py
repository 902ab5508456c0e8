"""How large a movement is, and when two are alike: what every comparison of a table with a result counts by."""

import numpy as np

from stepdiag.base.volume import Vector, Volume

POINTS = 61
"""Points along an axis at which two movements are compared."""
SAME = 0.4
"""What a table may leave of what it should correct and still be the right one."""
SIZED = 0.15
"""By what share a table may be larger or smaller than the right one: rounding stays below it in every export."""
SPIKE = 3.0
"""How often the rounding, the uncertainty or the share above a table may differ at one place: about the largest of a normal scatter."""
ALIKE = 0.9
"""Correlation from which a table counts as the right one in another size."""
SURE_UM = 0.2
"""Movements below this are not separated from rounding and noise."""
NODES = 9
"""Points along each axis at which two fields are compared."""


def growing_um(values: Vector, moving: int, by: int) -> Vector:
    """Return, at the nodes of the axis ``moving``, what of values on a grid grows with the lever along ``by``, at the end of the lever."""
    (other,) = {0, 1, 2} - {moving, by}
    lever = np.linspace(-1.0, 1.0, NODES)
    flat = np.mean(np.moveaxis(_without_curves(values), (moving, by, other), (0, 1, 2)), axis=2)
    return np.asarray(flat @ lever / np.sum(lever**2))


def grid_mm(volume: Volume) -> Vector:
    """Return the points at which fields are compared, shape (nodes ** 3, 3), z fastest."""
    axes = [low + size * np.linspace(0.0, 1.0, NODES) for low, size in zip(volume.origin_mm, volume.size_mm, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _without_curves(values: Vector) -> Vector:
    """Return what is left of values on a grid without their means along each axis: no curve of one axis can hold it."""
    left = values - np.mean(values)
    for axes in ((1, 2), (0, 2), (0, 1)):
        left = left - np.mean(left, axis=axes, keepdims=True)
    return np.asarray(left)


def centred(values: Vector) -> Vector:
    return np.asarray(values - np.mean(values))
