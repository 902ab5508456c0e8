"""Theory of operation: the diagonals that the setups of a survey have measured.

The steps of two diagonals can have the same lengths, so that the laser's steps fit either name. The
readings of all setups agree on one machine only with the right names. The readings y are normal:

    y = M a + F b + e

M a are the errors of a machine of the usual sizes (`Assumptions`): the straight part and the half
waves of every displacement, and the angular functions. A reading has the row of M of the diagonal
that its setup has measured, at the same pass and stop. F b are the offsets, tilts and drifts of the
setups; they are unknown, and are removed. e is the noise of the readings, of the moves and of the
effects in time. The sizes of displacements, angles and noise are the usual sizes times a factor;
each combination of the `FACTORS` has the same probability.

The search begins with the stated names. A change exchanges two diagonals, or one setup has measured
the diagonal of another setup. The most likely names are changed again until none of the remaining
names has 1 / `ODDS` of the best likelihood. Other names have the prior probability `EXCHANGED`,
divided by the number of possible changes.

Wrong names also explain part of a wrong stop, of a step of the count, of the scale of a setup, or
of a product of two axes. The likelihood of these explanations is computed in the same model, with
the stated names. If a diagonal was driven twice, another one has no readings, and no names give a
right result.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.evidence import (
    EXCHANGED,
    GROWING,
    HIDDEN,
    ODDS,
    Family,
    log_prior,
)
from stepdiag.solver.model.design import Columns, Design
from stepdiag.solver.model.effects import (
    LONG_WAVES,
    MOST_WAVES,
    WAVE_SHARE,
)
from stepdiag.solver.model.layout import MOVES, Layout

FACTORS = GROWING / ODDS
"""Factors of the variance of displacements and of noise."""
Names = tuple[int, ...]
"""For each setup, the number of the setup whose diagonal it has measured."""


class Programs:
    """The odds of the diagonals that the programs of a survey drove.

    ``target`` and ``u_um`` (m,) are the readings and their noise; ``misses_um`` is the
    repeatability of each move. ``turning_um`` and ``in_time_um`` (m, k) are the patterns of the
    angular functions and of the effects in time.
    """

    def __init__(
        self,
        design: Design,
        layout: Layout,
        target: Vector,
        u_um: Vector,
        misses_um: Vector,
        turning_um: Vector,
        in_time_um: Vector,
        assumed: Assumptions,
    ) -> None:
        moves = np.array([MOVES[setup.kind] for setup in layout.setups])[layout.setup_index]
        # more than two targets in a half wave hardly change the odds
        every = -(-layout.volume.increments // (2 * LONG_WAVES))
        kept = np.flatnonzero(layout.stop // moves % every == 0)
        self.kept, self.layout, columns = kept, layout.select(kept), design.columns
        rows = design.rows.select(kept).dense()
        machine = rows[:, : columns.machine] @ _machine(columns, layout, assumed)
        missed = rows[:, columns.miss :] * misses_um
        noise = np.hstack([np.diag(u_um[kept]), missed, in_time_um[kept]])
        unknown = rows[:, columns.offset : columns.line]
        left, size, _ = np.linalg.svd(unknown)
        left = left[:, np.count_nonzero(size > HIDDEN * size[0]) :]
        root = np.linalg.cholesky(left.T @ noise @ noise.T @ left)
        self.causes = machine, turning_um[kept]
        self.stated = tuple(range(len(layout.setups)))
        self.alike = list(_alike(layout))
        whitened = np.linalg.solve(root, left.T)
        held = whitened @ self._repeated()
        # the machine moves the readings along the first directions only
        self.moving = min(held.shape)
        self.whitened = np.linalg.qr(held, mode="complete").Q.T @ whitened
        self.shown = self.whitened @ target[kept]

    def _repeated(self) -> Vector:
        """Return the readings (m, groups) that have the same machine under all names: the passes of
        a setup are repeated.
        """
        _, row = np.unique(np.column_stack(self.causes), axis=0, return_inverse=True)
        every = (self.stated, *_changes(self.stated, self.alike))
        under = np.column_stack([row.ravel()[rows_of(self.layout, each)] for each in every])
        _, group = np.unique(under, axis=0, return_inverse=True)
        same: Vector = np.eye(int(np.max(group)) + 1)[group.ravel()]
        return same

    def other_names(self) -> dict[Names, float]:
        """Return the log-odds of other names against the stated names; empty if no two diagonals
        have the same passes, stops and step lengths.
        """
        found = {self.stated: self._likely(self.stated)} if self.alike else {}
        waiting, number = set(found), len(list(_changes(self.stated, self.alike)))
        while waiting:
            names = max(waiting, key=lambda each: found[each])
            if found[names] < max(found.values()) - np.log(ODDS):
                break
            waiting.remove(names)
            new = {each for each in _changes(names, self.alike) if each not in found}
            found |= {each: self._likely(each) for each in new}
            waiting |= new
        other = log_prior(EXCHANGED, number) - found.pop(self.stated, 0.0)
        return {names: likely + other for names, likely in found.items()}

    def most_odds(self, every: Sequence[Family]) -> float:
        """Return the log-odds of the best explanation of the families against no explanation, with
        the stated names.
        """
        variance, vector = self._variance(self.stated)
        shown = self.shown @ vector
        likely = _log_normal(shown, variance)
        found = [-np.inf]
        for family in every:
            inside = np.isin(family.rows, self.kept)
            pattern = np.zeros((len(self.kept), len(family.named)))
            at = np.searchsorted(self.kept, family.rows[inside])
            pattern[at] = family.pattern(np.arange(len(family.named)))[inside]
            moved = self.whitened @ np.unique(pattern, axis=1)
            moved = np.swapaxes(vector, 1, 2) @ moved
            seen = np.einsum("fntr,trc->fntc", 1.0 / variance, moved**2)
            size = np.einsum("fntr,trc->fntc", 1.0 / variance, moved * shown[..., None])
            best = size**2 / np.maximum(seen, HIDDEN)
            gain = [0.5 * (best * each / (1.0 + each) - np.log1p(each)) for each in GROWING]
            odds = np.logaddexp.reduce(likely[..., None] + gain, axis=(0, 1, 2, 3))
            many = sum(len(each.named) for each in every if each.kind == family.kind)
            prior = log_prior(family.kind, many) - np.log(len(GROWING))
            found.append(float(np.max(odds, initial=-np.inf)) + prior)
        return max(found) - float(np.logaddexp.reduce(likely, axis=None))

    def _likely(self, names: Names) -> float:
        """Return the log-likelihood of the readings, up to a constant."""
        variance, vector = self._variance(names)
        likely = _log_normal(self.shown @ vector, variance)
        return float(np.logaddexp.reduce(likely, axis=None))

    def _variance(self, names: Names) -> tuple[Vector, Vector]:
        """Return the variances of the readings for all factors, shape (machine, noise, angles, r),
        along the directions (angles, r, r).
        """
        rows, count = rows_of(self.layout, names), len(self.shown)
        seen = [self.whitened[: self.moving] @ each[rows] for each in self.causes]
        moving, turning = (each @ each.T for each in seen)
        # a good machine hardly turns
        turns = 1.0 / GROWING[:5:2, None, None]
        value, found = np.linalg.eigh(moving + turns * turning)
        vector = np.tile(np.eye(count), (len(turns), 1, 1))
        vector[:, : self.moving, : self.moving] = found
        machine = np.zeros((len(FACTORS), 1, len(turns), count))
        machine[..., : self.moving] = FACTORS[:, None, None, None] * np.maximum(value, 0.0)
        return machine + FACTORS[:, None, None], vector


def _log_normal(shown: Vector, variance: Vector) -> Vector:
    likely: Vector = -0.5 * np.sum(np.log(variance) + shown**2 / variance, axis=-1)
    return likely


def rows_of(layout: Layout, names: Names) -> NDArray[np.int64]:
    """Return for each reading the row of the diagonal that its setup has measured, shape (m,)."""
    rows = np.arange(len(layout))
    for setup, measured in enumerate(names):
        if setup != measured:
            rows[layout.setup_index == setup] = np.flatnonzero(layout.setup_index == measured)
    return rows


def _changes(names: Names, alike: Sequence[tuple[int, int]]) -> Iterator[Names]:
    """Yield the names in which two setups are exchanged, or one setup has measured the diagonal of
    another setup."""
    for first, second in alike:
        here, there = names[first], names[second]
        for pair in {(there, here), (second, there), (here, first)} - {(here, there)}:
            changed = list(names)
            changed[first], changed[second] = pair
            yield tuple(changed)


def _alike(layout: Layout) -> Iterator[tuple[int, int]]:
    """Yield each pair of diagonals with the same passes, stops, step lengths and beam."""
    number = np.array([key.number for key in layout.passes])[layout.pass_index]
    seen = {}
    for index, setup in enumerate(layout.setups):
        mine = layout.setup_index == index
        if setup.kind != "linear" and np.any(mine):
            step = np.round(np.abs(layout.direction[mine][0]), 6)
            seen[index] = (setup.shift, step, number[mine], layout.stop[mine])
    for first, second in combinations(seen, 2):
        if all(map(np.array_equal, seen[first], seen[second])):
            yield first, second


def _machine(columns: Columns, layout: Layout, assumed: Assumptions) -> Vector:
    """Return the displacements of a machine of the usual sizes at the nodes, shape (machine, k):
    a column for the straight part of each function and for each half wave."""
    share = np.arange(1, columns.nodes + 1) / columns.nodes
    number = np.arange(1, min(columns.nodes, MOST_WAVES + 1))
    waves = WAVE_SHARE * np.sin(np.pi * number * share[:, None]) / number
    found = [
        assumed.shape_um
        * np.eye(columns.machine, columns.machine - columns.play, -columns.play)
    ]
    for part, axis, component in product(columns.parts, range(3), range(3)):
        straight = assumed.scale_um_m if axis == component else assumed.squareness_urad
        size_um, line_um = assumed.shape_um, 1e-3 * straight * layout.volume.size_mm[axis]
        if part != 0:
            size_um = line_um = assumed.repeatability_um
        pattern = np.zeros((columns.machine, 1 + len(number)))
        pattern[columns.of(part, axis, component)] = np.column_stack(
            [line_um * share, size_um * waves]
        )
        found.append(pattern)
    return np.hstack(found)
