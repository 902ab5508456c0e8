"""Reported results beside the quantities of a forecast: functions with and without their slope,
reversal, the sum of the scales.
"""

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
"""The weighted sum S = sum L^2 scale / R of the three scales, measured by four diagonals (theory 3,
E5), in um.
"""
REVERSAL_PART = 2


def sloped(name: str) -> str:
    """Return the name of a positioning function with its slope."""
    return f"sloped {name}"


def shape(name: str) -> str:
    """Return the name of a rotation without its end-point line."""
    return f"shape {name}"


def reversal(name: str) -> str:
    """Return the name of the direction-dependent part of a function."""
    return f"reversal {name}"


def backlash(name: str) -> str:
    """Return the name of the direction-dependent part of a function with its value at the low
    end.
    """
    return f"backlash {name}"


def reported(design: Design) -> Quantities:
    """Return the quantities of `solver.model.quantities.quantities` followed by those named
    above."""
    base = quantities(design.columns, design.volume)
    nodes = np.arange(1, design.columns.nodes + 1)
    names, node = list(base.names), [base.node]
    column, value = [_wide(base.combination.column)], [_wide(base.combination.value)]
    for name, part, index, factor in _further(design):
        at = design.columns.of(part, *divmod(index, 3))
        names += [name] * len(at)
        node.append(nodes)
        column.append(_wide(np.column_stack([at, np.full(len(at), at[-1])])))
        value.append(
            _wide(np.column_stack([np.ones(len(at)), -factor * nodes / design.columns.nodes]))
        )
    for index, name in enumerate(
        DISPLACEMENTS if design.columns.play < design.columns.offset else ()
    ):
        at, play = design.columns.of(REVERSAL_PART, *divmod(index, 3)), design.columns.play + index
        names += [backlash(name)] * (len(at) + 1)
        node.append(np.arange(len(at) + 1))
        column.append(
            np.column_stack([np.concatenate([at[:1], at]), np.full((len(at) + 1, 2), play)])
        )
        value.append(
            np.column_stack(
                [np.arange(len(at) + 1) > 0, np.ones(len(at) + 1), np.zeros(len(at) + 1)]
            ).astype(np.float64)
        )
    names.append(SCALE_SUM)
    node.append(np.zeros(1, dtype=np.int64))
    size = np.array(design.volume.size_mm)
    column.append(np.array([[design.columns.of(0, axis, axis)[-1] for axis in range(3)]]))
    value.append(size[None, :] / np.linalg.norm(size))
    return Quantities(
        names=tuple(names),
        node=np.concatenate(node),
        combination=Rows(np.vstack(column), np.vstack(value), design.columns.count),
    )


def _wide(columns: NDArray[Any]) -> NDArray[Any]:
    return np.pad(columns, ((0, 0), (0, 3 - columns.shape[1])))


def _further(design: Design) -> list[tuple[str, int, int, float]]:
    """Return name, part, number in its part, and 1 where the end-point line is removed."""
    parts = design.columns.parts
    found = [(sloped(name), 0, DISPLACEMENTS.index(name), 0.0) for name in POSITIONING]
    found += [(shape(name), 1, index, 1.0) for index, name in enumerate(ROTATIONS) if 1 in parts]
    found += [
        (reversal(name), 2, index, 0.0) for index, name in enumerate(DISPLACEMENTS) if 2 in parts
    ]
    return found


def identified(found: Quantities, inverse: Inverse, usual: Mapping[str, float]) -> dict[str, bool]:
    """Return for every quantity whether the readings determine it fully, and with an uncertainty
    below the ``usual`` size for a machine of its class.

    ``usual`` holds usual sizes by name, in the units of the quantities; a name without a size needs
    only to be determined. A positioning function with its slope is identified if its shape and its
    scale are.
    """
    variances = variance(found, inverse)
    names, number = np.unique(np.array(found.names), return_inverse=True)
    determined = np.bincount(number, weights=~inverse.sees(found.combination)) == 0
    mean_square = np.bincount(number, weights=variances) / np.bincount(number)
    better = np.array(
        [
            square < usual.get(name, np.inf) ** 2
            for name, square in zip(names.tolist(), mean_square, strict=True)
        ]
    )
    known = dict(zip(names.tolist(), (determined & better).tolist(), strict=True))
    for name in POSITIONING:
        if sloped(name) in known:
            known[sloped(name)] &= known.get(name, True) and known[name[-1]]
    return {name: known[name] for name in found.groups}


def variance(found: Quantities, inverse: Inverse) -> Vector:
    """Return the variance of every combination, shape (q,), meaningful for identified ones.

    All but the first unknown of a combination are end nodes: few columns of the covariance suffice,
    whatever the length of the functions.
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
            total += (
                2
                * value[:, first]
                * value[:, second]
                * covariance[column[:, first], place[:, second - 1]]
            )
    positive: Vector = np.maximum(total, 0.0)
    return positive
