"""The errors of the whole machine as a vector of functions with slopes, squarenesses and angles,
with the covariance and the modes of this vector.

Errors that the readings do not identify have the usual size of the machine's class in this vector.
The result omits such errors, but they are not zero over the volume.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.names import PRODUCTS
from stepdiag.base.result.field import Tabulated, field_of_um, rigid_motions
from stepdiag.base.result.posterior import POSTERIOR_DECIMALS, Posterior
from stepdiag.base.result.result import (
    AXIS_LETTERS,
    DISPLACEMENTS,
    POSITIONING,
    ROTATIONS,
    SQUARENESS,
)
from stepdiag.base.volume import Vector, Volume, anywhere_mm
from stepdiag.solver.linear.fit import fit
from stepdiag.solver.linear.least_squares import Inverse
from stepdiag.solver.linear.mixed import Causes, MixedFit
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.design import Design
from stepdiag.solver.model.effects import AngleShapes
from stepdiag.solver.model.quantities import Quantities
from stepdiag.solver.model.reported import reported, sloped
from stepdiag.solver.uncertainty.modes import BySize, by_size, factored, of_one_factor
from stepdiag.solver.uncertainty.spread import Spread

MOST_POSITIONS = 20
"""Largest number of increments between the nodes of the modes."""
MOST_MODES = 40
NEXT_TO_NOTHING = 1e-6
"""Smallest usual size, as a share of the largest usual size; next to a size of zero all other
sizes would look like rounding (`HIDDEN`)."""
HIDDEN = 1e-9
"""Share of the largest effect below which an effect is rounding."""
FINEST_UM = 0.01
"""Smallest uncertainty of a reading in um in a fit with usual sizes: with a smaller value the
ratio to the usual sizes causes rounding errors."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Machine:
    """The values of the machine's functions and squarenesses: ``names`` and ``node`` of each
    value, and the combination of unknowns and random effects for each value."""

    names: tuple[str, ...]
    node: NDArray[np.int64]
    combination: Rows
    on_causes: Vector


def machine_of(
    design: Design,
    shapes: AngleShapes,
    first_cause: int,
    causes: int,
    products: Mapping[int, float] | None = None,
) -> Machine:
    """Return the machine's values at the nodes of the modes. The fit has ``causes`` random effects;
    unknown angles begin at ``first_cause``.

    ``products`` contains the columns of `PRODUCTS`, in the order of their names, with the size of
    one unit.
    """
    found = reported(design)
    nodes = mode_nodes(design.volume)
    wanted = [
        *(sloped(name) if name in POSITIONING else name for name in DISPLACEMENTS),
        *SQUARENESS,
    ]
    wanted += [
        name for name in ROTATIONS if 1 in design.columns.parts and name not in shapes.names
    ]
    kept = [
        row
        for name in wanted
        for row in found.of(name)
        if name in SQUARENESS or found.node[row] in nodes
    ]
    base = found.select(np.array(kept, dtype=np.int64))
    inner = nodes[1:]
    angles = np.zeros((len(shapes.names) * len(inner), causes))
    for place, name in enumerate(shapes.names):
        own = shapes.causes_of(name)
        rows = slice(place * len(inner), (place + 1) * len(inner))
        angles[rows, first_cause + own] = shapes.range_of(name) * shapes.at(
            inner / design.volume.increments
        )
    beside = np.zeros((len(products or {}), causes))
    for row, (cause, size) in enumerate((products or {}).items()):
        beside[row, cause] = size
    width, more = base.combination.column.shape[1], len(angles) + len(beside)
    none = Rows(
        np.zeros((more, width), dtype=np.int64),
        np.zeros((more, width)),
        base.combination.count,
    )
    named = (
        *(name.removeprefix("sloped ") for name in base.names),
        *(name for name in shapes.names for _ in inner),
    )
    return Machine(
        names=(*named, *tuple(PRODUCTS)[: len(beside)]),
        node=np.concatenate(
            [
                base.node,
                np.tile(inner, len(shapes.names)),
                np.zeros(len(beside), dtype=np.int64),
            ]
        ),
        combination=base.combination.followed_by(none),
        on_causes=np.vstack([np.zeros((len(base.names), causes)), angles, beside]),
    )


def mode_nodes(volume: Volume) -> NDArray[np.int64]:
    """Return the numbers (0 to n) of the nodes of the modes."""
    return np.unique(
        np.round(
            np.linspace(0, volume.increments, min(volume.increments, MOST_POSITIONS) + 1)
        ).astype(np.int64)
    )


def usual_sizes_of(assumed: Assumptions) -> dict[str, float]:
    """Return the usual errors of a machine of this class: functions in um, squareness in urad,
    scales in um/m."""
    usual = dict.fromkeys(DISPLACEMENTS, assumed.shape_um)
    # the scale of an unmeasured axis includes its growth during the warm-up
    usual |= dict.fromkeys(SQUARENESS, assumed.squareness_urad)
    usual |= dict.fromkeys(
        AXIS_LETTERS, float(np.hypot(assumed.scale_um_m, assumed.growth_um_m))
    )
    least = NEXT_TO_NOTHING * max(usual.values())
    return {name: max(size, least) for name, size in usual.items() if size > 0}


def usual_names(
    found: Quantities, known: Mapping[str, bool], assumed: Assumptions
) -> tuple[str, ...]:
    """Return the name of the error in each row of `usual_rows`."""
    return tuple(
        name
        for name in usual_sizes_of(assumed)
        if not known.get(name, True)
        for _ in found.of(name)
    )


def usual_rows(
    found: Quantities, known: Mapping[str, bool], assumed: Assumptions
) -> tuple[Rows, Vector]:
    """Return a row for each value of an error that is not ``known``. The target is zero, and the
    standard uncertainty is the usual size of the error."""
    usual = usual_sizes_of(assumed)
    kept = [row for name in usual if not known.get(name, True) for row in found.of(name)]
    some = found.select(np.array(kept, dtype=np.int64))
    return some.combination, np.array([usual[name] for name in some.names])


def with_usual(mixed: MixedFit, design: Design, rows: Rows, u: Vector) -> MixedFit:
    """Return the fit with the usual rows added."""
    fixed = mixed.fixed
    seen = replace(fixed, weight=np.minimum(fixed.weight, 1.0 / FINEST_UM**2))
    return with_rows(replace(mixed, fixed=seen), design, rows, u, np.zeros((len(rows), 0)))


def with_rows(
    mixed: MixedFit,
    design: Design,
    rows: Rows,
    u: Vector,
    pattern: Vector,
    like: Inverse | None = None,
) -> MixedFit:
    """Return the fit with additional rows (target zero) and additional random effects of size one,
    whose effect on these rows is ``pattern`` (rows, k).

    ``like`` is the inverse of a fit that already determines the additional rows.
    """
    fixed, before = mixed.fixed, mixed.causes.pattern
    again = fit(
        fixed.rows.followed_by(rows),
        design.blocks,
        np.concatenate([fixed.target, np.zeros(len(rows))]),
        np.concatenate([fixed.weight, 1.0 / u**2]),
        like,
    )
    every = np.block(
        [
            [before, np.zeros((len(before), pattern.shape[1]))],
            [np.zeros((len(rows), before.shape[1])), pattern],
        ]
    )
    return MixedFit(
        again, Causes.of(again, every), np.append(mixed.size, np.ones(pattern.shape[1]))
    )


def covariance(spread: Spread, machine: Machine) -> Vector:
    """Return the covariance of the machine's values, shape (k, k)."""
    dense = machine.combination.dense()
    moved = spread.moved(machine.combination, machine.on_causes)
    matrix: Vector = (
        machine.combination.times(spread.fit.inverse.solve(dense.T))
        + moved @ spread.amount @ moved.T
    )
    return 0.5 * (matrix + matrix.T)


def separated(
    machine: Machine, inverse: Inverse, rows: Rows, u: Vector
) -> tuple[Machine, Vector]:
    """Return the part of the machine's values that the readings determine, and the covariance (k,
    k) of the rest, which only the usual ``rows`` limit.

    The first part includes the most likely value of the undetermined part for the given readings.
    The covariance is not computed as the difference of the covariances with and without the usual
    rows, because the rounding of this difference would depend on the processor.
    """
    hidden = np.linalg.pinv(rows.times(inverse.null) / u[:, None], rcond=HIDDEN)
    moved = machine.combination.times(inverse.null) @ hidden
    unseen = machine.combination.dense() - moved @ (rows.dense() / u[:, None])
    column = np.tile(np.arange(unseen.shape[1]), (len(unseen), 1))
    return replace(
        machine, combination=Rows(column, unseen, unseen.shape[1])
    ), moved @ moved.T


def posterior_of(
    spread: Spread,
    machine: Machine,
    volume: Volume,
    chain: str,
    offset: Vector,
    of_unknown_size: str,
    unmeasured: Vector,
) -> Posterior:
    """Return the distribution of the differences between the machine and the reported errors, in
    modes; ``offset`` (k,) is their expected value.

    The random effects of the group ``of_unknown_size`` have separate modes. ``unmeasured`` is the
    covariance (k, k) of the part that the readings do not determine (`separated`), known up to a
    factor.
    """
    fields = fields_um(machine, volume, chain)
    found = covariance(spread, machine)
    family = (
        spread.families.get(spread.names.index(of_unknown_size))
        if of_unknown_size in spread.names
        else None
    )
    own = BySize.nothing(len(found))
    if family is not None:
        moved = spread.moved(machine.combination, machine.on_causes)
        found = found - moved @ (family.surplus() + family.alone()) @ moved.T
        own = by_size(moved @ family.direction, family, fields, MOST_MODES)
    if np.any(unmeasured):
        own = own.beside(of_one_factor(unmeasured, fields, MOST_MODES))
    factor, left = factored(found, fields, MOST_MODES)
    left = np.hypot(left, own.left)
    positions = {
        letter: volume.nodes_mm(axis)[mode_nodes(volume)]
        for axis, letter in enumerate(AXIS_LETTERS)
    }
    names = tuple(dict.fromkeys(machine.names))
    modes = np.vstack([factor.T, own.modes.T])
    return Posterior(
        position_mm=positions,
        offset={
            name: values[0]
            for name, values in _by_name(machine, names, volume, offset[None, :])
            if np.any(values)
        },
        modes={
            name: values
            for name, values in _by_name(machine, names, volume, modes)
            if len(values)
        },
        rest={
            name: values[0]
            for name, values in _by_name(machine, names, volume, left[None, :])
            if _is_nonzero(values)
        },
        between_um={},
        sized=own.sized,
    )


def _is_nonzero(values: Vector) -> bool:
    """Return whether any value is nonzero after rounding. Each quantity in the posterior uses
    random numbers, so a rounding error must not add a quantity."""
    return bool(np.any(np.round(values, POSTERIOR_DECIMALS)))


def _by_name(
    machine: Machine, names: Sequence[str], volume: Volume, values: Vector
) -> list[tuple[str, Vector]]:
    found, name_of = [], np.array(machine.names)
    for name in names:
        mine = np.flatnonzero(name_of == name)
        found.append((name, _node_rows(name, machine.node[mine], volume, values[:, mine])))
    return found


def _node_rows(name: str, node: NDArray[np.int64], volume: Volume, values: Vector) -> Vector:
    """Return the values (r, k) of a function at all nodes of the modes, with zeros where the
    function is zero by definition. A squareness (r, 1) is returned unchanged."""
    if name[0] != "E":
        return values
    nodes = mode_nodes(volume)
    table = np.zeros((len(values), len(nodes)))
    table[:, np.searchsorted(nodes, node)] = values
    return table


def over_volume(found: Vector, fields_um: Vector) -> tuple[float, float]:
    """Return the error over the volume (rms) and its degrees of freedom, from the covariance of
    the machine's values. ``fields_um`` (k, 3 points) is the result of `free_fields_um`."""
    across = found @ (fields_um @ fields_um.T)
    square = max(float(np.trace(across)), 1e-30)
    return float(np.sqrt(3.0 * square / fields_um.shape[1])), square**2 / max(
        float(np.sum(across * across.T)), 1e-60
    )


def free_fields_um(machine: Machine, volume: Volume, chain: str) -> Vector:
    """Return the effect of one unit of each machine value on the error over the volume, without
    rigid motion, shape (k, 3 points)."""
    return _free_fields_um(machine.names, tuple(machine.node.tolist()), volume, chain)


def fields_um(machine: Machine, volume: Volume, chain: str) -> Vector:
    """Return the effect of one unit of each machine value on the error over the volume, shape
    (k, 3 points)."""
    return _fields_um(machine.names, tuple(machine.node.tolist()), volume, chain)


# a solve uses these fields twice, and the next solve of the same volume uses them again
@lru_cache(maxsize=4)
def _free_fields_um(
    names: tuple[str, ...], node: tuple[int, ...], volume: Volume, chain: str
) -> Vector:
    flat, motions = (
        _fields_um(names, node, volume, chain),
        rigid_motions(volume, anywhere_mm(volume)),
    )
    free: Vector = flat - (flat @ motions) @ motions.T
    free.setflags(write=False)
    return free


@lru_cache(maxsize=4)
def _fields_um(
    names: tuple[str, ...], node: tuple[int, ...], volume: Volume, chain: str
) -> Vector:
    points = anywhere_mm(volume)
    field = np.zeros((len(names), len(points), 3))
    for name in dict.fromkeys(names):
        mine = np.flatnonzero(np.array(names) == name)
        table = _node_rows(name, np.array(node)[mine], volume, np.eye(len(mine)))
        if name[0] != "E":
            field[mine] = field_of_um(volume, chain, {}, {name: table[:, 0]}, points)
        else:
            nodes = volume.nodes_mm(AXIS_LETTERS.index(name[2]))[mode_nodes(volume)]
            field[mine] = field_of_um(
                volume, chain, {name: Tabulated(nodes, table)}, {}, points
            )
    flat: Vector = field.reshape(len(names), -1)
    flat.setflags(write=False)
    return flat
