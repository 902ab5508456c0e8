"""What is to be expected of the volume, before and after tables: root mean square and largest error as intervals.

Machines are drawn from the posterior of the result, each is measured over the points as an independent check would, and the interval
holds 95 % of them (k = 2). The same draws serve everything: verify, report, page, compare and plan.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.result.field import Tabulated, error_field_um, field_of_um, rigid_motions
from stepdiag.solver.result.interval import Interval
from stepdiag.solver.result.posterior import Posterior
from stepdiag.solver.result.result import DISPLACEMENTS, Result

DRAWS = 1000
_TOGETHER = 250
"""Draws worked out together: a few megabytes."""
TAIL = 0.02275
"""Share beyond k = 2 on either side."""
BETWEEN_SHARE = 8.0 / 15.0
"""Mean square of an arch (a parabola between two targets) over its largest square."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldFigures:
    """Length of the error vector over the volume: root mean square and largest, in um."""

    rms_um: Interval
    largest_um: Interval

    def as_json(self) -> dict[str, Any]:
        """Return the form of the contract."""
        return {"rms_um": self.rms_um.as_json(), "largest_um": self.largest_um.as_json()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Predicted:
    """The figures before and after, with and without the rigid motion of the whole volume."""

    without_rigid_motion: dict[str, FieldFigures]
    as_it_is: dict[str, FieldFigures]

    def as_json(self) -> dict[str, Any]:
        """Return the form of the contract: ``without_rigid_motion`` and ``as_it_is``, each ``before`` and ``after``."""
        both = {"without_rigid_motion": self.without_rigid_motion, "as_it_is": self.as_it_is}
        return {name: {when: figures.as_json() for when, figures in part.items()} for name, part in both.items()}


def predicted(result: Result, points_mm: Vector, correction_um: Vector) -> Predicted:
    """Return what an independent check would find at points (N, 3) before and after ``correction_um`` (N, 3) is applied."""
    before = error_field_um(result, points_mm)
    posterior = result.posterior
    moved = _moved(result, posterior, points_mm)
    alone = np.sqrt(_between_square_um(result, posterior, points_mm))
    draw = np.random.default_rng(0)
    amount = np.column_stack([np.ones(DRAWS), draw.standard_normal((DRAWS, len(moved) - 1))])
    each = (alone * draw.standard_normal((DRAWS, *alone.shape))).reshape(DRAWS, -1) if np.any(alone) else None
    motions = rigid_motions(result.volume, points_mm)
    parts: dict[str, dict[str, tuple[Vector, Vector]]] = {}
    for name, free in (("as_it_is", None), ("without_rigid_motion", motions)):
        parts[name] = {}
        for when, field in (("before", before), ("after", before + correction_um)):
            parts[name][when] = _lengths_um(_flat(field[None], free)[0], _flat(moved, free), amount, each)
    known = posterior is not None
    return Predicted(
        **{
            name: {when: FieldFigures(rms_um=_told(drawn[0], known), largest_um=_told(drawn[1], known)) for when, drawn in part.items()}
            for name, part in parts.items()
        },
    )


def _told(drawn: Vector, known: bool) -> Interval:
    """Return the median of draws and the interval that holds all but `TAIL` of them on either side."""
    low, value, high = (float(end) for end in np.quantile(drawn, (TAIL, 0.5, 1.0 - TAIL)))
    return Interval(value_um=value, low_um=low, high_um=high) if known else Interval(value_um=value)


def _moved(result: Result, posterior: Posterior | None, points_mm: Vector) -> Vector:
    """Return what each deviation of the posterior does to the error at the points, shape (deviations, N, 3): the offset first."""
    if posterior is None:
        return np.zeros((1, len(points_mm), 3))
    deviations = posterior.deviations()
    functions = {name: Tabulated(posterior.position_mm[name[2]], value) for name, value in deviations.items() if name[0] == "E"}
    squareness = {name: value[:, 0] for name, value in deviations.items() if name[0] != "E"}
    return field_of_um(result.volume, result.chain, functions, squareness, points_mm)


def _flat(fields_um: Vector, motions: Vector | None) -> Vector:
    """Return fields (k, N, 3) as rows (k, 3 N), less the rigid motion where its basis is given."""
    flat = fields_um.reshape(len(fields_um), -1)
    return flat if motions is None else flat - (flat @ motions) @ motions.T


def _between_square_um(result: Result, posterior: Posterior | None, points_mm: Vector) -> Vector:
    """Return the mean square at the points of what functions do between their values beside the straight line, shape (N, 3): an arch."""
    total = np.zeros((len(points_mm), 3))
    for name, arch in posterior.between_um.items() if posterior is not None else ():
        at, nodes = points_mm[:, "XYZ".index(name[2])], result.errors[name].position_mm
        place = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)
        share = np.clip((at - nodes[place]) / (nodes[place + 1] - nodes[place]), 0.0, 1.0)
        total[:, "XYZ".index(name[1])] += (4.0 * arch * share * (1.0 - share)) ** 2
    return total


def _lengths_um(field: Vector, moved: Vector, amount: Vector, each: Vector | None) -> tuple[Vector, Vector]:
    """Return root mean square and largest length of the error vector of every draw, shapes (draws,)."""
    rms, largest = np.empty(len(amount)), np.empty(len(amount))
    for start in range(0, len(amount), _TOGETHER):
        some = slice(start, start + _TOGETHER)
        drawn = field + amount[some] @ moved
        if each is not None:
            drawn += each[some]
        square = np.sum(drawn.reshape(len(drawn), -1, 3) ** 2, axis=2)
        rms[some] = np.sqrt(np.mean(square, axis=1))
        largest[some] = np.sqrt(np.max(square, axis=1))
    return rms, largest


def volumetric_u_um(result: Result, points_mm: Vector) -> float | None:
    """Return the root mean square over the volume of the error vector's standard uncertainty, rigid motion removed; None without one."""
    if result.posterior is None:
        return None
    moved = _flat(_moved(result, result.posterior, points_mm), rigid_motions(result.volume, points_mm))
    between = sum(result.posterior.between_um[name] ** 2 for name in DISPLACEMENTS if name in result.posterior.between_um)
    return float(np.sqrt(np.sum(moved[1:] ** 2) / len(points_mm) + BETWEEN_SHARE * between))
