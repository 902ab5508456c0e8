"""What may be wrong with a survey beside noise, each as one more unknown: a stop, a step of the count, the scale of a setup, warming.

A hypothesis is a pattern on the readings. How large it would be, and how sure that is, follows from the fit that is there, without a
new one (Baarda 1968, one further unknown at a time): ``size = (h' W r) / (h' W R h)`` with R what the fit leaves of a pattern.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.layout import Layout

HIDDEN = 1e-6
"""A pattern of which the fit leaves less than this share is not told from what is unknown already."""
LEAST_ROWS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Told:
    """Of c patterns: ``shown`` (c,) = h' W r, ``seen`` (c, c) = h' W R h, ``told`` which the fit tells from its unknowns, and by how
    much the unknowns fall for one unit of each, ``moved`` (count, c)."""

    shown: Vector
    seen: Vector
    told: NDArray[np.bool_]
    moved: Vector

    @property
    def size(self) -> Vector:
        """Return how large each pattern is by itself, shape (c,)."""
        found: Vector = np.where(self.told, self.shown, 0.0) / np.where(self.told, np.diag(self.seen), 1.0)
        return found

    @property
    def statistic(self) -> Vector:
        """Return the square of size over uncertainty of each pattern by itself, shape (c,); 0 where it is not told."""
        found: Vector = self.size * np.where(self.told, self.shown, 0.0)
        return found


def tell(fit: MixedFit, rows: NDArray[np.int64], pattern: Vector) -> Told:
    """Return what a fit says about patterns (k, c) on some of its rows (k,); they are zero on all others."""
    some = Rows(fit.rows.column[rows], fit.rows.value[rows], fit.rows.count).dense()
    weighted = fit.weight[rows, None] * pattern
    right = some.T @ weighted
    taken = fit.inverse.solve(right)
    on_causes = fit.causes.left[rows].T @ pattern
    mixed = fit.root @ on_causes
    whole = np.sum(weighted * pattern, axis=0)
    seen = pattern.T @ weighted - right.T @ taken - mixed.T @ mixed
    return Told(
        shown=weighted.T @ fit.residual[rows],
        seen=0.5 * (seen + seen.T),
        told=np.diag(seen) > HIDDEN * np.maximum(whole, np.finfo(np.float64).tiny),
        moved=taken - fit.causes.taken @ (fit.amount_covariance @ on_causes),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Family:
    """Hypotheses of one kind that are told together: patterns (k, c) on ``rows`` (k,); ``named`` (c,) are the readings, or for a scale
    the setup, that each is named after. ``critical``: the square of size over uncertainty that is no chance; ``least``: a size below
    which it is left alone; ``usual``: its standard deviation where it happens, ``free``: more than it ever is."""

    kind: str
    rows: NDArray[np.int64]
    pattern: Vector
    named: NDArray[np.int64]
    critical: float
    least: float
    usual: float = np.inf
    free: float = 1e3


STOP, STEP, SCALE, WARMING = "stop", "step", "scale", "warming"
CRITICAL = 4.2**2
"""Once in three hundred surveys of 125 stops."""
CRITICAL_OF_FEW = 3.0**2
"""For hypotheses of which a survey has a dozen, not hundreds."""
LEAST_UM = 0.5
"""Contradictions below this are not called wrong stops however small the noise."""
LEAST_UM_M = 1.0


def families(fit: MixedFit, layout: Layout) -> Iterator[Family]:
    """Return every hypothesis of one unknown about the readings that are used."""
    used = np.flatnonzero(fit.weight[: len(layout)] > 0)
    for rows in counts(layout, used):
        yield Family(kind=STOP, rows=rows, pattern=np.eye(len(rows)), named=rows, critical=CRITICAL, least=LEAST_UM)
        # a step before the second reading or the last is a wrong first or last one
        pattern, named = steps_of(len(rows))[:, 1:-1], rows[2:-1]
        yield Family(kind=STEP, rows=rows, pattern=pattern, named=named, critical=CRITICAL, least=LEAST_UM)
    yield from _scales(layout, used)


def counts(layout: Layout, used: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return the used rows of every unbroken count, in the order of time; those of a handful of stops are no count to judge."""
    each = [used[layout.offset_index[used] == number] for number in np.unique(layout.offset_index[used])]
    return [rows for rows in each if len(rows) > LEAST_ROWS]


def steps_of(count: int) -> Vector:
    """Return the steps before each reading but the first, shape (count, count - 1): 1 from there on."""
    lower: Vector = np.tril(np.ones((count, count)))[:, 1:]
    return lower


def _scales(layout: Layout, used: NDArray[np.int64]) -> Iterator[Family]:
    """Return the scale of each setup, in um/m, and the growth of the machine with time, in um/m an hour and an hour squared."""
    along_m = 1e-3 * np.sum((layout.position_mm - layout.volume.origin_mm) * layout.direction, axis=1)[used]
    setups = np.unique(layout.setup_index[used])
    if len(setups) < 2:
        return
    scale = along_m[:, None] * (layout.setup_index[used, None] == setups)
    yield Family(kind=SCALE, rows=used, pattern=scale, named=setups, critical=CRITICAL_OF_FEW, least=LEAST_UM_M, usual=5.0, free=30.0)
    hours = layout.hours[used]
    if np.all(np.isfinite(hours)) and np.ptp(hours) > 0:
        late = (hours - hours.mean()) / np.ptp(hours)
        growth = along_m[:, None] * np.column_stack([late, late**2])
        yield Family(
            kind=WARMING, rows=used, pattern=growth, named=np.arange(2), critical=CRITICAL_OF_FEW, least=LEAST_UM_M, usual=20.0, free=100.0
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """One hypothesis with its ``pattern`` (k,) on ``rows`` (k,): ``size``, square of it over its uncertainty (``statistic``) and over its
    usual size (``unusual``), what it is named after, and what the unknowns are (count,) if it is true."""

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


def shown(fit: MixedFit, every: Sequence[Family], scale: float, least: float) -> list[Hypothesis]:
    """Return the hypotheses that explain more than ``least`` of the square sum of the residuals, those that explain most first.

    ``scale`` is by how much the residuals are noisier than their weights say. All but the `MOST_SHOWN` best are left out.
    """
    found = [(family, tell(fit, family.rows, family.pattern)) for family in every]
    ranked = [
        (float(told.statistic[place]) / scale**2, number, int(place))
        for number, (family, told) in enumerate(found)
        for place in np.flatnonzero((told.statistic > least * scale**2) & (np.abs(told.size) >= family.least))
    ]
    ranked.sort(key=lambda one: -one[0])
    return [_hypothesis(fit, *found[number], place, statistic) for statistic, number, place in ranked[:MOST_SHOWN]]


def _hypothesis(fit: MixedFit, family: Family, told: Told, place: int, statistic: float) -> Hypothesis:
    return Hypothesis(
        kind=family.kind,
        named=int(family.named[place]),
        rows=family.rows,
        pattern=family.pattern[:, place],
        size=float(told.size[place]),
        statistic=statistic,
        critical=family.critical,
        unusual=float((told.size[place] / family.usual) ** 2),
        free=family.free,
        without=fit.unknowns - told.size[place] * told.moved[:, place],
    )
