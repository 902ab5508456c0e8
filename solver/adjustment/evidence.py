"""Theory of operation: one number decides about errors of a survey.

The model. Readings are normal given the sizes of all causes, ``y = A x + B a + e``
(`solver.model.design`, `solver.model.effects`). An explanation is a further pattern h: a stop, a
step of the count, either of them in each drive of a setup, the scale of a setup, a product of two
axes in a component of the machine's errors (and y^2 z in Z, a ram that sags). Its residue in the
fit decides everything (Baarda 1968; V is the covariance of the readings with all causes in it, R
removes the unknowns x):

    shown = h' V^-1 R y
    seen = h' V^-1 R h
    most likely size = shown / seen
    z^2 = shown^2 / seen

Its size t is unknown: its standard deviation is anything from the uncertainty 1 / sqrt(seen) up to
2000 times this; each power of two is as likely. The Bayes factor against nothing is the mean over
these of

    p(y | t) / p(y | 0) = (1 + t^2 seen)^-1/2 exp(1/2 gain(z^2 t^2 seen / (1 + t^2 seen)))

For a known noise, gain(q) = q; the noise is known from the same residuals, so gain is the gain of
the profile likelihood (`solver.linear.components.gained`). The first factor is Occam's: a cause of
any size explains less. Sizes are relative to the readings, so no usual size chooses between two
explanations of a pattern: these have the same z, and the same number. A pass that wanders consists
of many patterns with a common size, and so does growth in time. Odds are the factor times the prior
of the kind (`PRIOR`), divided among the explanations of the kind:

    odds_k = prior_k / (number of its kind) * Bayes factor_k
    p_k = odds_k / (1 + sum of all odds)

The limit `ODDS` = 20 decides in each case. If the best stop, step or pass has twenty times the odds
of no fault, of every scale and of every product, it is named if it also has twenty times the odds
of every other, and is left out (`solver.adjustment.faults`); then the search is repeated. The
explanations that remain probable after the repair form the mixture of the result
(`solver.adjustment.explanations`).

The cost is products of the patterns with the existing inverse, and no further fit for a rejected
explanation.
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
"""Twenty to one is strong evidence (Kass and Raftery 1995)."""
STOP, STEP, PLACE, WALK, SCALE, PRODUCT, GROWN, TURNED, EXCHANGED = (
    "stop",
    "step",
    "place",
    "walk",
    "scale",
    "product",
    "growth",
    "sign of an angle",
    "exchanged names",
)
PRIOR = {
    GROWN: 0.5,
    **dict.fromkeys((STOP, STEP), 0.3),
    SCALE: 0.2,
    **dict.fromkeys((PRODUCT, PLACE, WALK, TURNED), 0.1),
}
"""Prior probability that a survey has an explanation of a kind. Every second survey begins on a
cold machine. Shops repeat a pass in one survey of three. In one survey of five a setup differs from
the others in wavelength, air or target. Rarer are a machine with products as large as its
functions, a place where it leaves them, a pass that wanders and a head with the other sign. Of 120
surveys with a setup 0 to 40 um/m off, 17 left more than was promised with 0.1 for a scale, 10 with
0.2 and 5 with 0.3, which calls a machine that warms ambiguous.
"""
PRIOR[EXCHANGED] = PRIOR[SCALE] / ODDS
"""In one survey of a hundred two names are exchanged: a setup is twenty times as often of another
scale."""
GROWING = 4.0 ** np.arange(12)
"""Squares of sizes over the uncertainty of the readings, all as likely: from once to 2000 times the
uncertainty."""
SURE = 1.0 - 1.0 / ODDS
"""Probability promised by U: the same odds against a value beyond it."""
HIDDEN = 1e-6
"""Smallest share of a pattern that the fit must leave in the residuals; below it the pattern cannot
be separated from the unknowns, and a pattern that moves the volume by less is rounding.
"""
DECIMALS = 6
"""Log-odds beyond which the order of two explanations is chance."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """Of c patterns h, in the symbols of the theory above: ``shown`` (c,) = h' V^-1 R y, ``seen``
    (c, c) = h' V^-1 R h, ``whole`` (c,) = h' W h with the weights W of the readings, without any
    unknowns or causes, and ``moved`` (count, c) the decrease of the unknowns for one unit of each
    pattern.
    """

    shown: Vector
    seen: Vector
    whole: Vector
    moved: Vector


def response_of(fit: MixedFit, rows: NDArray[np.int64], pattern: Vector) -> Response:
    """Return the response of a fit to patterns (k, c) on some of its rows (k,); they are zero on
    all others.
    """
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
    """``log_odds`` (c,): logarithm of the odds; ``square`` (c,): the expected square of the size
    where the explanation is true."""

    log_odds: Vector
    square: Vector


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Family:
    """Explanations of a kind with a pattern each: c patterns on ``rows`` (k,), ``pattern`` gives
    the patterns of some places, shape (k, p).

    ``shown`` and ``seen`` (c,) as in `Response`, ``seen`` 0 for a pattern that the fit cannot
    separate from its unknowns. ``named`` (c,) are the readings, the setup or the product of each
    name; ``most`` is the largest size.
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
        """Return the most likely size of each explanation taken alone, shape (c,); 0 where the
        readings do not depend on it.
        """
        found: Vector = np.where(
            self.seen > 0, self.shown / np.where(self.seen > 0, self.seen, 1.0), 0.0
        )
        return found

    def weighed(self, fit: MixedFit, many: int) -> Evidence:
        """Return the evidence for each of ``many`` explanations of its kind."""
        found = evidence_of(fit, self.shown, self.seen, self.most)
        return Evidence(
            found.log_odds + log_prior(self.kind, many),
            np.minimum(found.square, self.most**2),
        )


def log_prior(kind: str, many: int) -> float:
    """Return the logarithm of the odds of one of ``many`` explanations of a kind before any
    reading."""
    return float(np.log(PRIOR[kind] / max(many, 1)))


def visible(seen: Vector, whole: Vector) -> Vector:
    """Return the seen part of each pattern, set to 0 where it is negligible relative to the
    ``whole``, shapes (c,).
    """
    return np.where(seen > HIDDEN * np.maximum(whole, np.finfo(np.float64).tiny), seen, 0.0)


def evidence_of(fit: MixedFit, shown: Vector, seen: Vector, most: float = np.inf) -> Evidence:
    """Return the evidence of explanations relative to "no fault". Each explanation is one pattern
    with its ``shown`` and ``seen`` parts in a fit (see the module), shapes (c,).

    An unseen pattern has no evidence, and no size; no size exceeds ``most``.
    """
    some = seen > 0
    safe = np.where(some, seen, 1.0)
    best = shown**2 / safe
    share = (GROWING / (1.0 + GROWING))[:, None]
    likely = 0.5 * (gained(fit, fit.chi_square - best * share) - np.log1p(GROWING)[:, None])
    log_odds, weight = _mean(np.where(GROWING[:, None] <= most**2 * safe, likely, -np.inf))
    # for a given width the size is normal about its most likely value; both are shrunk towards zero
    square = np.sum(weight * (best * share**2 + share), axis=0) / safe
    return Evidence(np.where(some, log_odds, -np.inf), np.where(some, square, 0.0))


def evidence_of_many(fit: MixedFit, shown: Vector, seen: Vector) -> float:
    """Return the evidence (logarithm) of an explanation of many independent patterns of a common
    size, shapes (k,).
    """
    if not len(seen):
        return -np.inf
    grown = GROWING[:, None] / np.max(seen) * seen
    left = fit.chi_square - np.sum(shown**2 / seen * grown / (1.0 + grown), axis=1)
    return float(
        _mean(0.5 * (gained(fit, left) - np.sum(np.log1p(grown), axis=1))[:, None])[0].item()
    )


def directions(seen: Vector, shown: Vector) -> tuple[Vector, Vector]:
    """Return the shown and seen parts of patterns in the independent directions of the fit, shapes
    (k,).
    """
    value, turn = np.linalg.eigh(seen)
    clear = value > HIDDEN * max(float(value[-1]), np.finfo(np.float64).tiny)
    return turn.T[clear] @ shown, value[clear]


def standing_out(freedom: int, prior: float, most: float) -> float:
    """Return the number of standard uncertainties at which one pattern has `ODDS` against chance,
    at most ``most``.

    With few degrees of freedom the pattern makes up most of the square sum from which the noise is
    estimated. ``prior`` is a logarithm.
    """
    size = np.linspace(1.0, most, 10 * int(most))
    left = 1.0 - size**2 / (freedom + size**2) * (GROWING / (1.0 + GROWING))[:, None]
    odds, _ = _mean(-0.5 * (freedom * np.log(left) + np.log1p(GROWING)[:, None]))
    return float(np.interp(np.log(ODDS), odds + prior, size))


def _mean(likely: Vector) -> tuple[Vector, Vector]:
    """Return the logarithm of the mean over the sizes (rows), and the share of each in the mean."""
    most = np.max(likely, axis=0)
    weight = np.exp(likely - most)
    total = np.sum(weight, axis=0)
    return most + np.log(total / len(likely)), weight / total
