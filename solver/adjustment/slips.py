"""How large a slip of the laser's count may be without being noticed, from where the stops are and how well the readings check each other.

The smallest step of a count that stands out of what the fit and the usual causes leave of it (Baarda 1968, minimal detectable bias). It
needs no reading: a plan says it before the survey, a result after it, by the same figures.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.adjustment.counts import Count, counts, from_each_on, short_counts
from stepdiag.solver.adjustment.hypotheses import HIDDEN, LEAST_UM, tell
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.linear.ties import first_of_the_largest
from stepdiag.solver.model.design import Design
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.quantities import lattice_field_um, quantities

STANDS_OUT = 5.0
"""Standard uncertainties at which a step of the count is told from chance in half of the surveys."""
NEARLY_ALWAYS = 8.0
"""Nearly always: 6.65 by the normal distribution (95 %), but where few readings check each other, effects larger than usual explain part of
a step: of drawn surveys with seven degrees of freedom two thirds were named at 6.65, 94 % at 7.5, all at 8.5; with more, 71 of 72 at 6.65.
"""
KINDS = {"diagonals": ("step", "face"), "runs": ("linear",)}
"""Names in the result, and the kinds of setups that each holds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unseen:
    """The step of a count that is seen least, and where: on the way to a stop of a pass; ``u_um`` is infinite where nothing tells it."""

    setup: str
    pass_number: int
    stop: int
    u_um: float
    rows: NDArray[np.int64]
    """The readings that are off by it."""

    @property
    def half_um(self) -> float:
        """Return of which size it is seen in half of the surveys."""
        return max(STANDS_OUT * self.u_um, LEAST_UM)

    @property
    def nearly_um(self) -> float:
        """Return of which size it is seen in 95 % of them and more."""
        return max(NEARLY_ALWAYS * self.u_um, LEAST_UM + 2.0 * self.u_um)


def least_seen(fit: MixedFit, layout: Layout, kinds: Collection[str]) -> Unseen | None:
    """Return the step that is seen least in setups of some kinds; None where there are none of them.

    In a count too short to be looked through nothing is seen, whatever its size.
    """
    blind = [_unseen(layout, rows, 1, np.inf) for rows in short_counts(fit.fixed, layout, kinds)]
    found = [_least_of(fit, layout, count) for count in counts(fit.fixed, layout, kinds)]
    every = blind + found
    return every[first_of_the_largest([each.u_um for each in every])] if every else None


def _least_of(fit: MixedFit, layout: Layout, count: Count) -> Unseen:
    mixed = from_each_on(fit.causes.left[count.rows] @ fit.root.T)
    seen = (count.step - np.sum(mixed**2, axis=1))[1:]
    told = seen > HIDDEN * from_each_on(fit.weight[count.rows])[1:]
    u_um = np.where(told, 1.0 / np.sqrt(np.where(told, seen, 1.0)), np.inf)
    place = first_of_the_largest(u_um) + 1
    return _unseen(layout, count.rows, place, float(u_um[place - 1]))


def _unseen(layout: Layout, rows: NDArray[np.int64], place: int, u_um: float) -> Unseen:
    key = layout.passes[layout.pass_index[rows[place]]]
    return Unseen(setup=key.setup, pass_number=key.number, stop=int(layout.stop[rows[place]]), u_um=u_um, rows=rows[place:])


def slips_report(fit: MixedFit, layout: Layout, design: Design) -> dict[str, dict[str, Any]]:
    """Return for diagonals and runs along an axis the slip that is seen least, as the result holds it (um; None: of any size).

    ``volume_um`` is what a slip of ``half_um`` makes of the errors over the volume (rms), as far as they are identified.
    """
    report = {}
    for name, kinds in KINDS.items():
        unseen = least_seen(fit, layout, kinds)
        if unseen is not None:
            report[name] = _as_json(unseen, _volume_um(unseen, fit, layout, design))
    return report


def _volume_um(unseen: Unseen, fit: MixedFit, layout: Layout, design: Design) -> float:
    every = quantities(design.columns, layout.volume)
    wanted = every.select(np.flatnonzero(fit.inverse.sees(every.combination)))
    moved = tell(fit, unseen.rows, np.ones((len(unseen.rows), 1))).moved
    field = lattice_field_um(wanted, layout.volume, design.chain) @ wanted.combination.times(moved)[:, 0]
    return unseen.half_um * float(np.sqrt(np.mean(np.sum(field**2, axis=1))))


def _as_json(unseen: Unseen, volume_um: float) -> dict[str, Any]:
    told = bool(np.isfinite(unseen.u_um))
    return {
        "setup": unseen.setup,
        "pass": unseen.pass_number,
        "stop": unseen.stop,
        "half_um": unseen.half_um if told else None,
        "nearly_um": unseen.nearly_um if told else None,
        "volume_um": volume_um if told else None,
    }
