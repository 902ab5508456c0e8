"""Theory of operation: errors of a whole survey, and the mixture that is its result.

A wrong stop, step or pass has its own residuals (`solver.adjustment.faults`). Three kinds of errors
have no residuals of their own: the scale of a setup, machine errors that are not a function of one
axis (`PRODUCTS`: products of two axes in a component, and y^2 z in Z, a ram that sags), and unusual
growth. One length compares the seven setups of a usual survey, so most of these errors explain this
length equally well. `solver.adjustment.evidence` computes the odds of all errors. The comparison
includes wrong stops, steps and wandering passes, so that a product does not explain readings with
one of these faults. Growth and scales of all setups have at most their usual size, because they
explain the same length.

A kind of explanation is in the mixture if its odds are at least 1 / `ODDS` of the best odds,
including "no error". The limit 1 / `ODDS` also applies to the explanations of one kind. The mixture
of a good survey has no explanations.

An explanation is the named cause if it has `ODDS` times the probability of all other explanations
together.

If setups and products have more than half of the probability without a named cause, all candidates
are reported (`solver.methods.doubt`). If this needs growth as a candidate, all candidates are
reported only if compensation could increase the error. If the lengths contradict each other, an
export is refused (`solver.adjustment.diagnostics.scale_findings`).

Each explanation in the mixture is a random effect with a share of its expected square E[t^2 | k,
y], for estimate, budget, posterior and predictions. With the share p_k, the probability of
explanation k, a normal distribution has the moments of the mixture. If explanation k is true, the
error of the mixture is t (1 - p). 2 u covers this error if u^2 is at least t^2 (1 - p)^2 / 4.
Therefore the most probable kinds, which together with "no error" have the probability `SURE`, have
the larger share

    max(p_k, (1 - p_k) / 4)

Products are not functions of one axis: the posterior contains products as separate numbers, and no
table contains them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import message
from stepdiag.base.names import PRODUCTS
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.counts import Counts
from stepdiag.solver.adjustment.evidence import (
    DECIMALS,
    GROWN,
    HIDDEN,
    ODDS,
    PLACE,
    PRODUCT,
    SCALE,
    STEP,
    STOP,
    SURE,
    WALK,
    Family,
    directions,
    evidence_of_many,
    log_prior,
    response_of,
)
from stepdiag.solver.adjustment.faults import families, number_of, walks
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.model.effects import BESIDE, ONE_SCALE, ONE_WALK, Effect
from stepdiag.solver.model.layout import Layout

MOST_UM, MOST_UM_M = 50.0, 200.0
"""Largest size in the search, of products in um and of scales in um/m."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explained:
    """Explanations outside the model: scales of single setups, products of two axes, growth.

    ``kinds`` (c,) is the kind of each explanation. ``named`` (c,) is the number of its setup, or
    its index in `PRODUCTS`. ``size`` (c,) is the size of each explanation in um/m, or in um at the
    far corner. ``share`` (c,) is its probability. ``spread`` (c,) is its standard deviation in the
    mixture. ``growth`` is the probability of unusual growth, ``nothing`` the probability of no
    error. ``walk_um`` (m, k) are the steps of wandering passes in the mixture.
    """

    kinds: tuple[str, ...]
    named: NDArray[np.int64]
    size: Vector
    share: Vector
    spread: Vector
    growth: float
    nothing: float
    walk_um: Vector

    @property
    def grows(self) -> bool:
        """Return whether unusual growth is the cause, and not the scale of a setup."""
        return self.growth > ODDS * self.of_kind(SCALE)

    @property
    def unnamed(self) -> bool:
        """Return whether setups and products have more than half of the probability without a
        named cause."""
        return float(np.sum(self.share)) > 0.5 and not self.names

    @property
    def unnamed_with_growth(self) -> bool:
        """Return whether setups, products and growth have more than half of the probability
        without a named cause."""
        return float(np.sum(self.share)) + self.growth > 0.5 and not (
            self.names or self.grows
        )

    @property
    def machine_named(self) -> bool:
        """Return whether all products together have `ODDS` times the probability of all other
        explanations."""
        return _outweighs(self.of_kind(PRODUCT))

    @property
    def names(self) -> list[int]:
        """Return the indices of the named cause: one setup, or all probable products."""
        products, scales = self.probable(PRODUCT), self.probable(SCALE)
        if self.machine_named:
            return products
        return scales[:1] if scales and _outweighs(float(self.share[scales[0]])) else []

    def of(self, kind: str) -> NDArray[np.int64]:
        return np.flatnonzero(np.array(self.kinds) == kind)

    def of_kind(self, kind: str) -> float:
        """Return the probability of a kind of explanation."""
        return float(np.sum(self.share[self.of(kind)]))

    def probable(self, kind: str) -> list[int]:
        """Return the indices of the explanations of a kind in the mixture, the most probable
        first."""
        mine = self.of(kind)
        kept = mine[self.share[mine] > 0.0]
        return [
            int(place)
            for place in kept[
                np.argsort(-np.round(self.share[kept], DECIMALS), kind="stable")
            ]
        ]


def explained(fit: MixedFit, layout: Layout, growth_um: Vector, every: Counts) -> Explained:
    """Return the mixture of the explanations of a survey; ``growth_um`` (m, k) is the effect of
    growth.

    Stops, steps and walks on ``every`` count have a share of the probability. A walk is also in the
    mixture, because a product could otherwise explain it.
    """
    beside, single, wandering = (
        list(families_beside(fit, layout)),
        list(families(fit, every)),
        walks(fit, every),
    )
    weighed = [family.weighed(fit, len(family.named)) for family in beside]
    of_faults = {
        kind: [
            one.weighed(fit, number_of(single, kind)).log_odds
            for one in single
            if one.kind == kind
        ]
        for kind in (STOP, STEP, PLACE)
    }
    of_faults[WALK] = [np.array([one.odds for one in wandering])]
    odds = {family.kind: [one.log_odds] for family, one in zip(beside, weighed, strict=True)}
    odds |= {**of_faults, GROWN: [np.full(1, _of_growth(fit, growth_um))]}
    by_kind = {kind: np.concatenate([np.zeros(0), *each]) for kind, each in odds.items()}
    every_kind = np.repeat(list(by_kind), [len(each) for each in by_kind.values()])
    share = shares(np.concatenate(list(by_kind.values())), every_kind)
    reached = reaching(share, every_kind)
    walking = reached[np.equal(every_kind, WALK)].tolist()
    opened = [
        np.sqrt(part) * one.size * one.on(len(layout))
        for one, part in zip(wandering, walking, strict=True)
        if part > 0.0
    ]
    nothing = np.zeros(0)
    count = sum(len(family.named) for family in beside)
    return Explained(
        kinds=tuple(every_kind[:count].tolist()),
        named=np.concatenate(
            [nothing.astype(np.int64), *(family.named for family in beside)]
        ),
        size=np.concatenate([nothing, *(family.size for family in beside)]),
        share=share[:count],
        spread=np.sqrt(
            reached[:count] * np.concatenate([nothing, *(one.square for one in weighed)])
        ),
        growth=float(share[-1]),
        nothing=1.0 - float(np.sum(share)),
        walk_um=np.hstack([np.zeros((len(layout), 0)), *opened]),
    )


def most_odds_beside(fit: MixedFit, layout: Layout) -> float:
    """Return the log-odds of the best scale or product against no error, minus infinity if there
    are none."""
    weighed = [
        one.weighed(fit, len(one.named)).log_odds for one in families_beside(fit, layout)
    ]
    return float(np.max(np.concatenate([*weighed, [-np.inf]])))


def effects_beside(layout: Layout, found: Explained) -> list[Effect]:
    """Return the effects outside the model, each with its standard deviation in the mixture."""
    scales, products = found.of(SCALE), found.of(PRODUCT)
    of_scales = _of_setups(layout, found.named[scales])
    opened = (
        (ONE_SCALE, message("open-scale"), of_scales * found.spread[scales]),
        (ONE_WALK, message("open-walk"), found.walk_um),
        (
            BESIDE,
            message("open-products"),
            products_um(layout)[:, found.named[products]] * found.spread[products],
        ),
    )
    return [
        Effect(name=name, text=text, pattern_um=pattern)
        for name, text, pattern in opened
        if np.any(pattern)
    ]


def shares(odds: Vector, kinds: NDArray[np.str_]) -> Vector:
    """Return the probability of each explanation, shape (c,), from log-odds against no error. The
    probability of no error is 1 minus the sum.

    A kind with less than 1 / `ODDS` of the best odds has the probability 0.
    """
    best = max(float(np.max(odds)), 0.0)
    weight, none = np.exp(odds - best), float(np.exp(-best))
    kind = np.unique(kinds, return_inverse=True)[1]
    most = np.zeros(len(kinds))
    np.maximum.at(most, kind, weight)
    of_kind, most = np.bincount(kind, weight)[kind], most[kind]
    least = max(float(np.max(of_kind)), none) / ODDS
    kept = np.where((of_kind > least) & (weight * ODDS > most), weight, 0.0)
    found: Vector = kept / (np.sum(kept) + (none if none > least else 0.0))
    return found


def reaching(share: Vector, kinds: NDArray[np.str_]) -> Vector:
    """Return the share of the expected square of each explanation in the mixture, shape (c,)."""
    held, inside = 1.0 - float(np.sum(share)), []
    of_kind = {str(kind): float(np.sum(share[kinds == kind])) for kind in np.unique(kinds)}
    for kind, part in sorted(of_kind.items(), key=lambda one: -one[1]):
        if held < SURE:
            inside.append(kind)
            held += part
    reached: Vector = np.where(
        (share > 0.0) & np.isin(kinds, inside), np.maximum(share, (1.0 - share) / 4.0), share
    )
    return reached


def products_um(layout: Layout) -> Vector:
    """Return the effect on every reading of 1 um of each product at the far corner, shape (m,
    products)."""
    if not layout.volume.solid:
        return np.zeros((len(layout), len(PRODUCTS)))
    share = (layout.position_mm - layout.volume.origin_mm) / layout.volume.length_mm
    columns = [
        layout.direction[:, component] * np.prod(share[:, axes], axis=1)
        for component, axes in PRODUCTS.values()
    ]
    return np.column_stack(columns)


def along_the_way_m(layout: Layout) -> Vector:
    """Return the distance of each reading from the low corner along its setup's direction in m,
    shape (m,)."""
    along: Vector = 1e-3 * np.sum(
        (layout.position_mm - layout.volume.origin_mm) * layout.direction, axis=1
    )
    return along


def families_beside(fit: MixedFit, layout: Layout) -> Iterator[Family]:
    """Yield the scales of single setups and the products of two axes."""
    used = np.flatnonzero(fit.weight[: len(layout)] > 0)
    setups = np.unique(layout.setup_index[used])
    if len(setups) > 1:
        yield _family(
            fit,
            used,
            _of_setups(layout, setups)[used],
            kind=SCALE,
            named=setups,
            most=MOST_UM_M,
        )
    if layout.volume.solid:
        yield _family(
            fit,
            used,
            products_um(layout)[used],
            kind=PRODUCT,
            named=np.arange(len(PRODUCTS)),
            most=MOST_UM,
        )


def _family(
    fit: MixedFit,
    rows: NDArray[np.int64],
    pattern: Vector,
    *,
    kind: str,
    named: NDArray[np.int64],
    most: float,
) -> Family:
    response = response_of(fit, rows, pattern)
    seen = np.diag(response.seen)
    seen = np.where(seen > np.maximum(HIDDEN * response.whole, most**-2.0), seen, 0.0)
    return Family(
        kind=kind,
        rows=rows,
        named=named,
        shown=response.shown,
        seen=seen,
        pattern=lambda places: pattern[:, places],
        most=most,
    )


def _of_setups(layout: Layout, setups: NDArray[np.int64]) -> Vector:
    return np.asarray(
        along_the_way_m(layout)[:, None] * (layout.setup_index[:, None] == setups)
    )


def _of_growth(fit: MixedFit, growth_um: Vector) -> float:
    if not growth_um.shape[1]:
        return -np.inf
    response = response_of(fit, np.arange(len(growth_um)), growth_um)
    return evidence_of_many(fit, *directions(response.seen, response.shown)) + log_prior(
        GROWN, 1
    )


def _outweighs(probability: float) -> bool:
    return probability > ODDS * (1.0 - probability)
