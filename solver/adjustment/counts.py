"""The unbroken counts of the laser in a survey, and the visibility of errors in each count after a
fit: of a wrong reading, of a step, and of a random walk.

The visibilities are computed for a fit without random effects; random effects are a small
correction.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.linear.fit import Fit
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.layout import Layout

LEAST_ROWS = 3
"""Largest number of readings with which a step cannot be distinguished from a wrong first or
last stop."""
MOST_WAVES = 48
"""Number of components of a random walk, which contain 99 % of its variance."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Count:
    """An unbroken count: its used ``rows`` (k,) in the order of time. ``way`` is the name of its
    setup without the number of the repetition. ``place`` (k,) are the numbers of the targets.
    ``along_mm`` (k,) is the distance along the travel.

    The visibility of a pattern h of the readings after the fit is h' W R h: W are the weights, R
    removes the unknowns. ``stop`` (k,) is the visibility of an error of one reading. ``step`` (k,)
    is the visibility of an equal error of one reading and all later readings. ``walk`` (k, r) are
    the largest components of a random walk of 1 um per step, and ``walked`` (r, r) is their
    visibility.
    """

    rows: NDArray[np.int64]
    way: str
    place: NDArray[np.int64]
    along_mm: Vector
    stop: Vector
    step: Vector
    walk: Vector
    walked: Vector


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Way:
    """All passes with the same travel: ``rows`` (k,) are their readings. ``pattern`` (k, c) has a
    column for an error at each repeated target and a column for a step at the target.

    ``left`` (c,) is the visibility h' W R h (`Count`) of each column h; ``whole`` (c,) is h' W h.
    ``named`` (c,) is the first reading at the target.
    """

    rows: NDArray[np.int64]
    named: NDArray[np.int64]
    pattern: Vector
    left: Vector
    whole: Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class Counts:
    fixed: Fit
    single: Sequence[Count]

    @cached_property
    def ways(self) -> list[Way]:
        """Return the travels with more than `LEAST_ROWS` repeated targets."""
        every = [
            [count for count in self.single if count.way == way]
            for way in dict.fromkeys(count.way for count in self.single)
        ]
        return [way for driven in every if (way := _way_of(self.fixed, driven)) is not None]


def counts(fixed: Fit, layout: Layout, kinds: Collection[str] | None = None) -> Counts:
    """Return every unbroken count with more than `LEAST_ROWS` used readings, optionally for some
    kinds of setups."""
    every = [rows for rows in _unbroken(fixed, layout, kinds) if len(rows) > LEAST_ROWS]
    place = layout.target_index
    return Counts(
        fixed=fixed,
        single=[
            _count(fixed.weight[rows], among, layout, place, rows)
            for rows, among in zip(every, _among_each(fixed, every), strict=True)
        ],
    )


def short_counts(
    fixed: Fit, layout: Layout, kinds: Collection[str]
) -> list[NDArray[np.int64]]:
    """Return the rows of every unbroken count with 2 to `LEAST_ROWS` used readings."""
    return [rows for rows in _unbroken(fixed, layout, kinds) if 1 < len(rows) <= LEAST_ROWS]


def _unbroken(
    fixed: Fit, layout: Layout, kinds: Collection[str] | None
) -> list[NDArray[np.int64]]:
    wanted = np.array(
        [kinds is None or setup.kind in kinds for setup in layout.setups], dtype=np.bool_
    )[layout.setup_index]
    used = np.flatnonzero((fixed.weight[: len(layout)] > 0) & wanted)
    return [
        used[layout.offset_index[used] == number]
        for number in np.unique(layout.offset_index[used])
    ]


def _count(
    weight: Vector,
    among: "_Among",
    layout: Layout,
    place: NDArray[np.int64],
    rows: NDArray[np.int64],
) -> Count:
    """Return a count from the matrix W - W A C A' W of its rows: ``weight`` (k,) is the diagonal of
    W, ``among`` is A C A' (`_among_each`)."""
    walk = walk_of(len(rows))
    own = weight**2 * among.diagonal()
    # the visibility of a step is the sum of the matrix elements of all readings after the step: the
    # diagonal once, each element above the diagonal twice
    common = weight * among.with_those_after(weight)
    weighted = weight[:, None] * walk
    return Count(
        rows=rows,
        way=layout.setups[layout.setup_index[rows[0]]].base,
        place=place[rows],
        along_mm=np.sum(layout.position_mm[rows] * layout.direction[rows], axis=1),
        stop=weight - own,
        step=from_each_on(weight - own - 2.0 * common),
        walk=walk,
        walked=walk.T @ weighted - weighted.T @ among.times(weighted),
    )


def _way_of(fixed: Fit, driven: Sequence[Count]) -> Way | None:
    rows, target, along_mm = (
        np.concatenate([getattr(count, name) for count in driven])
        for name in ("rows", "place", "along_mm")
    )
    _, first, place, times = np.unique(
        target, return_index=True, return_inverse=True, return_counts=True
    )
    order = np.argsort(along_mm[first], kind="stable")
    again = np.flatnonzero(times[order] > 1)
    if len(again) <= LEAST_ROWS:
        return None
    at = (order[:, None] == place).astype(np.float64)
    # a step before the second or the last target is the same as a wrong first or last target
    steps = again[2:-1]
    weighted = at * fixed.weight[rows]
    among = fixed.inverse.among(fixed.rows.select(rows).summed(weighted))
    whole, on_each = np.sum(weighted, axis=1), from_each_on(from_each_on(among).T)
    return Way(
        rows=rows,
        named=rows[first[order[np.concatenate([again, steps])]]],
        pattern=np.column_stack([at[again].T, from_each_on(at)[steps].T]),
        left=np.concatenate(
            [
                (whole - np.diag(among))[again],
                (from_each_on(whole) - np.diag(on_each))[steps],
            ]
        ),
        whole=np.concatenate([whole[again], from_each_on(whole)[steps]]),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Among:
    """The covariance A C A' of the fitted readings of a count, shape (k, k), in parts: ``alike +
    across own' + own across'``. ``alike`` is the part that all repetitions of a pass have in
    common. ``own`` are the columns of A that are constant within the count. ``above`` is the part
    of ``alike`` above the diagonal."""

    alike: Vector
    above: Vector
    across: Vector
    own: Vector

    def diagonal(self) -> Vector:
        found: Vector = np.diag(self.alike) + 2.0 * np.sum(self.across * self.own, axis=1)
        return found

    def times(self, values: Vector) -> Vector:
        product: Vector = (
            self.alike @ values
            + self.across @ (self.own.T @ values)
            + self.own @ (self.across.T @ values)
        )
        return product

    def with_those_after(self, values: Vector) -> Vector:
        own, across = (after_each(values[:, None] * part) for part in (self.own, self.across))
        product: Vector = self.above @ values + np.sum(
            self.across * own + self.own * across, axis=1
        )
        return product


def _among_each(fixed: Fit, every: Sequence[NDArray[np.int64]]) -> Iterator[_Among]:
    """Yield, for each count, the covariance A C A' of its fitted readings: A are its rows, C is the
    covariance of the unknowns.

    Repetitions of a pass differ only in columns that are constant within a count (zero, drift): A =
    B + D. The product B C B' is computed once for successive repetitions.
    """
    some = [fixed.rows.select(rows) for rows in every]
    alike = [(np.ptp(one.column, axis=0) == 0) & np.any(one.value, axis=0) for one in some]
    common = [one.column[0, mine] for one, mine in zip(some, alike, strict=True)]
    edges = np.cumsum([0, *map(len, common)])
    unit = np.zeros((fixed.rows.count, edges[-1]))
    unit[np.concatenate([np.zeros(0, dtype=np.int64), *common]), np.arange(edges[-1])] = 1.0
    solved = np.split(fixed.inverse.solve(unit), edges[1:-1], axis=1)
    before, among = None, np.zeros((0, 0))
    for one, mine, column, moved in zip(some, alike, common, solved, strict=False):
        own = one.value[:, mine]
        rest = Rows(one.column * ~mine, one.value * ~mine, one.count)
        key = rest.column.tobytes() + rest.value.tobytes()
        if key != before:
            before, among = key, fixed.inverse.among(rest)
            above = np.triu(among, 1)
        yield _Among(
            alike=among,
            above=above,
            across=rest.times(moved) + 0.5 * own @ moved[column],
            own=own,
        )


def from_each_on(values: Vector) -> Vector:
    """Return for each row the sum of the row and all later rows."""
    summed: Vector = np.cumsum(values[::-1], axis=0)[::-1]
    return summed


def after_each(values: Vector) -> Vector:
    """Return for each row the sum of all later rows."""
    summed: Vector = from_each_on(values) - values
    return summed


def steps_of(count: int, places: NDArray[np.int64]) -> Vector:
    """Return unit steps that begin at the readings ``places``, shape (count, places)."""
    steps: Vector = (np.arange(count)[:, None] >= places).astype(np.float64)
    return steps


def walk_of(count: int) -> Vector:
    """Return a random walk of 1 um per step by its largest components, shape (count, r): walk @
    walk.T is its covariance.

    The components are the eigenvectors of min(i, j) (Karhunen and Loeve).
    """
    steps = count - 1
    half_turn = np.pi * (np.arange(min(steps, MOST_WAVES)) + 0.5) / (2 * steps + 1)
    waves: Vector = np.sin(2.0 * np.arange(count)[:, None] * half_turn) / (
        np.sin(half_turn) * np.sqrt(2 * steps + 1)
    )
    return waves
