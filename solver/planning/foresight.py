"""The uncertainty that a survey will have, from where its stops are: the model of the adjustment without a reading."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.messages import Words, message
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.prediction import BELOW, BETWEEN_SHARE, TAIL
from stepdiag.base.result.result import AXIS_LETTERS, DISPLACEMENTS
from stepdiag.base.result.waves import CURVED
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.scatter import Scatter
from stepdiag.solver.adjustment.slips import KINDS, Unseen, hidden_in_volume_um, least_seen
from stepdiag.solver.linear.components import sized
from stepdiag.solver.linear.families import class_factors, hidden_factors, likely_factors, normal_points
from stepdiag.solver.linear.fit import fit
from stepdiag.solver.linear.mixed import Causes, MixedFit
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.design import Design, Model, build_design
from stepdiag.solver.model.effects import TURNING, AngleShapes, angle_shapes, effects_of
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.priors import make_prior
from stepdiag.solver.model.quantities import Quantities
from stepdiag.solver.model.reported import identified, reported, variance
from stepdiag.solver.uncertainty.machine import (
    Machine,
    covariance,
    free_fields_um,
    machine_of,
    over_volume,
    usual_names,
    usual_rows,
    usual_sizes,
    usual_sizes_of,
    with_usual,
)
from stepdiag.solver.uncertainty.spread import Spread

BENT = 6.7
"""What functions of five half waves that fall with their number leave between the smooth curve through n + 1 targets and the straight lines
that tables run along, over shape / n^2 (root mean square over the travel; measured on drawn ones)."""
_OF_FEW = {1: (0.93, 0.0), 2: (0.66, 0.20), 3: (0.49, 0.22), 4: (0.33, 0.19), 5: (0.23, 0.16), 6: (0.09, 0.15)}
"""Both over shape where the increments are few: there the powers say up to twice as much as drawn functions leave over the volume."""
ALIKE = 0.2
"""Standard deviation of the logarithm of what nine drawn functions of one shape leave together between their targets."""
_NEXT_TO_NONE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Foresight:
    """``u`` by name: root mean square over a function's nodes, absent where not identified; ``volumetric_um`` over the volume (k = 1).

    ``unseen``: the slip of the laser's count on a diagonal that is seen least, None without a diagonal; ``slips`` says what one makes of
    the volume's errors.
    """

    u: dict[str, float]
    volumetric_um: float
    unseen: Unseen | None
    slips: Callable[[Unseen], float]
    parts: Callable[[], "_Parts"]

    @cached_property
    def unseen_volume_um(self) -> float | None:
        """Return what the slip that is seen least makes of the volume's errors (rms) where it is of the size that is seen in half of the
        surveys; infinite where nothing tells it, None without a diagonal."""
        return None if self.unseen is None else self.slips(self.unseen)

    def hides(self) -> Words:
        """Return in words what the slip that is seen least may be and make; empty without a diagonal."""
        if self.unseen is None or self.unseen_volume_um is None:
            return ""
        if not np.isfinite(self.unseen.u_um):
            return message("slip-hidden-any")
        return message("slip-hidden", half_um=self.unseen.half_um, volume_um=self.unseen_volume_um)

    @cached_property
    def left_um(self) -> Interval:
        """Return what an ideal compensation will be predicted to leave, at k = 2, as `solver.result.prediction` does after the survey.

        It costs as much as the rest of a forecast, and only the surveys that are shown need it.
        """
        return _left_um(self.parts())


def foresee(layout: Layout, chain: str, assumed: Assumptions, increments: int) -> Foresight:
    """Return the standard uncertainties (k = 1) that the adjustment of these stops will state.

    ``increments`` is how fine the survey is: the layout may be a coarser one of the same runs, for the uncertainty at a node hardly
    depends on how many others there are.
    """
    design = build_design(layout, chain, Model(misses=assumed.repeatability_um > 0.0))
    shapes = angle_shapes(layout, {}, assumed)
    effects = effects_of(layout, chain, shapes, assumed)
    prior = make_prior(design, {})
    u = np.concatenate([Scatter.assumed(layout, assumed).u_um(layout), assumed.repeatability_um * prior.u])
    fixed = fit(design.rows.followed_by(prior.rows), design.blocks, np.zeros(len(u)), 1.0 / u**2)
    pattern = np.hstack([np.zeros((len(layout), 0)), *(effect.pattern_um for effect in effects)])
    pattern = np.pad(pattern, ((0, len(prior.u)), (0, 0)))
    mixed = MixedFit(fixed, Causes.of(fixed, pattern), np.ones(pattern.shape[1]))
    group = np.repeat(np.arange(len(effects)), [effect.count for effect in effects])
    spread = Spread(mixed, group, tuple(effect.name for effect in effects), usual_sizes(len(effects)))
    found = reported(design)
    known = {**dict.fromkeys(DISPLACEMENTS, True), **identified(found, mixed.inverse, usual_sizes_of(assumed))}
    ahead = _Ahead(spread=spread, design=design, shapes=shapes, assumed=assumed, increments=increments)
    return Foresight(
        u=_u(found, known, spread),
        volumetric_um=ahead.together_um(known),
        unseen=least_seen(mixed, layout, KINDS["diagonals"]),
        slips=lambda unseen: hidden_in_volume_um(mixed, layout, design, unseen),
        parts=lambda: ahead.parts(known),
    )


def _u(found: Quantities, known: dict[str, bool], spread: Spread) -> dict[str, float]:
    each: Vector = np.sqrt(variance(found, spread.fit.inverse) + spread.variance(spread.moved(found.combination)))
    return {name: float(np.sqrt(np.mean(each[found.of(name)] ** 2))) for name in found.groups if known[name]}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Parts:
    """Root mean squares over the volume in um: what the result will report as far as its size is known, all that it will not, which no
    table corrects, what the angles add as usual, waves that no target shows as usual, and what tables leave between targets; and the
    degrees of freedom of all this."""

    identified_um: float
    missed_um: float
    angles_um: float
    hidden_um: float
    bent_um: float
    freedom: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ahead:
    """The adjustment of a survey that was not driven, in which every function starts from what is usual: a further run can only help."""

    spread: Spread
    design: Design
    shapes: AngleShapes
    assumed: Assumptions
    increments: int

    @cached_property
    def machine(self) -> Machine:
        """Return the machine's values."""
        return machine_of(self.design, self.shapes, 0, len(self.spread.group))

    @cached_property
    def fields(self) -> Vector:
        """Return what one unit of each of its values does to the error over the volume."""
        return free_fields_um(self.machine, self.design.volume, self.design.chain)

    @cached_property
    def usual(self) -> tuple[Rows, Vector]:
        """Return the rows of what is usual, and their standard uncertainties."""
        found = reported(self.design)
        return usual_rows(found, dict.fromkeys(found.names, False), self.assumed)

    @cached_property
    def full(self) -> tuple[float, float]:
        """Return root mean square over the volume and degrees of freedom with everything as usual."""
        return self.over(self.usual[1], 1.0)

    def over(self, u: Vector, angles: float) -> tuple[float, float]:
        """Return root mean square over the volume and degrees of freedom for other usual sizes, and angles larger by a factor."""
        spread, design = self.spread, self.design
        turning = spread.causes_of(*TURNING)
        wider = with_usual(spread.fit, design, self.usual[0], u)
        one = replace(spread, fit=sized(wider, np.where(turning, angles, 1.0)))
        return over_volume(covariance(one, self.machine), self.fields)

    @property
    def curved_um(self) -> float:
        """Return what functions do between targets beside a smooth curve."""
        return float(np.sqrt(9.0)) * self.assumed.shape_um * _between_targets(self.increments)[0]

    @property
    def hidden_um(self) -> float:
        """Return what waves too short for the targets do, as usual."""
        return float(np.sqrt(3.0 * BETWEEN_SHARE)) * self.assumed.between_um

    def together_um(self, known: dict[str, bool]) -> float:
        """Return the standard uncertainty of the volume's errors; the straight lines of tables are not counted.

        What will not be identified may be larger than usual, all of it by one factor.
        """
        _, missed = _missed_um(self, known)
        larger = np.sqrt(max(float(np.mean(class_factors() ** 2)) - 1.0, 0.0))
        return float(np.linalg.norm([self.full[0], larger * missed, self.curved_um, self.hidden_um]))

    def parts(self, known: dict[str, bool]) -> _Parts:
        """Return what the compensation will leave, in parts."""
        both, freedom = self.full
        u = self.usual[1]
        quiet, _ = self.over(u, _NEXT_TO_NONE)
        missing, missed = _missed_um(self, known)
        identified = self.over(np.where(missing, _NEXT_TO_NONE * u, u), _NEXT_TO_NONE)[0] if np.any(missing) else quiet
        return _Parts(
            identified_um=identified,
            missed_um=missed,
            angles_um=float(np.sqrt(max(both**2 - quiet**2, 0.0))),
            hidden_um=self.hidden_um,
            bent_um=float(np.sqrt(9.0)) * self.assumed.shape_um * float(np.linalg.norm(_between_targets(self.increments))),
            freedom=freedom,
        )


def _between_targets(increments: int) -> tuple[float, float]:
    """Return what a function leaves beside the smooth curve through its targets, and that beside straight lines, over its shape."""
    return _OF_FEW.get(increments, (CURVED / increments**3, BENT / increments**2))


def _missed_um(ahead: _Ahead, known: dict[str, bool]) -> tuple[NDArray[np.bool_], float]:
    """Return which of the usual rows stand for what will not be identified, and the root mean square of that over the volume."""
    found, machine, volume, fields = reported(ahead.design), ahead.machine, ahead.design.volume, ahead.fields
    names = usual_names(found, dict.fromkeys(found.names, False), ahead.assumed)
    missing = np.array([not known.get(name, True) for name in names], dtype=np.bool_)
    if not np.any(missing):
        return missing, 0.0
    total = 0.0
    for name, size in usual_sizes_of(ahead.assumed).items():
        if not known.get(name, True):
            own = np.array(machine.names) == (f"E{name}{name}" if name in AXIS_LETTERS else name)
            if name in AXIS_LETTERS:
                length_m = 1e-3 * volume.size_mm[AXIS_LETTERS.index(name)]
                total += float(np.sum((size * length_m * (own * machine.node / volume.increments) @ fields) ** 2))
            else:
                total += float(np.sum((size * fields[own]) ** 2))
    return missing, float(np.sqrt(3.0 * total / fields.shape[1]))


def _left_um(parts: _Parts) -> Interval:
    """Return median and 95 % of what will be left, over the likely sizes of angles and hidden waves and over machines.

    What tables leave between the targets hangs on the shapes that will be found: those of a class of machine are alike within `ALIKE`.
    """
    factor = likely_factors()
    chance = normal_points(len(factor)) / np.sqrt(2.0 * parts.freedom)
    angles, hidden = parts.angles_um * factor[:, None], parts.hidden_um * np.roll(hidden_factors(), len(factor) // 2)[:, None]
    missed = parts.missed_um * class_factors()[:, None]
    # in an order of its own: neither with the angles' sizes nor with the rest
    machines = np.exp(ALIKE * normal_points(len(factor)))[np.arange(len(factor)) * 4 % len(factor), None]
    bent = parts.bent_um * machines / np.sqrt(np.mean(machines**2))
    square = missed**2 + (parts.identified_um**2 + angles**2) * np.maximum(1.0 + chance, 0.0) ** 2 + hidden**2 + bent**2
    low, value, high = (float(end) for end in np.sqrt(np.quantile(square, (BELOW, 0.5, 1.0 - TAIL))))
    return Interval(value_um=value, low_um=low, high_um=high)
