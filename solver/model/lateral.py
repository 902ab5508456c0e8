"""Straightness measured by the 4-DOF head, as rows of the adjustment.

    value = D_c(a) + (alpha_a(a) x r_a)_c + approach / 2 * R_c(a) + offset + slope * (a - low)

for component c of axis a on the line through the low corner of the volume (theory 2.2, 4.3). Offset
and slope are the alignment of the head: they are unknowns of every pass and lateral direction and
do not affect the squareness. The rows of the head and of the diagonals are weighted by their
uncertainties.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.kinematics import abbe_mask, cross_matrix
from stepdiag.base.messages import message
from stepdiag.base.readings.snapping import shared_mm, snapped_mm
from stepdiag.base.result.result import AXIS_LETTERS, DISPLACEMENTS, ROTATIONS
from stepdiag.base.volume import POSITION_TOLERANCE_MM, Vector, Volume
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.angles import Angles
from stepdiag.solver.model.design import Design, between_nodes
from stepdiag.solver.model.effects import AngleShapes
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import LEAST_U_UM


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredStraightness:
    """A pass of the head in one lateral direction: ``name`` is EYX .. EYZ, positions in mm, values
    and standard uncertainties in um.

    ``approach`` is +1 for travel in + and -1 for travel in -. A straight line in the values has no
    effect on the result.
    """

    name: str
    position_mm: Vector
    value_um: Vector
    u_um: Vector
    approach: int = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Observed:
    """Rows of the adjustment, with the measured value of each row and its standard uncertainty
    in um."""

    rows: Rows
    target: Vector
    u: Vector


def at_targets(
    measured: Sequence[MeasuredStraightness], layout: Layout
) -> list[MeasuredStraightness]:
    """Return the head's passes with positions moved to their targets; a near target of the laser is
    preferred. The values are corrected by the slope of the pass, which is mainly the head's
    alignment."""
    found = list(measured)
    for axis, letter in enumerate(AXIS_LETTERS):
        mine = [index for index, one in enumerate(measured) if one.name[2] == letter]
        if not mine:
            continue
        together = np.concatenate([measured[index].position_mm for index in mine])
        targets = shared_mm(layout.volume, axis, together, layout.position_mm[:, axis])
        ends = np.cumsum([len(measured[index].position_mm) for index in mine])[:-1]
        for index, target_mm in zip(mine, np.split(targets, ends), strict=True):
            one = measured[index]
            slope = _slope(one.position_mm, one.value_um)
            found[index] = replace(
                one,
                position_mm=target_mm,
                value_um=one.value_um + slope * (target_mm - one.position_mm),
            )
    return found


def _slope(position_mm: Vector, value_um: Vector) -> float:
    away = position_mm - np.mean(position_mm)
    square = float(away @ away)
    return float(away @ value_um) / square if square else 0.0


def lateral_rows(
    design: Design, measured: Sequence[MeasuredStraightness], angles: Angles
) -> Observed:
    """Return the rows of the head's passes; ``design`` requires ``Model.lines = len(measured)``.

    Raises ``DataError`` for a position outside the volume.
    """
    pieces = [_rows_of(design, number, one) for number, one in enumerate(measured)]
    empty = (np.zeros((0, 1), dtype=np.int64), np.zeros((0, 1)))
    columns, values = zip(*(pieces or [empty]), strict=True)
    targets = [one.value_um - of_known_angles(design, one, angles) for one in measured]
    u_um = [np.maximum(one.u_um, LEAST_U_UM) for one in measured]
    return Observed(
        rows=Rows(np.vstack(columns), np.vstack(values), design.columns.count),
        target=np.concatenate([np.zeros(0), *targets]),
        u=np.concatenate([np.zeros(0), *u_um]),
    )


def lateral_angles(
    design: Design, measured: Sequence[MeasuredStraightness], shapes: AngleShapes
) -> Vector:
    """Return the effect of the unknown angular functions on the head's values, shape (rows,
    random effects)."""
    pieces = [np.zeros((0, len(shapes.names) * (shapes.waves + 1)))]
    for one in measured:
        axis, component = divmod(DISPLACEMENTS.index(one.name), 3)
        arms = _arms(design, axis, component, one.position_mm)
        share = _share_of_travel(design, axis, one)
        effect = np.zeros((len(share), pieces[0].shape[1]))
        for about, name in enumerate(ROTATIONS[3 * axis : 3 * axis + 3]):
            if name in shapes.names:
                at_full_arm = shapes.range_of(name) * arms[:, about, None]
                effect[:, shapes.causes_of(name)] = at_full_arm * shapes.at(share)
        pieces.append(effect)
    return np.vstack(pieces)


def _rows_of(
    design: Design, number: int, one: MeasuredStraightness
) -> tuple[NDArray[np.int64], Vector]:
    """Return columns and values of the rows of a pass, shape (k, 12): two nodes each of the
    displacement, three rotations and the reversal, then offset and slope."""
    columns = design.columns
    axis, component = divmod(DISPLACEMENTS.index(one.name), 3)
    lower, fraction = nodes_of(design.volume, axis, one)
    terms = [(0, component, np.ones(len(lower)))]
    if 1 in columns.parts:
        arms = _arms(design, axis, component, one.position_mm)
        terms += [(1, about, arms[:, about]) for about in range(3)]
    if 2 in columns.parts:
        terms.append((2, component, np.full(len(lower), one.approach / 2.0)))
    column = np.zeros((len(lower), 12), dtype=np.int64)
    value = np.zeros((len(lower), 12))
    sides = ((lower, 1.0 - fraction), (lower + 1, fraction))
    for place, (part, which, coefficient) in enumerate(terms):
        known = columns.of(part, axis, which)
        for side, (node, weight) in enumerate(sides):
            entry = 2 * place + side
            column[:, entry] = known[np.clip(node, 1, columns.nodes) - 1]
            value[:, entry] = np.where(node > 0, coefficient * weight, 0.0)
    column[:, 10:] = columns.line + 2 * number + np.arange(2)
    value[:, 10] = 1.0
    value[:, 11] = _share_of_travel(design, axis, one)
    return column, value


def _share_of_travel(design: Design, axis: int, one: MeasuredStraightness) -> Vector:
    away_mm = one.position_mm - design.volume.origin_mm[axis]
    share: Vector = away_mm / design.volume.length_mm[axis]
    return share


def nodes_of(
    volume: Volume, axis: int, one: MeasuredStraightness
) -> tuple[NDArray[np.int64], Vector]:
    """Return, for each position of a pass, the node below and the fraction of the increment from
    this node, shapes (k,)."""
    low, size = volume.origin_mm[axis], volume.size_mm[axis]
    outside = (one.position_mm < low - POSITION_TOLERANCE_MM) | (
        one.position_mm > low + size + POSITION_TOLERANCE_MM
    )
    if outside.any():
        found = f"{one.position_mm[int(np.argmax(outside))]:g} mm"
        raise DataError(
            f"4-DOF head: {one.name}",
            expected=message("positions-volume", low=low, high_mm=low + size),
            found=found,
        )
    points = np.tile(
        np.asarray(volume.origin_mm, dtype=np.float64), (len(one.position_mm), 1)
    )
    points[:, axis] = one.position_mm
    points = snapped_mm(volume, points)
    lower, fraction = between_nodes(volume, points)
    return lower[:, axis], fraction[:, axis]


def _arms(design: Design, axis: int, component: int, position_mm: Vector) -> Vector:
    """Return the Abbe arms, shape (k, 3): um of displacement in ``component`` for 1 urad of
    rotation about each axis. The arm in the travel direction of the carriage is zero."""
    arm = np.zeros((len(position_mm), 3))
    away_mm = position_mm - design.volume.origin_mm[axis]
    arm[:, axis] = abbe_mask(design.chain)[axis, axis] * away_mm
    lever: Vector = 1e-3 * -cross_matrix(arm)[:, component, :]
    return lever


def of_known_angles(design: Design, one: MeasuredStraightness, angles: Angles) -> Vector:
    """Return the effect of the axis' known rotations on the measured values in um, shape (k,)."""
    axis, component = divmod(DISPLACEMENTS.index(one.name), 3)
    arms = _arms(design, axis, component, one.position_mm)
    total = np.zeros(len(arms))
    for about, name in enumerate(ROTATIONS[3 * axis : 3 * axis + 3]):
        if name in angles:
            known = angles[name]
            urad = np.interp(one.position_mm, known.position_mm, known.value_urad)
            total += arms[:, about] * urad
    return total
