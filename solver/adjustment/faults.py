"""Contradictions of a survey: a wrong stop, a step of the count, a local error of the machine, or a
wandering pass. A fault is omitted from the fit if the readings show the cause.

With one pass of each diagonal, the residuals of two passes may not separate the causes. The odds
(`solver.adjustment.evidence`) therefore include the smoothness of the machine errors under each
explanation. If the odds do not decide, one finding lists all explanations, and an export is
refused. Every explanation is then a random effect with the size of the contradiction.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Words
from stepdiag.base.volume import Vector, Volume
from stepdiag.solver.adjustment.counts import Count, Counts, Way, from_each_on, steps_of
from stepdiag.solver.adjustment.evidence import (
    DECIMALS,
    ODDS,
    PLACE,
    STEP,
    STOP,
    WALK,
    Family,
    directions,
    evidence_of_many,
    log_prior,
    response_of,
    visible,
)
from stepdiag.solver.adjustment.smoothness import roughness
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.model.design import Columns
from stepdiag.solver.model.effects import Effect
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import CHECKED
from stepdiag.solver.model.quantities import lattice_field_um, quantities

EFFECTS = {STEP: "found step", PLACE: "place of the machine", WALK: "wandering pass"}
"""Effects of the adjustment for each kind of fault."""
TRIAL = "suspicion"
LEAST_UM = 0.5
"""Smallest wrong stop or step in um, and smallest difference between two machines over the
volume (rms): about the repeatability of a machine."""
MOST_WEIGHED = 200
"""Largest number of stops and steps for which the smoothness of the machine is computed."""
FREE_UM = 1e3
"""Standard deviation of an effect of completely unknown size."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fault:
    """A wrong stop, a step, a local error of the machine or a walk: its ``pattern`` (k, r) on the
    readings ``rows`` (k,), and its size. ``named`` is the number of the reading at which the fault
    begins.

    ``odds`` is the logarithm of the odds against no fault; it includes ``prior`` and ``smoother``,
    the parts by the prior and by the smoothness of the machine. ``without`` (count,) are the
    unknowns if the fault is true.
    """

    kind: str
    named: int
    rows: NDArray[np.int64]
    pattern: Vector
    size: float
    prior: float
    odds: float
    without: Vector
    smoother: float = 0.0

    def on(self, count: int) -> Vector:
        """Return the pattern on all readings, shape (count, r)."""
        whole = np.zeros((count, self.pattern.shape[1]))
        whole[self.rows] = self.pattern
        return whole


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Suspicion:
    """A contradiction: its probable faults, the most probable first. If the list contains only one
    fault, its odds are at least `ODDS` times those of every other fault.

    ``apart_um`` is the largest difference between the machine errors under these faults over the
    volume (rms).
    """

    faults: Sequence[Fault]
    apart_um: float = 0.0

    @property
    def best(self) -> Fault:
        return self.faults[0]

    @property
    def decided(self) -> bool:
        return len(self.faults) == 1


def most_suspicious(fit: MixedFit, columns: Columns, every: Counts) -> Suspicion | None:
    """Return the contradiction with the highest odds, or None if the odds of no explanation exceed
    `ODDS` times those of no fault."""
    # in a small survey the positioning deviations of the moves can explain any single reading: only
    # all readings together are checked
    if not np.any((fit.redundancy > CHECKED) & (fit.weight > 0)):
        return None
    found = sorted(
        [*_singles(fit, columns, every), *walks(fit, every)],
        key=lambda one: -round(one.odds, DECIMALS),
    )
    if not found or found[0].odds <= np.log(ODDS):
        return None
    kept = [one for one in found if one.odds > found[0].odds - np.log(ODDS)]
    # a wandering pass also explains its own stops and steps
    if kept[0].kind == WALK:
        kept = [
            kept[0],
            *(one for one in kept[1:] if not np.array_equal(one.rows, kept[0].rows)),
        ]
    return Suspicion(faults=kept)


def families(fit: MixedFit, every: Counts) -> Iterator[Family]:
    """Yield the wrong stops and steps of ``every`` count, and the local errors of the machine,
    which repeat in each pass of a travel."""
    for count in every.single:
        yield from _on_count(fit, count)
    for way in every.ways:
        yield _on_way(fit, way)


def _on_count(fit: MixedFit, count: Count) -> Iterator[Family]:
    rows, number = count.rows, len(count.rows)
    weight = fit.weight[rows]
    shown = weight * fit.residual[rows]
    mixed = fit.taken_over[rows]
    yield Family(
        kind=STOP,
        rows=rows,
        named=rows,
        shown=shown,
        seen=visible(count.stop - np.sum(mixed**2, axis=1), weight),
        pattern=lambda places: (np.arange(number)[:, None] == places).astype(np.float64),
    )
    # a step before the second or the last reading is the same as a wrong first or last reading
    inner = slice(2, -1)
    yield Family(
        kind=STEP,
        rows=rows,
        named=rows[inner],
        shown=from_each_on(shown)[inner],
        seen=visible(
            count.step - np.sum(from_each_on(mixed) ** 2, axis=1), from_each_on(weight)
        )[inner],
        pattern=lambda places: steps_of(number, places + 2),
    )


def _on_way(fit: MixedFit, way: Way) -> Family:
    """Return the local errors and steps of the machine on a repeated travel.

    If all passes of a travel contradict the other setups equally, the cause is the machine, because
    errors of a reading or a count do not repeat.
    """
    mixed = way.pattern.T @ fit.taken_over[way.rows]
    return Family(
        kind=PLACE,
        rows=way.rows,
        named=way.named,
        shown=way.pattern.T @ (fit.weight[way.rows] * fit.residual[way.rows]),
        seen=visible(way.left - np.sum(mixed**2, axis=1), way.whole),
        pattern=lambda places: way.pattern[:, places],
    )


def number_of(every: Sequence[Family], kind: str) -> int:
    return sum(len(one.named) for one in every if one.kind == kind)


def _singles(fit: MixedFit, columns: Columns, every: Counts) -> list[Fault]:
    all_of, ranked = list(families(fit, every)), []
    prior = {kind: log_prior(kind, number_of(all_of, kind)) for kind in (STOP, STEP, PLACE)}
    for family in all_of:
        odds, size = family.weighed(fit, number_of(all_of, family.kind)).log_odds, family.size
        places = np.flatnonzero((odds > -np.log(ODDS)) & (np.abs(size) >= LEAST_UM))
        ranked += [
            (float(odds[place]), family, place, float(size[place])) for place in places
        ]
    # equal odds are sorted by reading, so that the order does not depend on rounding
    ranked.sort(key=lambda one: -round(one[0], DECIMALS))
    del ranked[MOST_WEIGHED:]
    if not ranked:
        return []
    on_all = np.zeros((len(fit.weight), len(ranked)))
    for column, (_, family, place, _) in enumerate(ranked):
        on_all[family.rows, column] = family.pattern(np.array([place]))[:, 0]
    without = (
        fit.unknowns[:, None]
        - np.array([one[3] for one in ranked])
        * response_of(fit, np.arange(len(on_all)), on_all).moved
    )
    rough = roughness(
        columns, np.column_stack([fit.unknowns, without]), fit.inverse.variance()
    )
    return [
        Fault(
            kind=family.kind,
            named=int(family.named[place]),
            rows=family.rows,
            pattern=on_all[family.rows, column, None],
            size=size,
            prior=prior[family.kind],
            odds=odds + smoother,
            without=without[:, column],
            smoother=smoother,
        )
        for column, ((odds, family, place, size), smoother) in enumerate(
            zip(ranked, (0.5 * (rough[0] - rough[1:])).tolist(), strict=True)
        )
    ]


def walks(fit: MixedFit, every: Counts) -> list[Fault]:
    """Return the fault "wandering pass" of each count: a random walk in addition to the usual
    random effects."""
    found, prior = [], log_prior(WALK, len(every.single))
    for count in every.single:
        mixed = fit.root @ (fit.causes.left[count.rows].T @ count.walk)
        shown, seen = directions(
            count.walked - mixed.T @ mixed,
            count.walk.T @ (fit.weight[count.rows] * fit.residual[count.rows]),
        )
        square = (
            max(float(np.sum(shown**2 / seen)) - len(seen), 1.0) / float(np.sum(seen))
            if len(seen)
            else 0.0
        )
        found.append(
            Fault(
                kind=WALK,
                named=int(count.rows[0]),
                rows=count.rows,
                pattern=count.walk,
                size=float(np.sqrt(square)),
                prior=prior,
                odds=prior + evidence_of_many(fit, shown, seen),
                without=fit.unknowns,
            )
        )
    return found


def with_apart(
    suspicion: Suspicion, columns: Columns, volume: Volume, chain: str
) -> Suspicion:
    if suspicion.decided:
        return suspicion
    wanted = quantities(columns, volume)
    off = wanted.combination.times(
        np.array([one.without - suspicion.best.without for one in suspicion.faults[1:]]).T
    )
    field = lattice_field_um(wanted, volume, chain)
    square = np.sum((field @ off) ** 2, axis=(0, 1)) / len(field)
    return replace(suspicion, apart_um=float(np.sqrt(np.max(square))))


def weight_without(weight: Vector, suspicion: Suspicion) -> Vector:
    """Return the weights of the readings. A wrong stop gets the weight 0 if it is the only probable
    fault; otherwise the size of the contradiction is added to its uncertainty."""
    lowered = weight.copy()
    for one in suspicion.faults:
        if one.kind == STOP:
            lowered[one.named] = (
                0.0 if suspicion.decided else 1.0 / (1.0 / weight[one.named] + one.size**2)
            )
    return lowered


def effects_for(layout: Layout, suspicion: Suspicion, text: Words) -> list[Effect]:
    """Return the random effects of a suspicion. If a step or a local error is the only probable
    fault, its size is unlimited; other faults have the size of the contradiction."""
    free = suspicion.decided and suspicion.best.kind in (STEP, PLACE)
    return [
        Effect(
            name=EFFECTS[one.kind],
            text=text,
            pattern_um=(FREE_UM if free else one.size) * one.on(len(layout)),
        )
        for one in suspicion.faults
        if one.kind != STOP
    ]


def trial_of(layout: Layout, suspicion: Suspicion) -> Effect:
    return Effect(
        name=TRIAL, text="", pattern_um=suspicion.best.size * suspicion.best.on(len(layout))
    )
