"""The information of each setup about the machine, as a matrix. The information of a plan is the
sum of the matrices of its setups.

A reading is ``y = A m + N f + P c + e`` (`solver.model.design`, `solver.model.effects`). ``m`` are
the unknowns that all setups share: displacements at the nodes, angular functions, backlash at first
stops, wavelength, material. ``f`` are unknowns of one setup with any size: zeros of the counts,
mirror tilt, drift. ``c`` are unknowns of one setup with a usual size: drift, wander, scale of the
setup, misses of the moves, waves between the nodes. ``e`` is noise with the variance ``1 / w``. D
is diagonal, with 0 for each f and 1 / size^2 for each c; ``W = [N P]``. The information of a setup
about m is the Schur complement (Searle, Casella, McCulloch 1992, 7.4)

    J = A' w A - A' w W (W' w W + D)^-1 W' w A

No two setups share f, c or e, so J is computed once for each setup and summed. Q is the precision
of the usual sizes of the machine's class. The covariance of m after the survey is ``C = (J_1 + J_2
+ .. + Q)^-1``: one inversion for about 190 unknowns takes a millisecond. Q limits every function to
its usual size, so an additional setup never increases C.

``K m`` are the values of the machine's functions. F is the effect of one unit of each value on the
error at points of the volume, without rigid motion. The mean square of this error is ``tr(C H) +
floor`` with ``H = K' F F' K``. A control with nine tables corrects only functions of one axis. T is
the projection of an error on the errors that such tables can correct; then ``H = K' F T F' K``, and
the floor is the usual effect of angular functions outside this projection. For a control with a
lattice table the floor is zero.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.result.field import rigid_motions
from stepdiag.base.result.result import DISPLACEMENTS, SQUARENESS
from stepdiag.base.volume import Vector, Volume, anywhere_mm
from stepdiag.solver.adjustment.scatter import Scatter
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.between import between_of, effect_between
from stepdiag.solver.model.design import Design, Model, build_design
from stepdiag.solver.model.effects import (
    FIRST_STOPS,
    GROWTH,
    TURNING,
    AngleShapes,
    Effect,
    angle_shapes,
    effects_of,
)
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.reported import reported
from stepdiag.solver.uncertainty.machine import (
    Machine,
    fields_um,
    machine_of,
    over_volume,
    usual_names,
    usual_rows,
)

Aim = Literal["lattice", "tables"]
Zone = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
COMMON = {FIRST_STOPS: 3, "air": 1, "material temperature": 6, GROWTH: 0}
"""The random effects that all setups share, except angles, and their number of columns in a
layout without them."""
_FREE, _ANYTHING_UM, _ANY_TURN_UM = 1e-6, 1e4, 1e3
"""``_FREE`` is the precision of unknowns of any size; it makes a matrix without information
regular. ``_ANYTHING_UM`` is the prior size of displacements that no reading determines.
``_ANY_TURN_UM`` is the prior size of rotations of the whole machine. Larger sizes would cause
rounding errors above 1e-8."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SetupInformation:
    """The information of each setup of a layout, shape (setups, q, q), and the model of the q
    unknowns."""

    each: Vector
    design: Design
    shapes: AngleShapes
    assumed: Assumptions


def information_by_setup(
    layout: Layout, chain: str, assumed: Assumptions
) -> SetupInformation:
    """Return the information of each setup of a layout. Raises ``UsageError`` for an invalid
    chain."""
    design = build_design(layout, chain, Model(misses=assumed.repeatability_um > 0.0))
    shapes = angle_shapes(layout, {}, assumed)
    effects = (
        *effects_of(layout, chain, shapes, assumed),
        effect_between(layout, between_of(layout)),
    )
    weight = 1.0 / Scatter.assumed(layout, assumed).u_um(layout) ** 2
    common = _common(layout, effects)
    own = np.hstack(
        [effect.pattern_um for effect in effects if effect.name not in (*TURNING, *COMMON)]
    )
    rows = [
        np.flatnonzero(layout.setup_index == index) for index in range(len(layout.setups))
    ]
    each = [
        _information(
            design, mine, common[mine], own[mine], weight[mine], assumed.repeatability_um
        )
        for mine in rows
    ]
    return SetupInformation(
        each=np.array(each), design=design, shapes=shapes, assumed=assumed
    )


def _common(layout: Layout, effects: tuple[Effect, ...]) -> Vector:
    patterns = {effect.name: effect.pattern_um for effect in effects}
    turning = [patterns[name] for name in TURNING if name in patterns]
    return np.hstack(
        [
            *turning,
            *(
                patterns.get(name, np.zeros((len(layout), count)))
                for name, count in COMMON.items()
            ),
        ]
    )


def _information(
    design: Design,
    mine: NDArray[np.int64],
    common: Vector,
    own: Vector,
    weight: Vector,
    repeatability_um: float,
) -> Vector:
    machine, rows = design.columns.machine, design.rows.select(mine)
    used = np.unique(rows.column[(rows.value != 0) & (rows.column >= machine)])
    place = np.zeros(design.columns.count, dtype=np.int64)
    place[:machine], place[used] = np.arange(machine), machine + np.arange(len(used))
    dense = np.zeros((len(mine), machine + len(used)))
    np.add.at(dense, (np.arange(len(mine))[:, None], place[rows.column]), rows.value)
    own = own[:, np.any(own, axis=0)]
    shared, alone = (
        np.hstack([dense[:, :machine], common]),
        np.hstack([dense[:, machine:], own]),
    )
    misses = used >= design.columns.miss
    precision = np.concatenate(
        [
            np.where(misses, repeatability_um**-2 if misses.any() else _FREE, _FREE),
            np.ones(own.shape[1]),
        ]
    )
    weighted = shared * weight[:, None]
    across = alone.T @ weighted
    square = alone.T @ (alone * weight[:, None]) + np.diag(precision)
    matrix: Vector = shared.T @ weighted - across.T @ np.linalg.solve(square, across)
    return 0.5 * (matrix + matrix.T)


@dataclass(frozen=True, kw_only=True, eq=False)
class Machinery:
    """The relation between the unknowns m of a survey and the machine.

    ``values`` (k, q) is K for the values of ``machine``. ``fields`` (k, 3 points) is F, projected
    on the errors that the tables can correct; ``floor_um`` is the error outside this projection.
    ``usual`` (r, q) are combinations that are zero within ``usual_u`` (r,), with the names
    ``usual_names``. ``causes`` (q,) is the precision of unknowns with a usual size, 0 for
    displacements. ``turning`` (q,) marks the unknowns of the angles.
    """

    machine: Machine
    values: Vector
    fields: Vector
    floor_um: float
    usual: Vector
    usual_names: tuple[str, ...]
    usual_u: Vector
    causes: Vector
    turning: NDArray[np.bool_]

    def precision(self, u: Vector | None = None, angles: float = 1.0) -> Vector:
        """Return the prior precision Q, shape (q, q); the usual sizes of the angles are
        multiplied by ``angles``."""
        scaled = self.usual / (self.usual_u if u is None else u)[:, None]
        # the size of a rotation of the whole machine is free, because no reading and no result
        # contains this rotation
        of_causes = (
            _ANY_TURN_UM**-2 * (self.causes == 0.0)
            + self.causes / np.where(self.turning, angles, 1.0) ** 2
        )
        matrix: Vector = scaled.T @ scaled + np.diag(of_causes)
        return matrix

    @property
    def seen(self) -> Vector:
        """Return H, shape (q, q), so that ``tr(C H)`` is the mean square error over the volume."""
        across = self.values.T @ self.fields
        matrix: Vector = across @ across.T * 3.0 / self.fields.shape[1]
        return matrix

    def over(self, information: Vector, precision: Vector) -> tuple[float, float]:
        """Return the unknown error over the volume (rms) in um, and its degrees of freedom."""
        covariance = self.values @ inverse(information + precision) @ self.values.T
        return over_volume(0.5 * (covariance + covariance.T), self.fields)


def inverse(matrix: Vector) -> Vector:
    found = np.linalg.inv(matrix)
    symmetric: Vector = 0.5 * (found + found.T)
    return symmetric


def machinery(
    found: SetupInformation, aim: Aim = "lattice", zone: Zone | None = None
) -> Machinery:
    """Return the relation between the unknowns and the machine; ``zone`` is the part of the
    volume that must be accurate (None: the whole volume)."""
    design, shapes, assumed = found.design, found.shapes, found.assumed
    turning = len(shapes.names) * (shapes.waves + 1)
    displacements = design.columns.machine
    machine = machine_of(design, shapes, 0, turning)
    rest = np.zeros((len(machine.names), found.each.shape[1] - displacements - turning))
    values = np.hstack(
        [machine.combination.dense()[:, :displacements], machine.on_causes, rest]
    )
    names = reported(design)
    rows, u = usual_rows(names, dict.fromkeys(names.names, False), assumed)
    usual = np.hstack(
        [rows.dense()[:, :displacements], np.zeros((len(rows), turning + rest.shape[1]))]
    )
    fields, angular = _fields(
        machine.names, tuple(machine.node.tolist()), design.volume, design.chain, aim, zone
    )
    size = machine.on_causes @ machine.on_causes.T
    return Machinery(
        machine=machine,
        values=values,
        fields=fields,
        floor_um=over_volume(size, angular)[0] if aim == "tables" else 0.0,
        usual=usual,
        usual_names=usual_names(names, dict.fromkeys(names.names, False), assumed),
        usual_u=u,
        causes=np.concatenate([np.zeros(displacements), np.ones(turning + rest.shape[1])]),
        turning=np.concatenate(
            [np.zeros(displacements), np.ones(turning), np.zeros(rest.shape[1])]
        )
        > 0,
    )


@lru_cache(maxsize=8)
def _fields(
    names: tuple[str, ...],
    node: tuple[int, ...],
    volume: Volume,
    chain: str,
    aim: Aim,
    zone: Zone | None,
) -> tuple[Vector, Vector]:
    """Return the effect of one unit of each machine value on the error at points of the volume,
    without rigid motion, shapes (k, 3 points): the part that the tables can correct, and the
    rest."""
    points = anywhere_mm(volume)
    machine = Machine(
        names=names,
        node=np.array(node),
        combination=Rows(np.zeros((0, 1), dtype=np.int64), np.zeros((0, 1)), 0),
        on_causes=np.zeros((0, 0)),
    )
    whole = fields_um(machine, volume, chain).reshape(len(names), -1, 3)
    inside = np.ones(len(points), dtype=np.bool_)
    for axis, (low, high) in enumerate(zone or ()):
        inside &= (points[:, axis] >= low) & (points[:, axis] <= high)
    motions = rigid_motions(volume, points[inside])
    flat = whole[:, inside].reshape(len(names), -1)
    free = flat - (flat @ motions) @ motions.T
    if aim == "lattice":
        return free, np.zeros_like(free)
    by_axis = free[np.isin(np.array(names), (*DISPLACEMENTS, *SQUARENESS))]
    _, size, held = np.linalg.svd(by_axis, full_matrices=False)
    held = held[size > 1e-9 * size[0]]
    tables: Vector = (free @ held.T) @ held
    return tables, free - tables


def determined(
    found: SetupInformation, information: Vector, usual: Mapping[str, float]
) -> dict[str, bool]:
    """Return for each quantity whether a survey with known angles would determine it with an
    uncertainty below its ``usual`` size.

    Usual sizes are in um, urad and um/m. `_ANYTHING_UM` is the prior uncertainty of displacements.
    """
    names, displacements = reported(found.design), found.design.columns.machine
    own = (
        information[:displacements, :displacements] + np.eye(displacements) / _ANYTHING_UM**2
    )
    square = _variances(names.combination.dense()[:, :displacements], inverse(own))
    return {
        name: bool(np.mean(square[names.of(name)]) < usual.get(name, _ANYTHING_UM) ** 2)
        for name in names.groups
    }


def uncertainties(
    found: SetupInformation, information: Vector, of: Machinery
) -> dict[str, float]:
    """Return the standard uncertainty of each quantity (rms over the nodes of a function), from
    the readings and the usual sizes of random effects."""
    names, displacements = reported(found.design), found.design.columns.machine
    precision = of.precision(np.full(len(of.usual_u), np.inf))
    covariance = inverse(information + precision)[:displacements, :displacements]
    square = _variances(names.combination.dense()[:, :displacements], covariance)
    return {name: float(np.sqrt(np.mean(square[names.of(name)]))) for name in names.groups}


def _variances(rows: Vector, covariance: Vector) -> Vector:
    found: Vector = np.maximum(np.sum((rows @ covariance) * rows, axis=1), 0.0)
    return found
