"""Prior knowledge as rows of the adjustment: known angular functions with their uncertainty, and
conventions."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.names import AXES
from stepdiag.base.result.result import ROTATIONS
from stepdiag.base.volume import Vector
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.angles import Angles, KnownAngle, angle_at_nodes
from stepdiag.solver.model.design import Columns, Design, rotation_coefficients
from stepdiag.solver.model.layout import Layout

EXACT = 1e-3
"""Standard uncertainty (urad, um) of values fixed by a convention: smaller than any measurable
value, larger than rounding."""
DRIFT_UM = 1.0
"""Prior standard uncertainty of the drift during an outward pass and its return pass."""
REVERSAL_CHANGE_UM = 2.0
"""Prior standard uncertainty of the change of a reversal along its axis. In an out-and-back pair,
drift and a growing reversal have the same effect. If the prior uncertainty of one were much
smaller, the other would absorb the whole effect."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prior:
    """Rows of the adjustment with the target zero and a standard uncertainty.

    ``found`` contains groups of rows; the adjustment increases the uncertainty of a group if the
    readings show larger values. ``misses`` are the rows of the positioning deviations of the moves.
    """

    rows: Rows
    u: Vector
    found: tuple[NDArray[np.int64], ...]
    misses: NDArray[np.int64]


def angular_effect_um(layout: Layout, chain: str, angles: Angles) -> Vector:
    """Return the effect of known angular functions on every reading in um, shape (m,) (theory 4.3).

    Raises ``DataError`` if a function does not cover the travel of its axis.
    """
    arms = rotation_coefficients(layout, chain)
    total = np.zeros(len(layout))
    for name, known in angles.items():
        axis, component = divmod(ROTATIONS.index(name), 3)
        angle_at_nodes(known, name, layout.volume)
        at_corner = np.interp(
            layout.volume.origin_mm[axis], known.position_mm, known.value_urad
        )
        total += arms[:, axis, component] * (
            np.interp(layout.position_mm[:, axis], known.position_mm, known.value_urad)
            - at_corner
        )
    return total


def has_stated_u(angles: Angles) -> bool:
    """Return whether any angular function has an uncertainty; a function with an uncertainty is
    an observation, not a constant."""
    return any(bool(np.any(np.isfinite(known.u_urad))) for known in angles.values())


def make_prior(design: Design, angles: Angles, *, free_angles: bool = False) -> Prior:
    """Return the prior rows for the known angular functions, the changes of the reversals along
    their axes, the drifts, and the positioning deviations of the moves (with 1 um;
    `solver.adjustment.scatter` estimates their size).

    An adjusted angular function may differ from the known function by the stated uncertainty of the
    known function. ``free_angles`` omits the rows of angular functions, so that the caller can test
    whether the readings determine them.
    """
    columns = design.columns
    pieces: list[tuple[NDArray[np.int64], Vector, float | Vector]] = []
    if 1 in columns.parts and not free_angles:
        for index, name in enumerate(ROTATIONS):
            nodes = columns.of(1, *divmod(index, 3))[:, None]
            pieces.append((nodes, np.ones(nodes.shape), _difference_u(name, angles, design)))
    held = sum(len(column) for column, _, _ in pieces)
    changes = []
    if 2 in columns.parts:
        changes = [_reversal_changes(columns, *divmod(index, 3)) for index in range(9)]
    change_um = REVERSAL_CHANGE_UM / np.sqrt(columns.nodes)
    pieces += [(*change, change_um) for change in changes]
    drifts = np.zeros((0, 1), dtype=np.int64)
    if changes:
        drifts = np.arange(columns.drift, columns.line)[:, None]
    spans = np.array(design.drift_spans[: len(drifts)])
    pieces.append((drifts, np.ones(drifts.shape), DRIFT_UM / spans))
    moves = np.arange(columns.miss, columns.count)[:, None]
    pieces.append((moves, np.ones(moves.shape), 1.0))
    changing = len(changes) * columns.nodes
    found = np.arange(held, held + changing + len(drifts))
    groups = np.split(found, [changing])
    width = max((column.shape[1] for column, _, _ in pieces), default=1)
    column = [_widened(column, width) for column, _, _ in pieces]
    value = [_widened(value, width) for _, value, _ in pieces]
    u = [np.broadcast_to(u, len(column)) for column, _, u in pieces]
    rows = Rows(
        np.vstack([np.zeros((0, width), dtype=np.int64), *column]).astype(np.int64),
        np.vstack([np.zeros((0, width)), *value]),
        columns.count,
    )
    misses = np.arange(len(rows) - len(moves), len(rows))
    return Prior(
        rows=rows,
        u=np.concatenate([np.zeros(0), *u]),
        found=tuple(group for group in groups if len(group)),
        misses=misses,
    )


def _widened(matrix: NDArray[Any], width: int) -> NDArray[Any]:
    return np.pad(matrix, ((0, 0), (0, width - matrix.shape[1])))


def origin_pattern(design: Design, angles: Angles, count: int) -> Vector:
    """Return the effect of the error of each known angular function's first value on the
    ``count`` rows of `make_prior`, shape (count, k). A head measures angles relative to its
    first position, so all values have the error of the first value."""
    names = []
    if 1 in design.columns.parts:
        given = [name for name in ROTATIONS if name in angles]
        names = [name for name in given if np.isfinite(angles[name].u_urad[0])]
    nodes = design.columns.nodes
    pattern = np.zeros((count, len(names)))
    for place, name in enumerate(names):
        first = ROTATIONS.index(name) * nodes
        pattern[first : first + nodes, place] = _first_u(angles[name], design, name)
    return pattern


def _first_u(known: KnownAngle, design: Design, name: str) -> float:
    low = design.volume.origin_mm[AXES.index(name[2].lower())]
    return float(np.interp(low, known.position_mm, known.u_urad))


def _difference_u(name: str, angles: Angles, design: Design) -> float | Vector:
    if name not in angles:
        return EXACT
    _, u = angle_at_nodes(angles[name], name, design.volume)
    floored: Vector = np.maximum(np.where(np.isfinite(u), u, EXACT), EXACT)
    return floored


def _reversal_changes(
    columns: Columns, axis: int, component: int
) -> tuple[NDArray[np.int64], Vector]:
    """Return the rows with which a reversal is assumed equal at neighbouring nodes.

    Backlash hardly depends on position. Drift and a reversal that grows along all axes have the
    same effect, but drift is more likely.
    """
    at = columns.of(2, axis, component)
    before = np.concatenate([at[:1], at[:-1]])
    has_before = np.arange(len(at)) > 0
    value = np.column_stack([np.ones(len(at)), -1.0 * has_before])
    return np.column_stack([at, before]), value
