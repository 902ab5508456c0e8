"""The uncertainty that a survey will have, from where its stops are: the model of the adjustment without a reading."""

from dataclasses import dataclass, replace

import numpy as np

from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.fit import fit
from stepdiag.solver.linear.mixed import Causes, MixedFit
from stepdiag.solver.model.assumptions import Assumptions
from stepdiag.solver.model.design import Design, Model, build_design
from stepdiag.solver.model.effects import AngleShapes, angle_shapes, effects_of
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import starting_u_um
from stepdiag.solver.model.quantities import Quantities
from stepdiag.solver.model.reported import identified, reported, variance
from stepdiag.solver.result.prediction import BETWEEN_SHARE
from stepdiag.solver.result.result import DISPLACEMENTS
from stepdiag.solver.uncertainty.machine import covariance, machine_of, usual_rows, usual_sizes, volumetric_um, with_usual
from stepdiag.solver.uncertainty.spread import Spread

ROUGH = 0.4
"""What lies in the middle between two of n + 1 targets, as a share of shape / n^1.5: of functions whose half waves fall with the square
of their number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Foresight:
    """``u`` by name: root mean square over a function's nodes, absent where not identified; ``volumetric_um`` over the volume."""

    u: dict[str, float]
    volumetric_um: float


def foresee(layout: Layout, chain: str, assumed: Assumptions, increments: int) -> Foresight:
    """Return the standard uncertainties (k = 1) that the adjustment of these stops will state.

    ``increments`` is how fine the survey is: the layout may be a coarser one of the same runs, for the uncertainty at a node hardly
    depends on how many others there are.
    """
    design = build_design(layout, chain, Model())
    shapes = angle_shapes(layout, {}, assumed)
    effects = effects_of(layout, chain, shapes, assumed)
    weight = 1.0 / starting_u_um(layout, assumed.repeatability_um, assumed.reading_um) ** 2
    fixed = fit(design.rows, design.blocks, np.zeros(len(weight)), weight)
    pattern = np.hstack([np.zeros((len(weight), 0)), *(effect.pattern_um for effect in effects)])
    mixed = MixedFit(fixed, Causes.of(fixed, pattern), np.ones(pattern.shape[1]))
    group = np.repeat(np.arange(len(effects)), [effect.count for effect in effects])
    spread = Spread(mixed, group, tuple(effect.name for effect in effects), usual_sizes(len(effects)))
    found = reported(design)
    known = {**dict.fromkeys(DISPLACEMENTS, True), **identified(found, mixed.inverse)}
    return Foresight(u=_u(found, known, spread), volumetric_um=_volumetric_um(spread, design, shapes, assumed, increments))


def _u(found: Quantities, known: dict[str, bool], spread: Spread) -> dict[str, float]:
    each: Vector = np.sqrt(variance(found, spread.fit.inverse) + spread.variance(spread.moved(found.combination)))
    return {name: float(np.sqrt(np.mean(each[found.of(name)] ** 2))) for name in found.groups if known[name]}


def _volumetric_um(spread: Spread, design: Design, shapes: AngleShapes, assumed: Assumptions, increments: int) -> float:
    """Return the root mean square over the volume; every function starts from what is usual, so that a further run can only help."""
    found = reported(design)
    rows, u = usual_rows(found, dict.fromkeys(found.names, False), assumed)
    wider = replace(spread, fit=with_usual(spread.fit, design, rows, u))
    machine = machine_of(design, shapes, 0, len(spread.group))
    at_nodes = volumetric_um(covariance(wider, machine), machine, design.volume, design.chain)
    between = np.sqrt(9.0) * assumed.shape_um * ROUGH / increments**1.5
    hidden = np.sqrt(3.0) * assumed.between_um
    return float(np.sqrt(at_nodes**2 + BETWEEN_SHARE * (between**2 + hidden**2)))
