"""Theory of operation: what is wrong with all of a survey, decided by one number.

A stop, a step or a pass that is wrong shows in its own residuals (`solver.adjustment.robustness`). What this module decides shows nowhere
by itself: a setup of another scale, a machine with errors that no function of one axis describes (`PRODUCTS`: products of the shares of
two axes in one component, and y^2 z in Z, a ram that sags), and a machine that grew by more than is usual. One length compares the seven
setups of a usual survey, so most of these explain one pattern alike.

The model. Readings are normal given the sizes of all causes, ``y = A x + B a + e`` (`solver.model.design`, `solver.model.effects`). An
explanation is one more pattern h. What the fit leaves of it says all about it (Baarda 1968; V is the covariance of the readings with all
causes in it, R removes the unknowns x):

    shown = h' V^-1 R y,     seen = h' V^-1 R h,     most likely size = shown / seen,     z^2 = shown^2 / seen

Its size t is not known: its standard deviation is anything from the uncertainty 1 / sqrt(seen) up to 2000 times that, and at most what
such an error ever is (`MOST_UM`, `MOST_UM_M`); each power of two is as likely. The Bayes factor against nothing is the mean over these of

    p(y | t) / p(y | 0) = (1 + t^2 seen)^-1/2 exp(1/2 gain(z^2 t^2 seen / (1 + t^2 seen)))

With the noise known, gain(q) = q; it is known from the same residuals, so gain is that of the profile likelihood
(`solver.linear.components.gained`). The first factor is Occam's: a cause of any size explains less. Sizes are relative to what the
readings show, so no usual size chooses between two explanations of one pattern: these have one z, and one number. Growth is many patterns
of one size; so is a pass that wanders. A stop, a step or a walk of one count competes, too: a product must not explain what may be
theirs. Odds are the factor times the prior of the kind (`PRIOR`), shared by all of the kind; growth and scales of all setups are in V no
larger than usual, as they explain the same length.

Decisions. `ODDS` = 20 decides all of them.

- A kind that has less than one in `ODDS` of the odds of the best, nothing among them, is not in the mixture; of a kind no explanation is
  that has so little of the odds of its best. In a good survey nothing is left open, and its result is that of the plain adjustment.
- A cause has a name where it has `ODDS` times the probability of all others together.
- Where setups and products are more probable than not and nothing has a name, all candidates are named (`solver.methods.doubt`). What is
  refused is decided by the lengths (`solver.adjustment.diagnostics.scale_findings`).

The mixture is the result. Each explanation is left open by a share of its expected square E[t^2 | k, y]: estimate, budget, posterior and
predictions use the same causes. The normal distribution with the mixture's moments has the share p_k, its probability. Where k is true the
mixture is off by t (1 - p), and 2 u reaches that with (1 - p)^2 / 4p of p t^2. So every explanation of the smallest set of kinds that, with
nothing, holds `SURE` of all has the share

    max(p_k, (1 - p_k) / 4)

Products are no function of one axis: they stand in the posterior as numbers of their own, in no table.

What it costs: one product of the patterns with the inverse that is there, no further fit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Message, message
from stepdiag.base.result.field import PRODUCTS
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.counts import Count
from stepdiag.solver.adjustment.hypotheses import HIDDEN, STEP, STOP, along_the_way_m, families, tell
from stepdiag.solver.linear.components import gained
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.model.effects import BESIDE, ONE_SCALE, ONE_WALK, Effect
from stepdiag.solver.model.layout import Layout

ODDS = 20.0
"""Twenty to one is strong evidence (Kass and Raftery 1995)."""
SCALE, PRODUCT, GROWN, WALK = "scale", "product", "growth", "walk"
PRIOR = {SCALE: 0.1, PRODUCT: 0.1, GROWN: 0.5, STOP: 0.3, STEP: 0.3, WALK: 0.1}
"""How likely it is that a survey has one of a kind, whichever: every second survey begins on a machine that is not warm; a wavelength, an
air or a target of its own for one setup is rarer, as is a machine of which products are as large as its functions; shops repeat a pass in
one survey of three."""
SURE = 0.95
"""What U promises."""
MOST_UM, MOST_UM_M = 50.0, 200.0
"""Larger products or scales do not occur; one that the readings show only beyond this is not looked for."""
GROWING = 4.0 ** np.arange(12)
"""Squares of sizes over the uncertainty of the readings, all as likely: from once to 2000 times the uncertainty."""
DECIMALS = 6
"""Beyond these, which of two explanations has more evidence is chance."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explained:
    """What explains a survey beside the model: scales of single setups, products of two axes, growth.

    ``named`` (c,) are setups and places in `PRODUCTS` in the order of ``kinds`` (c,), ``size`` (c,) how large each would be alone, in um/m
    or in um at the far end, ``share`` (c,) how probable it is, and ``spread`` (c,) the size by which it is left open. ``growth``: how
    probable more growth than usual is, ``nothing``: that all is as usual. ``walk_um`` (m, k) are steps of
    passes that may wander, as large as they are left open.
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
        """Tell whether growth beyond the usual is what happened, and no setup of another scale."""
        return self.growth > ODDS * self.of_kind(SCALE)

    @property
    def unnamed(self) -> bool:
        """Tell whether setups and products are more probable than not, and nothing has a name."""
        return float(np.sum(self.share)) > 0.5 and not self.names

    @property
    def names(self) -> list[int]:
        """Return the places of the explanations that have a name: one setup, or the products that stay probable."""
        products, scales = self.probable(PRODUCT), self.probable(SCALE)
        if _outweighs(self.of_kind(PRODUCT)):
            return products
        return scales[:1] if scales and _outweighs(float(self.share[scales[0]])) else []

    def of(self, kind: str) -> NDArray[np.int64]:
        """Return the places of a kind."""
        return np.flatnonzero(np.array(self.kinds) == kind)

    def of_kind(self, kind: str) -> float:
        """Return how probable a kind is."""
        return float(np.sum(self.share[self.of(kind)]))

    def probable(self, kind: str) -> list[int]:
        """Return the places of the explanations of a kind that stay probable, the best first."""
        mine = self.of(kind)
        kept = mine[self.share[mine] > 0.0]
        return [int(place) for place in kept[np.argsort(-np.round(self.share[kept], DECIMALS), kind="stable")]]


def explained(fit: MixedFit, layout: Layout, growth_um: Vector, every: Sequence[Count]) -> Explained:
    """Return the mixture of what explains a survey; ``growth_um`` (m, k) is what growth does, of which there may be more.

    A stop, a step or a walk on ``every`` count of the readings competes for the probability. Stops and steps are repaired elsewhere; a walk
    is left open as well, or a product would take what may be the walk's.
    """
    nothing = np.zeros(0)
    kinds, named, size, odds, square = [], [nothing.astype(np.int64)], [nothing], [nothing], [nothing]
    for family in _families(fit, layout):
        found = evidence_of(fit, family.shown, family.seen, family.most)
        kinds += [family.kind] * len(family.seen)
        named.append(family.named)
        size.append(np.where(family.seen > 0, family.shown / np.where(family.seen > 0, family.seen, 1.0), 0.0))
        odds.append(found.log_odds + np.log(PRIOR[family.kind] / len(family.seen)))
        square.append(np.minimum(found.square, family.most**2))
    faults = list(_of_counts(fit, every))
    of_faults = [log_odds for _, log_odds in faults]
    every_kind = np.array([*kinds, *(kind for kind, log_odds in faults for _ in log_odds), GROWN])
    share = shares(np.concatenate([*odds, *of_faults, [_of_growth(fit, growth_um)]]), every_kind)
    reached = reaching(share, every_kind)
    walking = reached[np.equal(every_kind, WALK)].tolist()
    walks = [_walk_um(fit, layout, count, part) for count, part in zip(every, walking, strict=True) if part > 0.0]
    return Explained(
        kinds=tuple(kinds),
        named=np.concatenate(named),
        size=np.concatenate(size),
        share=share[: len(kinds)],
        spread=np.sqrt(reached[: len(kinds)] * np.concatenate(square)),
        growth=float(share[-1]),
        nothing=1.0 - float(np.sum(share)),
        walk_um=np.hstack([np.zeros((len(layout), 0)), *walks]),
    )


def name_explained(layout: Layout, found: Explained) -> list[Finding]:
    """Return the finding on what has a name."""
    products = [_product(found, at) for at in found.names if found.kinds[at] == PRODUCT]
    if products:
        return [finding("warning", message("machine-beside-model", suspects=products))]
    scales = [(layout.setups[found.named[at]].name, float(found.size[at])) for at in found.names]
    return [finding("warning", message("setup-scale-off", setup=name, scale_um_m=size)) for name, size in scales]


def suspect(layout: Layout, found: Explained, at: int) -> Message:
    """Return the words for one explanation of several."""
    if found.kinds[at] == PRODUCT:
        return _product(found, at)
    return message("suspect-scale", setup=layout.setups[found.named[at]].name, scale_um_m=float(found.size[at]))


def effects_beside(layout: Layout, found: Explained) -> list[Effect]:
    """Return what the adjustment leaves open beside the model: each explanation with its spread, none where no kind is in the mixture."""
    scales, products = found.of(SCALE), found.of(PRODUCT)
    of_scales = _of_setups(layout, found.named[scales])
    opened = (
        (ONE_SCALE, message("open-scale"), of_scales * found.spread[scales]),
        (ONE_WALK, message("open-walk"), found.walk_um),
        (BESIDE, message("open-products"), products_um(layout)[:, found.named[products]] * found.spread[products]),
    )
    return [Effect(name=name, text=text, pattern_um=pattern) for name, text, pattern in opened if np.any(pattern)]


class Evidence(NamedTuple):
    """``log_odds`` (c,): logarithm of the Bayes factor; ``square`` (c,): the expected square of the size where the explanation is true."""

    log_odds: Vector
    square: Vector


def evidence_of(fit: MixedFit, shown: Vector, seen: Vector, most: float) -> Evidence:
    """Return the evidence of explanations of one pattern each, by what a fit shows and sees of it, shapes (c,); no size exceeds ``most``.

    What the readings do not see has no evidence, and no size.
    """
    some = seen > 0
    safe = np.where(some, seen, 1.0)
    best = shown**2 / safe
    share = (GROWING / (1.0 + GROWING))[:, None]
    likely = 0.5 * (gained(fit, fit.chi_square - best * share) - np.log1p(GROWING)[:, None])
    log_odds, weight = _mean(np.where(GROWING[:, None] <= most**2 * safe, likely, -np.inf))
    # given each width the size is normal about its most likely value, both drawn towards nothing
    square = np.sum(weight * (best * share**2 + share), axis=0) / safe
    return Evidence(np.where(some, log_odds, -np.inf), np.where(some, square, 0.0))


def evidence_of_many(fit: MixedFit, shown: Vector, seen: Vector) -> float:
    """Return the evidence (logarithm) of one explanation of many independent patterns of one size, shapes (k,)."""
    grown = GROWING[:, None] / np.max(seen) * seen
    left = fit.chi_square - np.sum(shown**2 / seen * grown / (1.0 + grown), axis=1)
    return float(_mean(0.5 * (gained(fit, left) - np.sum(np.log1p(grown), axis=1))[:, None])[0].item())


def shares(odds: Vector, kinds: NDArray[np.str_]) -> Vector:
    """Return how probable each explanation is, shape (c,), by their odds against nothing (logarithms); what is left of one is nothing's.

    A kind that has less than one in `ODDS` of the best is not in the mixture: explanations of one pattern stand or fall together.
    """
    best = max(float(np.max(odds)), 0.0)
    weight, none = np.exp(odds - best), float(np.exp(-best))
    own = kinds[:, None] == kinds
    of_kind, most = own @ weight, np.max(np.where(own, weight, 0.0), axis=1)
    least = max(float(np.max(of_kind)), none) / ODDS
    kept = np.where((of_kind > least) & (weight * ODDS > most), weight, 0.0)
    found: Vector = kept / (np.sum(kept) + (none if none > least else 0.0))
    return found


def reaching(share: Vector, kinds: NDArray[np.str_]) -> Vector:
    """Return the share of its expected square by which each explanation is left open, shape (c,).

    It is the probability, and in the smallest set of kinds that with nothing holds `SURE` of all as much as 2 u needs to reach over it.
    """
    held, inside = 1.0 - float(np.sum(share)), []
    of_kind = {str(kind): float(np.sum(share[kinds == kind])) for kind in np.unique(kinds)}
    for kind, part in sorted(of_kind.items(), key=lambda one: -one[1]):
        if held < SURE:
            inside.append(kind)
            held += part
    reached: Vector = np.where((share > 0.0) & np.isin(kinds, inside), np.maximum(share, (1.0 - share) / 4.0), share)
    return reached


def products_um(layout: Layout) -> Vector:
    """Return what 1 um of each product at the far corner does to every reading, shape (m, products); zero without a volume."""
    if not layout.volume.solid:
        return np.zeros((len(layout), len(PRODUCTS)))
    share = (layout.position_mm - layout.volume.origin_mm) / layout.volume.length_mm
    columns = [layout.direction[:, component] * np.prod(share[:, axes], axis=1) for component, axes in PRODUCTS.values()]
    return np.column_stack(columns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Family:
    """Explanations of one kind: what a fit shows and sees of each (c,), 0 where it does not tell it from its unknowns, the setup or
    product that each is named after (c,), and the most that it ever is."""

    kind: str
    named: NDArray[np.int64]
    shown: Vector
    seen: Vector
    most: float


def _families(fit: MixedFit, layout: Layout) -> Iterator[_Family]:
    used = np.flatnonzero(fit.weight[: len(layout)] > 0)
    setups = np.unique(layout.setup_index[used])
    if len(setups) > 1:
        yield _family(fit, used, _of_setups(layout, setups)[used], kind=SCALE, named=setups, most=MOST_UM_M)
    if layout.volume.solid:
        yield _family(fit, used, products_um(layout)[used], kind=PRODUCT, named=np.arange(len(PRODUCTS)), most=MOST_UM)


def _family(fit: MixedFit, rows: NDArray[np.int64], pattern: Vector, *, kind: str, named: NDArray[np.int64], most: float) -> _Family:
    pattern_fit = tell(fit, rows, pattern)
    seen = np.diag(pattern_fit.seen)
    visible = seen > np.maximum(HIDDEN * pattern_fit.whole, most**-2.0)
    return _Family(kind=kind, named=named, shown=pattern_fit.shown, seen=np.where(visible, seen, 0.0), most=most)


def _of_setups(layout: Layout, setups: NDArray[np.int64]) -> Vector:
    """Return what a scale of 1 um/m of each setup does to every reading, shape (m, setups)."""
    return np.asarray(along_the_way_m(layout)[:, None] * (layout.setup_index[:, None] == setups))


def _of_counts(fit: MixedFit, every: Sequence[Count]) -> Iterator[tuple[str, Vector]]:
    """Return the odds (logarithms) of every stop, step and walk."""
    found: dict[str, list[Vector]] = {STOP: [], STEP: [], WALK: []}
    for family in families(fit, every):
        visible = np.where(family.seen > HIDDEN * np.maximum(family.whole, np.finfo(np.float64).tiny), family.seen, 0.0)
        found[family.kind].append(evidence_of(fit, family.shown, visible, np.inf).log_odds)
    for count in every:
        shown, seen = _steps(fit, count)
        found[WALK].append(np.full(1, evidence_of_many(fit, shown, seen) if len(seen) else -np.inf))
    for kind, log_odds in found.items():
        many = sum(len(each) for each in log_odds)
        yield kind, np.concatenate([np.zeros(0), *log_odds]) + float(np.log(PRIOR[kind] / max(many, 1)))


def _steps(fit: MixedFit, count: Count) -> tuple[Vector, Vector]:
    """Return what is shown and seen of a walk in independent directions, shapes (k,)."""
    mixed = fit.root @ (fit.causes.left[count.rows].T @ count.walk)
    value, turn = np.linalg.eigh(count.walked - mixed.T @ mixed)
    clear = value > HIDDEN * max(float(value[-1]), np.finfo(np.float64).tiny)
    return turn.T[clear] @ (count.walk.T @ (fit.weight[count.rows] * fit.residual[count.rows])), value[clear]


def _walk_um(fit: MixedFit, layout: Layout, count: Count, part: float) -> Vector:
    """Return the steps of a walk, as large as what is shown of them, by a part of their square, shape (m, k)."""
    shown, seen = _steps(fit, count)
    square = max(float(np.sum(shown**2 / seen)) - len(seen), 1.0) / float(np.sum(seen))
    whole = np.zeros((len(layout), count.walk.shape[1]))
    whole[count.rows] = np.sqrt(part * square) * count.walk
    return whole


def _of_growth(fit: MixedFit, growth_um: Vector) -> float:
    """Return the odds (logarithm) of more growth in time than is usual."""
    if not growth_um.shape[1]:
        return -np.inf
    pattern_fit = tell(fit, np.arange(len(growth_um)), growth_um)
    seen, turn = np.linalg.eigh(pattern_fit.seen)
    clear = seen > HIDDEN * seen[-1]
    return evidence_of_many(fit, turn.T[clear] @ pattern_fit.shown, seen[clear]) + float(np.log(PRIOR[GROWN]))


def _mean(likely: Vector) -> tuple[Vector, Vector]:
    """Return the logarithm of the mean over the sizes (rows), and the share of each in it."""
    most = np.max(likely, axis=0)
    weight = np.exp(likely - most)
    total = np.sum(weight, axis=0)
    return most + np.log(total / len(likely)), weight / total


def _outweighs(probability: float) -> bool:
    return probability > ODDS * (1.0 - probability)


def _product(found: Explained, at: int) -> Message:
    return message("suspect-product", product=tuple(PRODUCTS)[found.named[at]], size_um=float(found.size[at]))
