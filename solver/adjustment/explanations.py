"""Errors of a whole survey, and the mixture that is its result.

A wrong stop, step or pass shows in its own residuals (`solver.adjustment.faults`). The errors
weighed here have no residual of their own: a setup with another scale, a machine with errors
outside every function of an axis (`PRODUCTS`: products of the shares of two axes in a component,
and y^2 z in Z, a ram that sags), and a machine with unusual growth. A single length compares the
seven setups of a usual survey, so most of these errors explain the same pattern equally well.
`solver.adjustment.evidence` gives their odds. Stops, steps and walks compete, too: a product must
not explain their part. In V, growth and scales of all setups have at most their usual size, because
they explain the same length.

- A kind is in the mixture only if its odds are at least one in `ODDS` of the best odds, those of no
  error included; the same holds for an explanation within its kind. In a good survey no explanation
  is left open, and its result is that of the plain adjustment.
- A cause is named if it has `ODDS` times the probability of all others together.
- If setups and products are more probable than not and none is named, all candidates are reported
  (`solver.methods.doubt`); with growth among them only if a compensation could leave a larger error
  than before. The lengths decide on a refusal (`solver.adjustment.diagnostics.scale_findings`).

The mixture is the result. Each explanation is left open by a share of its expected square E[t^2 |
k, y]: estimate, budget, posterior and predictions use the same causes. The normal distribution with
the mixture's moments has the share p_k, its probability. If k is true, the mixture is wrong by t (1
- p), and 2 u covers this error with (1 - p)^2 / 4p of p t^2. So every explanation of the smallest
  set of kinds with `SURE` of all probability, no error included, has the share

    max(p_k, (1 - p_k) / 4)

Products are not functions of an axis: the posterior holds them as separate numbers, and no table
contains them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import message
from stepdiag.base.result.field import PRODUCTS
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
"""Largest size searched: larger products or scales do not occur."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explained:
    """Explanations of a survey beside the model: scales of single setups, products of two axes,
    growth.

    ``named`` (c,) are setups and places in `PRODUCTS` in the order of ``kinds`` (c,), ``size`` (c,)
    the size of each alone, in um/m or in um at the far end, ``share`` (c,) its probability, and
    ``spread`` (c,) the size left open. ``growth``: probability of unusual growth, ``nothing``:
    probability that all is usual. ``walk_um`` (m, k) are steps of passes that may wander, with the
    size left open.
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
        """Return whether unusual growth is the explanation, and not a setup with another scale."""
        return self.growth > ODDS * self.of_kind(SCALE)

    @property
    def unnamed(self) -> bool:
        """Return whether setups and products are more probable than not, and none is named."""
        return float(np.sum(self.share)) > 0.5 and not self.names

    @property
    def unnamed_with_growth(self) -> bool:
        """Return whether setups, products and growth together are more probable than not, and none
        is named.
        """
        return float(np.sum(self.share)) + self.growth > 0.5 and not (
            self.names or self.grows
        )

    @property
    def machine_named(self) -> bool:
        """Return whether the products together outweigh every other explanation."""
        return _outweighs(self.of_kind(PRODUCT))

    @property
    def names(self) -> list[int]:
        """Return the indices of the named explanations: a setup, or the products that remain
        probable.
        """
        products, scales = self.probable(PRODUCT), self.probable(SCALE)
        if self.machine_named:
            return products
        return scales[:1] if scales and _outweighs(float(self.share[scales[0]])) else []

    def of(self, kind: str) -> NDArray[np.int64]:
        """Return the places of a kind."""
        return np.flatnonzero(np.array(self.kinds) == kind)

    def of_kind(self, kind: str) -> float:
        """Return how probable a kind is."""
        return float(np.sum(self.share[self.of(kind)]))

    def probable(self, kind: str) -> list[int]:
        """Return the indices of the explanations of a kind that remain probable, the best first."""
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
    growth, which may be larger than usual.

    A stop, a step or a walk on ``every`` count of the readings competes for the probability. Stops
    and steps are repaired elsewhere; a walk is left open as well, because a product could otherwise
    explain its part.
    """
    beside, single, wandering = (
        list(_families(fit, layout)),
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
    """Return the log-odds, against no fault, of the best scale or product, by the readings alone;
    minus infinity without either.
    """
    weighed = [one.weighed(fit, len(one.named)).log_odds for one in _families(fit, layout)]
    return float(np.max(np.concatenate([*weighed, [-np.inf]])))


def effects_beside(layout: Layout, found: Explained) -> list[Effect]:
    """Return the effects outside the model that remain undecided: each explanation with its spread;
    empty if no kind is in the mixture.
    """
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
    """Return the probability of each explanation, shape (c,), from their odds against no error
    (logarithms); the rest is the probability of no error.

    A kind with less than one in `ODDS` of the best is not in the mixture: explanations with a
    common pattern are kept or dropped together.
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
    """Return the share of its expected square by which each explanation is left open, shape (c,).

    The share is the probability. In the smallest set of kinds that, with no error, has `SURE` of
    all probability, it is at least the share whose 2 u covers the explanation.
    """
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
    """Return the effect of 1 um of each product at the far corner on every reading, shape (m,
    products); zero without a volume.
    """
    if not layout.volume.solid:
        return np.zeros((len(layout), len(PRODUCTS)))
    share = (layout.position_mm - layout.volume.origin_mm) / layout.volume.length_mm
    columns = [
        layout.direction[:, component] * np.prod(share[:, axes], axis=1)
        for component, axes in PRODUCTS.values()
    ]
    return np.column_stack(columns)


def along_the_way_m(layout: Layout) -> Vector:
    """Return how far each reading lies along its setup's direction from the low corner, in m, shape
    (m,)."""
    along: Vector = 1e-3 * np.sum(
        (layout.position_mm - layout.volume.origin_mm) * layout.direction, axis=1
    )
    return along


def _families(fit: MixedFit, layout: Layout) -> Iterator[Family]:
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
    """Return the effect of a scale of 1 um/m of each setup on every reading, shape (m, setups)."""
    return np.asarray(
        along_the_way_m(layout)[:, None] * (layout.setup_index[:, None] == setups)
    )


def _of_growth(fit: MixedFit, growth_um: Vector) -> float:
    """Return the log-odds of growth in time beyond the usual."""
    if not growth_um.shape[1]:
        return -np.inf
    response = response_of(fit, np.arange(len(growth_um)), growth_um)
    return evidence_of_many(fit, *directions(response.seen, response.shown)) + log_prior(
        GROWN, 1
    )


def _outweighs(probability: float) -> bool:
    return probability > ODDS * (1.0 - probability)
