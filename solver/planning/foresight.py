"""The forecast uncertainty of a survey, computed from the positions of its stops without
readings."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.messages import Words, message
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import UnseenSlip
from stepdiag.base.result.prediction import BELOW, BETWEEN_SHARE, TAIL
from stepdiag.base.result.result import AXIS_LETTERS, DISPLACEMENTS
from stepdiag.base.result.waves import CURVED
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.scatter import Scatter
from stepdiag.solver.adjustment.slips import KINDS, slips_report
from stepdiag.solver.linear.families import (
    class_factors,
    hidden_factors,
    likely_factors,
    normal_points,
)
from stepdiag.solver.linear.fit import fit
from stepdiag.solver.linear.mixed import Causes, MixedFit
from stepdiag.solver.model.design import Design, Model, build_design
from stepdiag.solver.model.effects import effects_of
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.priors import make_prior
from stepdiag.solver.planning.information import (
    Aim,
    Machinery,
    SetupInformation,
    Zone,
    determined,
    information_by_setup,
    machinery,
    uncertainties,
)
from stepdiag.solver.uncertainty.machine import usual_sizes_of

BENT = 6.7
"""The usual difference (rms over the travel) between the smooth curve through n + 1 targets and the
straight lines of a table is BENT * shape / n^2. The factor was computed on random functions of five
half waves whose size decreases with their number."""
_OF_FEW = {
    1: (0.93, 0.0),
    2: (0.66, 0.20),
    3: (0.49, 0.22),
    4: (0.33, 0.19),
    5: (0.23, 0.16),
    6: (0.09, 0.15),
}
"""Results of `_between_targets` for few increments, for which the power laws are up to twice too
large."""
ALIKE = 0.2
"""Standard deviation of the logarithm of the error between targets, among machines of one class."""
_NEXT_TO_NONE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Foresight:
    """The forecast of the results of a survey, from the information of its setups
    (`solver.planning.information`). Each value is computed at its first use.

    ``increments`` is the number of increments of the survey; the layout may have fewer increments.
    """

    layout: Layout
    chain: str
    assumed: Assumptions
    increments: int
    aim: Aim = "lattice"
    zone: Zone | None = None

    @cached_property
    def by_setup(self) -> SetupInformation:
        return information_by_setup(self.layout, self.chain, self.assumed)

    @cached_property
    def information(self) -> Vector:
        """Return the information of all setups together, shape (q, q)."""
        matrix: Vector = np.sum(self.by_setup.each, axis=0)
        return matrix

    @cached_property
    def of(self) -> Machinery:
        return machinery(self.by_setup, self.aim, self.zone)

    @cached_property
    def known(self) -> dict[str, bool]:
        """Return for each quantity whether the survey will identify it."""
        found = determined(self.by_setup, self.information, usual_sizes_of(self.assumed))
        return {**dict.fromkeys(DISPLACEMENTS, True), **found}

    @cached_property
    def u(self) -> dict[str, float]:
        """Return the standard uncertainty (k = 1) of each identified quantity, rms over the
        nodes of a function."""
        found = uncertainties(self.by_setup, self.information, self.of)
        return {name: u for name, u in found.items() if self.known[name]}

    @cached_property
    def volumetric_um(self) -> float:
        """Return the standard uncertainty of the error vector over the volume, without the error of
        tables between their targets. The sizes of quantities that are not identified have an
        unknown common factor."""
        larger = np.sqrt(max(float(np.mean(class_factors() ** 2)) - 1.0, 0.0))
        return float(
            np.linalg.norm(
                [self.full[0], larger * self.missed[1], self.curved_um, self.hidden_um]
            )
        )

    @cached_property
    def full(self) -> tuple[float, float]:
        """Return the uncertainty of the error over the volume (rms) and its degrees of freedom.
        Quantities that are not identified have their usual size."""
        return self.of.over(self.information, self.of.precision(self.usual_u))

    @cached_property
    def usual_u(self) -> Vector:
        """Return the usual size in each row of `solver.uncertainty.machine.usual_rows`, infinite
        for an identified quantity."""
        return np.where(self.missed[0], self.of.usual_u, np.inf)

    @cached_property
    def missed(self) -> tuple[NDArray[np.bool_], float]:
        """Return a mask of the usual rows (`usual_u`) whose quantities are not identified, and the
        rms over the volume of the errors of these quantities."""
        missing = np.array(
            [not self.known.get(name, True) for name in self.of.usual_names], dtype=np.bool_
        )
        return missing, _missed_um(self, missing)

    @property
    def curved_um(self) -> float:
        """Return the usual deviation of all functions from the smooth curve through their
        targets in um."""
        return (
            float(np.sqrt(9.0)) * self.assumed.shape_um * _between_targets(self.increments)[0]
        )

    @property
    def hidden_um(self) -> float:
        """Return the usual size of waves shorter than two increments in um."""
        return float(np.sqrt(3.0 * BETWEEN_SHARE)) * self.assumed.between_um

    @cached_property
    def left_um(self) -> Interval:
        """Return the predicted error after an ideal compensation (k = 2), as
        `solver.result.prediction` computes it after the survey."""
        u, of = self.usual_u, self.of
        both, freedom = self.full
        quiet = of.over(self.information, of.precision(u, _NEXT_TO_NONE))[0]
        missing, missed = self.missed
        identified = quiet
        if np.any(missing):
            identified = of.over(
                self.information,
                of.precision(np.where(missing, _NEXT_TO_NONE * u, u), _NEXT_TO_NONE),
            )[0]
        angles = float(np.sqrt(max(both**2 - quiet**2, 0.0) + of.floor_um**2))
        return _left_um(
            identified_um=identified,
            missed_um=missed,
            angles_um=angles,
            hidden_um=self.hidden_um,
            bent_um=bent_um(self.assumed, self.increments),
            freedom=freedom,
        )

    @cached_property
    def _mixed(self) -> tuple[MixedFit, Design]:
        design = build_design(
            self.layout, self.chain, Model(misses=self.assumed.repeatability_um > 0.0)
        )
        effects = effects_of(self.layout, self.chain, self.by_setup.shapes, self.assumed)
        prior = make_prior(design, {})
        u = np.concatenate(
            [
                Scatter.assumed(self.layout, self.assumed).u_um(self.layout),
                self.assumed.repeatability_um * prior.u,
            ]
        )
        fixed = fit(
            design.rows.followed_by(prior.rows), design.blocks, np.zeros(len(u)), 1.0 / u**2
        )
        pattern = np.hstack(
            [np.zeros((len(self.layout), 0)), *(effect.pattern_um for effect in effects)]
        )
        pattern = np.pad(pattern, ((0, len(prior.u)), (0, 0)))
        return MixedFit(fixed, Causes.of(fixed, pattern), np.ones(pattern.shape[1])), design

    @cached_property
    def unseen(self) -> UnseenSlip | None:
        """Return the most harmful undetected slip of the laser's count on a diagonal
        (`slips_report`), None without a diagonal."""
        if not any(setup.kind in KINDS["diagonals"] for setup in self.layout.setups):
            return None
        found = slips_report(self._mixed[0], self.layout, self._mixed[1], ["diagonals"])
        return found.diagonals if found else None

    def hides(self) -> Words:
        """Return the message with the size of an undetected slip and its effect on the volume, or
        an empty text without a diagonal."""
        if self.unseen is None:
            return ""
        half_um, volume_um = self.unseen.half_um, self.unseen.volume_um
        if half_um is None or volume_um is None:
            return message("slip-hidden-any")
        return message("slip-hidden", half_um=half_um, volume_um=volume_um)


def bent_um(assumed: Assumptions, increments: int) -> float:
    """Return the deviation of the nine functions from the straight lines of tables between
    targets, rms over the volume in um."""
    return (
        float(np.sqrt(9.0))
        * assumed.shape_um
        * float(np.linalg.norm(_between_targets(increments)))
    )


def _between_targets(increments: int) -> tuple[float, float]:
    """Return two deviations of a function, divided by the size of its shape (both rms over the
    travel): from the function to the smooth curve through its targets, and from this curve to the
    straight lines between targets."""
    return _OF_FEW.get(increments, (CURVED / increments**3, BENT / increments**2))


def _missed_um(ahead: Foresight, missing: NDArray[np.bool_]) -> float:
    machine, fields, volume = ahead.of.machine, ahead.of.fields, ahead.layout.volume
    total = 0.0
    for name in dict.fromkeys(np.array(ahead.of.usual_names)[missing].tolist()):
        size = usual_sizes_of(ahead.assumed)[name]
        own = np.array(machine.names) == (f"E{name}{name}" if name in AXIS_LETTERS else name)
        if name in AXIS_LETTERS:
            length_m = 1e-3 * volume.size_mm[AXIS_LETTERS.index(name)]
            total += float(
                np.sum(
                    (size * length_m * (own * machine.node / volume.increments) @ fields) ** 2
                )
            )
        else:
            total += float(np.sum((size * fields[own]) ** 2))
    return float(np.sqrt(3.0 * total / fields.shape[1]))


def _left_um(
    *,
    identified_um: float,
    missed_um: float,
    angles_um: float,
    hidden_um: float,
    bent_um: float,
    freedom: float,
) -> Interval:
    """Return the median and the 95 % interval of the remaining error, over the likely sizes of
    angles and hidden waves and over the machines of a class.

    The arguments in um are rms over the volume: identified errors, errors that are not identified,
    usual effect of the angles, usual waves between targets, and the error of a table between
    targets (``bent_um``). ``freedom`` are the degrees of freedom of the sum of these errors.
    `ALIKE` is the scatter of ``bent_um`` among machines of a class.
    """
    factor = likely_factors()
    chance = normal_points(len(factor)) / np.sqrt(2.0 * freedom)
    angles, hidden = (
        angles_um * factor[:, None],
        hidden_um * np.roll(hidden_factors(), len(factor) // 2)[:, None],
    )
    missed = missed_um * class_factors()[:, None]
    # the order of these factors has no correlation with the order of the sizes of the angles and of
    # all other parts
    machines = np.exp(ALIKE * normal_points(len(factor)))[
        np.arange(len(factor)) * 4 % len(factor), None
    ]
    bent = bent_um * machines / np.sqrt(np.mean(machines**2))
    square = (
        missed**2
        + (identified_um**2 + angles**2) * np.maximum(1.0 + chance, 0.0) ** 2
        + hidden**2
        + bent**2
    )
    low, value, high = (
        float(end) for end in np.sqrt(np.quantile(square, (BELOW, 0.5, 1.0 - TAIL)))
    )
    return Interval(value_um=value, low_um=low, high_um=high)
