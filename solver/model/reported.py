"""Results that a forecast does not contain: functions with or without their slope, the reversal,
the sum of the scales."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.result.result import DISPLACEMENTS, POSITIONING, ROTATIONS
from stepdiag.base.volume import Vector
from stepdiag.solver.linear.least_squares import Inverse
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.design import Design
from stepdiag.solver.model.quantities import Quantities, quantities

SCALE_SUM = "scale sum"
"""The sum S = sum L^2 scale / R of the three scales in um, which four diagonals measure (theory
3, E5)."""
REVERSAL_PART = 2


def sloped(name: str) -> str:
    return f"sloped {name}"


def shape(name: str) -> str:
    return f"shape {name}"


def reversal(name: str) -> str:
    return f"reversal {name}"


def backlash(name: str) -> str:
    """Return the name of a function's reversal including the reversal at the low end of the
    axis."""
    return f"backlash {name}"


def reported(design: Design) -> Quantities:
    """Return all results: the quantities of `solver.model.quantities.quantities`, followed by
    those of this module."""
    columns = design.columns
    base = quantities(columns, design.volume)
    nodes = np.arange(1, columns.nodes + 1)
    names = list(base.names)
    node = [base.node]
    column = [_wide(base.combination.column)]
    value = [_wide(base.combination.value)]
    for name, part, index, factor in _further(design):
        at = columns.of(part, *divmod(index, 3))
        last = np.full(len(at), at[-1])
        line = -factor * nodes / columns.nodes
        names += [name] * len(at)
        node.append(nodes)
        column.append(_wide(np.column_stack([at, last])))
        value.append(_wide(np.column_stack([np.ones(len(at)), line])))
    has_backlash = columns.play < columns.offset
    for index, name in enumerate(DISPLACEMENTS if has_backlash else ()):
        at = columns.of(REVERSAL_PART, *divmod(index, 3))
        count = len(at) + 1
        play = np.full((count, 2), columns.play + index)
        changes = np.concatenate([at[:1], at])
        changed = np.arange(count) > 0
        factors = np.column_stack([changed, np.ones(count), np.zeros(count)])
        names += [backlash(name)] * count
        node.append(np.arange(count))
        column.append(np.column_stack([changes, play]))
        value.append(factors.astype(np.float64))
    names.append(SCALE_SUM)
    node.append(np.zeros(1, dtype=np.int64))
    size = np.array(design.volume.size_mm)
    ends = [columns.of(0, axis, axis)[-1] for axis in range(3)]
    column.append(np.array([ends]))
    value.append(size[None, :] / np.linalg.norm(size))
    combination = Rows(np.vstack(column), np.vstack(value), columns.count)
    return Quantities(names=tuple(names), node=np.concatenate(node), combination=combination)


def _wide(columns: NDArray[Any]) -> NDArray[Any]:
    return np.pad(columns, ((0, 0), (0, 3 - columns.shape[1])))


def _further(design: Design) -> list[tuple[str, int, int, float]]:
    parts = design.columns.parts
    found = [(sloped(name), 0, DISPLACEMENTS.index(name), 0.0) for name in POSITIONING]
    found += [
        (shape(name), 1, index, 1.0) for index, name in enumerate(ROTATIONS) if 1 in parts
    ]
    found += [
        (reversal(name), 2, index, 0.0)
        for index, name in enumerate(DISPLACEMENTS)
        if 2 in parts
    ]
    return found


def identified(
    found: Quantities, inverse: Inverse, usual: Mapping[str, float]
) -> dict[str, bool]:
    """Return for every quantity whether it is identified: the readings determine all its values
    with an uncertainty below its ``usual`` size.

    ``usual`` contains the usual sizes of the machine's class by name, in the units of the
    quantities. A positioning function with its slope is identified if its shape and its scale are
    identified.
    """
    variances = variance(found, inverse)
    names, number = np.unique(np.array(found.names), return_inverse=True)
    determined = np.bincount(number, weights=~inverse.sees(found.combination)) == 0
    mean_square = np.bincount(number, weights=variances) / np.bincount(number)
    largest = np.array([usual.get(name, np.inf) ** 2 for name in names.tolist()])
    is_known = determined & (mean_square < largest)
    known = dict(zip(names.tolist(), is_known.tolist(), strict=True))
    for name in POSITIONING:
        if sloped(name) in known:
            known[sloped(name)] &= known.get(name, True) and known[name[-1]]
    return {name: known[name] for name in found.groups}


def variance(found: Quantities, inverse: Inverse) -> Vector:
    """Return the variance of every quantity, shape (q,). The variance of a quantity that is not
    identified has no meaning.

    Few columns of the covariance are needed, because all unknowns of a combination except the first
    are end nodes.
    """
    column, value = found.combination.column, found.combination.value
    ends, place = np.unique(column[:, 1:], return_inverse=True)
    place = place.reshape(len(column), -1)
    unit = np.zeros((found.combination.count, len(ends)))
    unit[ends, np.arange(len(ends))] = 1.0
    covariance = inverse.solve(unit)
    total = np.sum(value**2 * inverse.variance()[column], axis=1)
    for second in range(1, column.shape[1]):
        for first in range(second):
            shared = covariance[column[:, first], place[:, second - 1]]
            total += 2 * value[:, first] * value[:, second] * shared
    positive: Vector = np.maximum(total, 0.0)
    return positive
