"""Scatter of a machine and its laser: estimated before the search for contradictions.

Theory of operation. A reading differs from the model by two kinds of chance:

    miss    the distance along an axis by which a move of this axis ends beside its target. The axis
            stands there until its next move, so all stops until then share the miss. Its standard
            deviation is the repeatability of the axis.
    noise   the scatter of each stop alone: the laser's, which each stop states, and in addition the
            vibration and turbulence of the setup.

In a pass without overrun the axes reach the first stop from either side: the misses at its first
stop have a separate size, which includes the backlash. Misses are unknowns of the adjustment, held
near zero by a prior with the repeatability (`solver.model.priors`); noise is the inverse root of a
reading's weight. Repeats, the comparison of the way out with the way back, and the pattern of three
stops of a miss in a step diagonal separate the two. The sizes are the most likely together, by the
restricted likelihood of the readings and a prior. The prior is normal in the logarithm: the axes of
a machine have similar repeatability, setups of a survey are similar, and both are within a broad
range of the assumed size. Where the readings show nothing, the assumed size stays.

The likelihood is climbed in rounds. With the sizes of a round, each kind of rows has the sum n of
its redundancies and the weighted square sum S of its residuals. For a variance larger by a factor r
the logarithm of the likelihood is about (Foerstner 1979; exact in the end, when r is one)

    -1/2 (n log r + S / r),    r = 1 - w + w s^2 / s0^2

where s replaces s0, and w is the share of s0^2 in the variance: the stated part of a noise does not
change. Its largest value with the prior is the next round. A larger size also makes n larger: for r
above one, n r stands for n log r, which bounds it from below, so that a size that the readings do
not show does not leap to the assumed size and back. Sizes that the readings tell apart badly come
nearer by about the same share in each round: each step is extended by the steps that would follow
it.

Before the search for wrong stops, S is n times a robust mean of the squares, which single stops
hardly change.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.volume import Vector
from stepdiag.solver.linear.mixed import AnyFit
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import LEAST_FREEDOM, LEAST_U_UM

FIRST = 3
"""Kind of the misses at first stops; 0, 1, 2 are the axes."""
FIRST_UM = 1.0
"""Assumed miss at a first stop: half the backlash of an ordinary machine without overrun, its
repeatability with an overrun.
"""
BROAD = 1.0
"""Standard deviation of the logarithm of a size: 0.5 um means 0.07 to 3.5 um (95 %), from a
grinding machine to a worn one."""
AXES_ALIKE = 0.3
"""Standard deviation of the logarithm for an axis relative to the others of its machine: by a third
up or down.
"""
SETUPS_ALIKE = 0.5
"""Standard deviation of the logarithm for the noise of a setup relative to the others: beams differ
in length and in their air.
"""
BESIDE_STATED_UM = 0.05
"""Assumed noise in addition to the statement of the stops: the mean over a dwell averages vibration
out.
"""
SETTLED = 0.05
"""Sizes that change by less than this share have converged."""
ROUNDS = 8
_STEPS, _LONGEST, _EXACT = 40, 1.0, 1e-6
"""Newton's iteration on the logarithms: number of steps, the longest, and the size of the last."""
_USUAL_RATE, _RATES = 0.3, (-1.0, 0.5)
"""Usual ratio of two successive steps, and the range of the ratio that extends a step: outside of
it the ratio comes from the other sizes.
"""
LEAST_SHOWN = 1.0
"""Degrees of freedom of a size below which the readings do not show that it is larger than before:
a single contradiction would appear as scatter.
"""
_LEAST_REDUNDANCY = 1e-6
"""Redundancy below which only rounding is left of a residual."""
_MOST, _OF_NORMAL = 1.5, 0.778465
"""Largest residual that a robust mean counts, in standard deviations, and the mean square of a
normal variable that is cut off there.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scatter:
    """``misses_um`` (4,): standard deviation of the miss of a move of each axis, and of each axis
    at the first stop of a pass (`FIRST`); ``noise_um`` (setups,): noise of a reading of each setup
    in addition to its statement, or all its noise without a statement. ``freedom_misses`` and
    ``freedom_noise``: their degrees of freedom.
    """

    misses_um: Vector
    noise_um: Vector
    freedom_misses: Vector
    freedom_noise: Vector

    @property
    def repeatability_um(self) -> float:
        """Return the repeatability of an approach, root mean square over the axes with a measured
        repeatability, over all where none has one.
        """
        shown = self.freedom_misses[:FIRST] > 0
        return float(
            np.sqrt(
                np.mean(self.misses_um[:FIRST][shown if np.any(shown) else slice(None)] ** 2)
            )
        )

    @classmethod
    def assumed(cls, layout: Layout, assumed: Assumptions) -> Self:
        """Return the assumed scatter of a survey."""
        return cls(
            misses_um=np.append(
                np.full(3, max(assumed.repeatability_um, LEAST_U_UM)), FIRST_UM
            ),
            noise_um=np.where(_unstated(layout), assumed.reading_um, BESIDE_STATED_UM),
            freedom_misses=np.zeros(FIRST + 1),
            freedom_noise=np.zeros(len(layout.setups)),
        )

    def u_um(self, layout: Layout) -> Vector:
        """Return the standard uncertainty of every reading by noise, shape (m,)."""
        u: Vector = np.maximum(
            np.hypot(_stated_um(layout), self.noise_um[layout.setup_index]), LEAST_U_UM
        )
        return u

    @property
    def log_um(self) -> Vector:
        """Return the logarithms of all sizes, misses first, shape (4 + setups,)."""
        found: Vector = np.log(np.concatenate([self.misses_um, self.noise_um]))
        return found

    def with_log(self, log_um: Vector) -> Self:
        """Return the scatter with other sizes; ``log_um`` as in the property of this name."""
        size_um = np.maximum(np.exp(log_um), LEAST_U_UM)
        return replace(self, misses_um=size_um[: FIRST + 1], noise_um=size_um[FIRST + 1 :])

    def near(self, other: "Scatter", layout: Layout) -> bool:
        """Return whether the scatter of readings and misses agrees with another within
        `SETTLED`.
        """
        own, others = (one.u_um(layout) for one in (self, other))
        misses = np.hypot(self.misses_um, np.mean(own)) / np.hypot(
            other.misses_um, np.mean(others)
        )
        return bool(np.max(np.abs(np.log(np.concatenate([misses, own / others])))) < SETTLED)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Misses:
    """The rows that hold misses near zero: their places ``rows`` (k,) and the ``kind`` (k,) of
    each, its axis or `FIRST`.
    """

    rows: NDArray[np.int64]
    kind: NDArray[np.int64]


def estimated(
    fit: AnyFit,
    layout: Layout,
    misses: Misses,
    before: Scatter,
    assumed: Scatter,
    *,
    robust: bool,
) -> Scatter:
    """Return the most likely sizes by a fit made with the sizes ``before``; ``robust`` if stops may
    be wrong.
    """
    share = np.minimum((before.noise_um[layout.setup_index] / before.u_um(layout)) ** 2, 1.0)
    by_setup = [
        np.flatnonzero(layout.setup_index == setup) for setup in range(len(layout.setups))
    ]
    shown = [
        *(
            _shown(fit, misses.rows[misses.kind == kind], robust=robust)
            for kind in range(FIRST + 1)
        ),
        *(_shown(fit, rows, robust=robust) for rows in by_setup),
    ]
    freedom, squares = np.array(shown).T
    of_size = np.concatenate(
        [np.ones(FIRST + 1), [np.mean(share[rows]) for rows in by_setup]]
    )
    found = before.with_log(
        _most_likely(before.log_um, assumed.log_um, of_size, freedom, squares)
    )
    shown_freedom = np.where(freedom >= LEAST_SHOWN, freedom, 0.0)
    return replace(
        found,
        freedom_misses=shown_freedom[: FIRST + 1],
        freedom_noise=shown_freedom[FIRST + 1 :],
    )


def further(step: Vector, last: Vector) -> Vector:
    """Return a step (k,) of the logarithms extended by the steps that would follow it: each is the
    same share of the one before it (Aitken's delta-squared process), `_USUAL_RATE` of the first.
    """
    rate = np.where(
        last == 0.0,
        _USUAL_RATE,
        np.clip(step * last / np.maximum(last**2, _EXACT**2), *_RATES),
    )
    found: Vector = step / (1.0 - rate)
    return found


def _shown(fit: AnyFit, rows: NDArray[np.int64], *, robust: bool) -> tuple[float, float]:
    """Return the degrees of freedom n of some rows, and S, as evidence of their scatter."""
    redundancy = fit.redundancy[rows]
    used = (redundancy > _LEAST_REDUNDANCY) & (fit.weight[rows] > 0)
    checked, redundancy = rows[used], redundancy[used]
    weighted = fit.weight[checked] * fit.residual[checked] ** 2
    freedom, squares = float(np.sum(redundancy)), float(np.sum(weighted))
    if robust and squares > 0.0:
        squares = freedom * _robust_mean(weighted / redundancy)
    return freedom, squares if freedom >= LEAST_SHOWN else min(squares, freedom)


def _robust_mean(square: Vector) -> float:
    """Return the mean of squares (k,) of normal variables, not all of them zero, of which those
    beyond `_MOST` standard deviations count as much as one there (Huber's proposal 2).
    """
    mean = float(np.mean(square))
    for _ in range(_STEPS):
        before = mean
        mean *= float(np.mean(np.minimum(square / mean, _MOST**2))) / _OF_NORMAL
        if abs(mean - before) <= SETTLED * before:
            break
    return mean


def _most_likely(
    before: Vector, usual: Vector, share: Vector, freedom: Vector, squares: Vector
) -> Vector:
    """Return the logarithms of all sizes that are most likely together, shape (4 + setups,), by n
    and S of each at the logarithms ``before``; ``share`` is w.
    """
    prior, log = _prior_information(len(before) - FIRST - 1), before
    for _ in range(_STEPS):
        size = share * np.exp(2.0 * (log - before))
        ratio = 1.0 - share + size
        now, left = size / ratio, squares / ratio
        # for a larger size, n r stands for n log r
        number = freedom * np.maximum(ratio, 1.0)
        of_number = np.where(ratio > 1.0, number, (1.0 - now) * freedom)
        curved = 2.0 * now * (now * left + np.maximum(of_number - (1.0 - now) * left, 0.0))
        step = np.linalg.solve(
            np.diag(curved) + prior, now * (left - number) - prior @ (log - usual)
        )
        step *= min(1.0, _LONGEST / max(float(np.max(np.abs(step))), _EXACT))
        log = log + step
        if np.max(np.abs(step)) <= _EXACT:
            break
    return log


def _prior_information(setups: int) -> Vector:
    """Return the inverse covariance of the logarithms of all sizes before any reading, shape (4 +
    setups, 4 + setups): sizes of a class share a deviation from the assumed size.
    """
    edges = np.cumsum([0, FIRST, 1, setups])
    prior = np.zeros((edges[-1], edges[-1]))
    for first, last, alike in zip(
        edges, edges[1:], (AXES_ALIKE, BROAD, SETUPS_ALIKE), strict=False
    ):
        count = last - first
        prior[first:last, first:last] = np.linalg.inv(
            BROAD**2 * np.ones((count, count)) + alike**2 * np.eye(count)
        )
    return prior


def unshown(found: Scatter, layout: Layout) -> Sequence[str]:
    """Return the setups whose readings state no noise and show none."""
    shown = found.freedom_noise + np.sum(found.freedom_misses[:FIRST]) >= LEAST_FREEDOM
    return [
        setup.name
        for setup, lacking, seen in zip(layout.setups, _unstated(layout), shown, strict=True)
        if lacking and not seen
    ]


def separated(layout: Layout) -> NDArray[np.bool_]:
    """Return for every setup whether its readings separate noise from misses, shape (setups,): most
    of its readings share the last move of an axis, and so its miss, with another reading.

    In a run along an axis each reading follows its own move, so noise and poor repeatability have
    the same pattern there.
    """
    moved = np.where(layout.direction != 0.0, layout.arrival, -1)
    many = np.bincount(moved[moved >= 0], minlength=1)
    shared = np.any((moved >= 0) & (many[np.maximum(moved, 0)] > 1), axis=1)
    count = len(layout.setups)
    common, every = (
        np.bincount(layout.setup_index[rows], minlength=count)
        for rows in (shared, slice(None))
    )
    return np.asarray(2 * common > every)


def _stated_um(layout: Layout) -> Vector:
    """Return the uncertainty stated by every reading, 0 without a statement, shape (m,)."""
    return np.where(np.isfinite(layout.u_um), layout.u_um, 0.0)


def _unstated(layout: Layout) -> NDArray[np.bool_]:
    """Return for every setup whether any of its readings has no stated uncertainty, shape
    (setups,).
    """
    return np.array(
        [
            not np.all(np.isfinite(layout.u_um[layout.setup_index == index]))
            for index in range(len(layout.setups))
        ]
    )
