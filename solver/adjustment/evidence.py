"""Theory of operation: the odds of each possible error of a survey.

The readings are normal for given standard deviations of the random effects, ``y = A x + B a + e``
(`solver.model.design`, `solver.model.effects`). An explanation is an additional pattern h. The
patterns are a wrong stop, a step of the count, a stop or step in each repetition of a pass, the
scale of a setup, and the machine errors `solver.adjustment.explanations.PRODUCTS`. V is the
covariance of the readings including the random effects, and R removes the unknowns x (Baarda 1968):

    shown = h' V^-1 R y
    seen = h' V^-1 R h
    most likely size = shown / seen
    z^2 = shown^2 / seen

The prior standard deviation of the unknown size t is between the uncertainty 1 / sqrt(seen) and
2000 times this uncertainty; each power of two has the same probability. The Bayes factor against
"no error" is the mean over these standard deviations of

    p(y | t) / p(y | 0) = (1 + t^2 seen)^-1/2 exp(1/2 gain(z^2 t^2 seen / (1 + t^2 seen)))

For a known noise, gain(q) = q. The noise is estimated from the same residuals, so gain is the gain
of the profile likelihood (`solver.linear.components.gained`). The factor (1 + t^2 seen)^-1/2
reduces the odds of an explanation with a free size. Explanations with the same pattern have the
same Bayes factor, because sizes are relative to the uncertainty. Irregular drift in a pass (a
wandering pass) and growth in time consist of many patterns with a common standard deviation. The
prior probability of a kind of explanation (`PRIOR`) is divided among the explanations of this kind:

    odds_k = prior_k / (number of its kind) * Bayes factor_k
    p_k = odds_k / (1 + sum of all odds)

The limit is `ODDS` = 20. The most probable wrong stop, step or wandering pass is a contradiction if
its odds are 20 times the odds of no error, of every scale and of every product. The contradiction
is omitted from the fit if its odds are also 20 times those of every other fault
(`solver.adjustment.faults`), and the search is repeated. The explanations that are still probable
at the end form the mixture of the result (`solver.adjustment.explanations`).

The odds are computed from the fit without the explanation; no new fit is needed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.linear.components import gained
from stepdiag.solver.linear.mixed import MixedFit

ODDS = 20.0
"""Odds of 20 to 1 are strong evidence (Kass and Raftery 1995)."""
STOP, STEP, PLACE, WALK, SCALE, PRODUCT, GROWN, TURNED, EXCHANGED = (
    "stop",
    "step",
    "place",
    "walk",
    "scale",
    "product",
    "growth",
    "sign of an angle",
    "other names",
)
PRIOR = {
    GROWN: 0.5,
    **dict.fromkeys((STOP, STEP), 0.3),
    SCALE: 0.2,
    **dict.fromkeys((PRODUCT, PLACE, WALK, TURNED), 0.1),
}
"""Prior probability that a survey has an explanation of each kind. Every second survey begins on a
cold machine. One survey of three has a wrong stop or a step of the count. In one survey of five a
setup has another scale, from its wavelength, air or target. Products as large as the machine's
functions, a place with a local error, a wandering pass, and a head with a wrong sign are less
frequent.

120 surveys had a scale of 0 to 40 um/m in one setup. The number of these surveys with errors beyond
U was 17 with a prior of 0.1 for a scale, 10 with 0.2, and 5 with 0.3. With a prior of 0.3, the
cause of the errors of a warming machine is ambiguous.
"""
PRIOR[EXCHANGED] = PRIOR[SCALE] / ODDS
"""The programs of one survey in a hundred drive other diagonals than planned."""
GROWING = 4.0 ** np.arange(12)
"""Squares of the equally likely standard deviations of a size, relative to the uncertainty by
the readings."""
SURE = 1.0 - 1.0 / ODDS
"""Probability with which U covers an error."""
HIDDEN = 1e-6
"""Smallest share of a pattern that the fit separates from the unknowns."""
DECIMALS = 6
"""Number of decimals of log-odds that are compared; smaller differences are rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """Properties of c patterns h, with the symbols of this module: ``shown`` (c,) = h' V^-1 R y,
    ``seen`` (c, c) = h' V^-1 R h, ``whole`` (c,) = h' W h with the weights W. ``moved`` (count, c)
    is the amount by which each unknown decreases if the fit includes one unit of each pattern."""

    shown: Vector
    seen: Vector
    whole: Vector
    moved: Vector


def response_of(fit: MixedFit, rows: NDArray[np.int64], pattern: Vector) -> Response:
    """Return the values of patterns (k, c) on the rows ``rows`` (k,) of a fit."""
    weighted = fit.weight[rows, None] * pattern
    on_all = np.zeros((len(fit.weight), pattern.shape[1]))
    on_all[rows] = weighted
    right = fit.fixed.packed.transposed_times(on_all)
    taken = fit.inverse.solve(right)
    on_causes = fit.causes.left[rows].T @ pattern
    mixed = fit.root @ on_causes
    seen = pattern.T @ weighted - right.T @ taken - mixed.T @ mixed
    return Response(
        shown=weighted.T @ fit.residual[rows],
        seen=0.5 * (seen + seen.T),
        whole=np.sum(weighted * pattern, axis=0),
        moved=taken - fit.causes.taken @ (fit.amount_covariance @ on_causes),
    )


class Evidence(NamedTuple):
    """``log_odds`` (c,) is the logarithm of the odds; ``square`` (c,) is the expected square of
    the size if the explanation is true."""

    log_odds: Vector
    square: Vector


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Family:
    """Explanations of one kind on the readings ``rows`` (k,), each with one pattern. ``pattern``
    returns the patterns of the explanations with the given indices (p,), shape (k, p).

    ``shown`` and ``seen`` (c,) are the symbols of this module; ``seen`` is 0 for a pattern that the
    fit cannot separate from its unknowns. ``named`` (c,) is the number of the reading, setup or
    product that an explanation concerns. ``most`` is the largest possible size.
    """

    kind: str
    rows: NDArray[np.int64]
    named: NDArray[np.int64]
    shown: Vector
    seen: Vector
    pattern: Callable[[NDArray[np.int64]], Vector]
    most: float = np.inf

    @property
    def size(self) -> Vector:
        """Return the most likely size of each explanation, shape (c,), or 0 if the readings do
        not depend on it."""
        found: Vector = np.where(
            self.seen > 0, self.shown / np.where(self.seen > 0, self.seen, 1.0), 0.0
        )
        return found

    def weighed(self, fit: MixedFit, many: int) -> Evidence:
        """Return the evidence of each explanation; ``many`` is the number of explanations of its
        kind."""
        found = evidence_of(fit, self.shown, self.seen, self.most)
        return Evidence(
            found.log_odds + log_prior(self.kind, many),
            np.minimum(found.square, self.most**2),
        )


def log_prior(kind: str, many: int) -> float:
    """Return the logarithm of the prior odds of one of ``many`` explanations of a kind."""
    return float(np.log(PRIOR[kind] / max(many, 1)))


def visible(seen: Vector, whole: Vector) -> Vector:
    """Return ``seen``, set to 0 where it is less than `HIDDEN` times ``whole``, shapes (c,)."""
    return np.where(seen > HIDDEN * np.maximum(whole, np.finfo(np.float64).tiny), seen, 0.0)


def evidence_of(fit: MixedFit, shown: Vector, seen: Vector, most: float = np.inf) -> Evidence:
    """Return the evidence of explanations against "no error", from their ``shown`` and ``seen``
    (c,); no size is larger than ``most``. A pattern that the readings do not show has no
    evidence and the size 0."""
    some = seen > 0
    safe = np.where(some, seen, 1.0)
    best = shown**2 / safe
    share = (GROWING / (1.0 + GROWING))[:, None]
    likely = 0.5 * (gained(fit, fit.chi_square - best * share) - np.log1p(GROWING)[:, None])
    log_odds, weight = _mean(np.where(GROWING[:, None] <= most**2 * safe, likely, -np.inf))
    # for each standard deviation of the prior, the size and its variance shrink towards zero
    square = np.sum(weight * (best * share**2 + share), axis=0) / safe
    return Evidence(np.where(some, log_odds, -np.inf), np.where(some, square, 0.0))


def evidence_of_many(fit: MixedFit, shown: Vector, seen: Vector) -> float:
    """Return the logarithm of the Bayes factor of one explanation with many independent patterns
    (k,) of a common standard deviation."""
    if not len(seen):
        return -np.inf
    grown = GROWING[:, None] / np.max(seen) * seen
    left = fit.chi_square - np.sum(shown**2 / seen * grown / (1.0 + grown), axis=1)
    return float(
        _mean(0.5 * (gained(fit, left) - np.sum(np.log1p(grown), axis=1))[:, None])[0].item()
    )


def directions(seen: Vector, shown: Vector) -> tuple[Vector, Vector]:
    """Return ``shown`` and ``seen`` of the independent directions of some patterns, shapes (k,)."""
    value, turn = np.linalg.eigh(seen)
    clear = value > HIDDEN * max(float(value[-1]), np.finfo(np.float64).tiny)
    return turn.T[clear] @ shown, value[clear]


def standing_out(freedom: int, prior: float, most: float) -> float:
    """Return the number of standard uncertainties at which one pattern has the odds `ODDS`, at most
    ``most``. ``prior`` is the logarithm of its prior probability.

    With few degrees of freedom the pattern is a large part of the square sum from which the noise
    is estimated.
    """
    size = np.linspace(1.0, most, 10 * int(most))
    left = 1.0 - size**2 / (freedom + size**2) * (GROWING / (1.0 + GROWING))[:, None]
    odds, _ = _mean(-0.5 * (freedom * np.log(left) + np.log1p(GROWING)[:, None]))
    return float(np.interp(np.log(ODDS), odds + prior, size))


def _mean(likely: Vector) -> tuple[Vector, Vector]:
    most = np.max(likely, axis=0)
    weight = np.exp(likely - most)
    total = np.sum(weight, axis=0)
    return most + np.log(total / len(likely)), weight / total
