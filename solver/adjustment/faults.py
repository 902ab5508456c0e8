"""Contradictions of a survey, a stop, a step or a pass: searched, and left out if the readings
themselves show the cause.

A single pass of each diagonal checks every stop once or not at all, and two passes may share a
check: then the residuals alone cannot separate them. The smoothness of the machine that an
explanation leaves is part of its odds (`solver.adjustment.evidence`). If the odds do not decide,
every explanation is left open with the size of the contradiction, all are named, and such a survey
may not compensate a machine.
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
"""Effects of the adjustment by which a fault is left open."""
TRIAL = "suspicion"
"""Effect of a fault that is being weighed."""
LEAST_UM = 0.5
"""Least size of a wrong stop or step in um, however small the noise, and least difference between
two machines over the volume (rms) that matters: about the repeatability of a machine.
"""
MOST_WEIGHED = 200
"""So many stops and steps, the best by their residues, are weighed by the machine's smoothness: a
step among thousands of readings makes most of its neighbours probable."""
FREE_UM = 1e3
"""Of a size of which nothing is known beforehand."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fault:
    """A stop, a step, a place of the machine or a walk: its ``pattern`` (k, r) on ``rows`` (k,),
    its size, and the reading by which it is named.

    ``odds``: logarithm of its odds against no fault, including ``prior``, the part before any
    reading, and ``smoother``, the part of the machine's smoothness. ``without`` (count,): the
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
    """A contradiction: the probable faults, the best first, a single fault if it has `ODDS` times
    the odds of the next.

    ``apart_um``: largest difference over the volume between their machines (rms, the furthest from
    the best).
    """

    faults: Sequence[Fault]
    apart_um: float = 0.0

    @property
    def best(self) -> Fault:
        """Return the most probable fault."""
        return self.faults[0]

    @property
    def decided(self) -> bool:
        """Return whether the readings decide on the cause."""
        return len(self.faults) == 1


def most_suspicious(fit: MixedFit, columns: Columns, every: Counts) -> Suspicion | None:
    """Return the worst contradiction among the readings; None unless an explanation is `ODDS` times
    as likely as chance.
    """
    # the misses of the machine take most of the redundancy: in a small survey no single reading is
    # checked, but all together are
    if not np.any((fit.redundancy > CHECKED) & (fit.weight > 0)):
        return None
    found = sorted(
        [*_singles(fit, columns, every), *walks(fit, every)],
        key=lambda one: -round(one.odds, DECIMALS),
    )
    if not found or found[0].odds <= np.log(ODDS):
        return None
    kept = [one for one in found if one.odds > found[0].odds - np.log(ODDS)]
    # a wandering pass explains its own single stops and steps, too: all are one explanation
    if kept[0].kind == WALK:
        kept = [
            kept[0],
            *(one for one in kept[1:] if not np.array_equal(one.rows, kept[0].rows)),
        ]
    return Suspicion(faults=kept)


def families(fit: MixedFit, every: Counts) -> Iterator[Family]:
    """Return the wrong stops and the steps on ``every`` count of the used readings, and those of
    the machine: the same in each drive of a way.
    """
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
    # a step before the second reading or the last is a wrong first or last one
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
    """Return the machine's stops and steps on a way that was driven more than once.

    Two drives that contradict all others alike do not contradict each other: no fault of a reading
    or of a count repeats at its place.
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


def most_odds(fit: MixedFit, every: Counts) -> float:
    """Return the log-odds, against no fault, of the best stop, step or walk on ``every`` count of
    the readings, by the readings alone; minus infinity without counts.
    """
    single = list(families(fit, every))
    weighed = [
        family.weighed(fit, number_of(single, family.kind)).log_odds for family in single
    ]
    odds = np.concatenate([*weighed, [one.odds for one in walks(fit, every)], [-np.inf]])
    return float(np.max(odds))


def number_of(every: Sequence[Family], kind: str) -> int:
    """Return the number of explanations of a kind."""
    return sum(len(one.named) for one in every if one.kind == kind)


def _singles(fit: MixedFit, columns: Columns, every: Counts) -> list[Fault]:
    """Return the stops and steps with any evidence, at most `MOST_WEIGHED`, with the evidence of
    the machine's smoothness.
    """
    all_of, ranked = list(families(fit, every)), []
    prior = {kind: log_prior(kind, number_of(all_of, kind)) for kind in (STOP, STEP, PLACE)}
    for family in all_of:
        odds, size = family.weighed(fit, number_of(all_of, family.kind)).log_odds, family.size
        places = np.flatnonzero((odds > -np.log(ODDS)) & (np.abs(size) >= LEAST_UM))
        ranked += [
            (float(odds[place]), family, place, float(size[place])) for place in places
        ]
    # equally good explanations stand in the order of the readings, not in that of rounding
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
    """Return for each count the fault that its pass wanders: all its steps at once, as a random
    walk in addition to the usual effects of every pass.
    """
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
    """Return a suspicion with the distance between its explanations."""
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
    """Return the weights without the single wrong stop, or with every possible stop as uncertain as
    the contradiction is large.
    """
    lowered = weight.copy()
    for one in suspicion.faults:
        if one.kind == STOP:
            lowered[one.named] = (
                0.0 if suspicion.decided else 1.0 / (1.0 / weight[one.named] + one.size**2)
            )
    return lowered


def effects_for(layout: Layout, suspicion: Suspicion, text: Words) -> list[Effect]:
    """Return the effects that the adjustment leaves open from now on: a decided step or place of
    the machine completely, a possible one and a walk by its size.
    """
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
    """Return the best explanation as an effect of its size."""
    return Effect(
        name=TRIAL, text="", pattern_um=suspicion.best.size * suspicion.best.on(len(layout))
    )
