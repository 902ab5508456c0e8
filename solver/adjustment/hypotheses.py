"""What may be wrong with a survey beside noise, each as one more unknown: a stop, a step of the count.

A hypothesis is a pattern on the readings. How large it would be, and how sure that is, follows from the fit that is there, without a
new one (Baarda 1968, one further unknown at a time): ``size = (h' W r) / (h' W R h)`` with R what the fit leaves of a pattern.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.counts import Count, from_each_on, steps_of
from stepdiag.solver.linear.components import gained
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.model.layout import Layout

HIDDEN = 1e-6
"""A pattern of which the fit leaves less than this share is not separated from what is unknown already."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """Of c patterns: ``shown`` (c,) = h' W r, ``seen`` (c, c) = h' W R h, ``whole`` (c,) what would be seen if nothing were unknown, and
    by how much the unknowns fall for one unit of each, ``moved`` (count, c)."""

    shown: Vector
    seen: Vector
    whole: Vector
    moved: Vector


def tell(fit: MixedFit, rows: NDArray[np.int64], pattern: Vector) -> Response:
    """Return what a fit says about patterns (k, c) on some of its rows (k,); they are zero on all others."""
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Family:
    """Hypotheses of one kind that are tested together: c patterns on ``rows`` (k,), ``pattern`` gives those of some places, shape (k, p).

    ``shown``, ``seen`` and ``whole`` (c,) as in `Response`. ``named`` (c,) are the readings, or for a scale the setup, that each is
    named after. ``critical``: the square of size over uncertainty that is no chance; ``least``: a size below which it is left alone;
    ``usual``: its usual size where it happens, ``free``: more than it ever is.
    """

    kind: str
    rows: NDArray[np.int64]
    named: NDArray[np.int64]
    shown: Vector
    seen: Vector
    whole: Vector
    pattern: Callable[[NDArray[np.int64]], Vector]
    critical: float
    least: float
    usual: float = np.inf
    free: float = 1e3

    @property
    def size(self) -> Vector:
        """Return how large each is by itself, shape (c,); 0 where the fit does not tell it from its unknowns."""
        visible = self.seen > HIDDEN * np.maximum(self.whole, np.finfo(np.float64).tiny)
        found: Vector = np.where(visible, self.shown / np.where(visible, self.seen, np.nan), 0.0)
        return found


STOP, STEP = "stop", "step"
CRITICAL = 5.0**2
"""Of a thousand stops one in 1700 surveys; the noise by which it is judged is known to a fifth."""
LEAST_UM = 0.5
"""Contradictions below this are not called wrong stops however small the noise."""


def families(fit: MixedFit, every: Sequence[Count]) -> Iterator[Family]:
    """Return every hypothesis of one unknown about ``every`` count of the readings that are used."""
    for count in every:
        yield from _on_count(fit, count)


def along_the_way_m(layout: Layout) -> Vector:
    """Return how far each reading lies along its setup's direction from the low corner, in m, shape (m,)."""
    along: Vector = 1e-3 * np.sum((layout.position_mm - layout.volume.origin_mm) * layout.direction, axis=1)
    return along


def _on_count(fit: MixedFit, count: Count) -> Iterator[Family]:
    """Return the wrong stops and the steps of a count."""
    rows, number = count.rows, len(count.rows)
    weight = fit.weight[rows]
    shown = weight * fit.residual[rows]
    mixed = fit.taken_over[rows]
    yield Family(
        kind=STOP,
        rows=rows,
        named=rows,
        shown=shown,
        seen=count.stop - np.sum(mixed**2, axis=1),
        whole=weight,
        pattern=lambda places: (np.arange(number)[:, None] == places).astype(np.float64),
        critical=CRITICAL,
        least=LEAST_UM,
    )
    # a step before the second reading or the last is a wrong first or last one
    inner = slice(2, -1)
    yield Family(
        kind=STEP,
        rows=rows,
        named=rows[inner],
        shown=from_each_on(shown)[inner],
        seen=(count.step - np.sum(from_each_on(mixed) ** 2, axis=1))[inner],
        whole=from_each_on(weight)[inner],
        pattern=lambda places: steps_of(number, places + 2),
        critical=CRITICAL,
        least=LEAST_UM,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """One hypothesis with its ``pattern`` (k,) on ``rows`` (k,): ``size``, square of it over its uncertainty (``statistic``), what it is
    named after, and what the unknowns are (count,) if it is true.

    ``unusual``: by how much its size is less likely than none, twice the logarithm. It happens with the tails of Cauchy's distribution:
    by the normal one, 100 um/m would prove that it was the other setup, of which 50 um/m explain the same.
    """

    kind: str
    named: int
    rows: NDArray[np.int64]
    pattern: Vector
    size: float
    statistic: float
    critical: float
    unusual: float
    free: float
    without: Vector

    def on(self, count: int) -> Vector:
        """Return the pattern on all readings, shape (count,)."""
        whole = np.zeros(count)
        whole[self.rows] = self.pattern
        return whole


MOST_SHOWN = 200
LIKELIHOOD_DECIMALS = 6
"""Beyond these, which of two explanations is likelier is chance."""


def shown(fit: MixedFit, every: Sequence[Family], least: float) -> list[Hypothesis]:
    """Return the hypotheses by which the likelihood gains more than ``least``, those by which it gains most first.

    All but the `MOST_SHOWN` best are left out.
    """
    ranked = []
    for number, family in enumerate(every):
        size = family.size
        statistic = gained(fit, fit.chi_square - size * family.shown)
        places = np.flatnonzero((statistic > least) & (np.abs(size) >= family.least))
        ranked += [(float(statistic[place]), number, int(place)) for place in places]
    # what explains as much stands in the order of the readings, not in that of rounding
    ranked.sort(key=lambda one: -round(one[0], LIKELIHOOD_DECIMALS))
    return _hypotheses(fit, [(every[number], place, statistic) for statistic, number, place in ranked[:MOST_SHOWN]])


def _hypotheses(fit: MixedFit, found: Sequence[tuple[Family, int, float]]) -> list[Hypothesis]:
    """Return hypotheses by family and place in it, with what each makes of the unknowns."""
    patterns = [family.pattern(np.array([place]))[:, 0] for family, place, _ in found]
    on_all = np.zeros((len(fit.weight), len(found)))
    for column, ((family, _, _), pattern) in enumerate(zip(found, patterns, strict=True)):
        on_all[family.rows, column] = pattern
    moved = tell(fit, np.arange(len(fit.weight)), on_all).moved if found else on_all
    return [
        Hypothesis(
            kind=family.kind,
            named=int(family.named[place]),
            rows=family.rows,
            pattern=patterns[column],
            size=float(family.size[place]),
            statistic=statistic,
            critical=family.critical,
            unusual=2.0 * float(np.log1p((family.size[place] / family.usual) ** 2)),
            free=family.free,
            without=fit.unknowns - family.size[place] * moved[:, column],
        )
        for column, (family, place, statistic) in enumerate(found)
    ]
