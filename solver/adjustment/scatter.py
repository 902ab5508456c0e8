"""Scatter of a machine and its laser: estimated before the search for contradictions.

Theory of operation. A reading differs from the model by two kinds of chance:

    miss    each move of an axis ends beside its target by a miss along this axis. A standing axis
    keeps its place: all stops
            until its next move share its miss. Standard deviation: the repeatability of this axis.
    noise   the laser's own scatter, stated by each stop, and beside it vibration and turbulence of
    the setup, of each stop alone.

In a pass without overrun the axes reach the first stop from either side: the misses at its first
stop have a separate size, which includes the backlash. Misses are unknowns of the adjustment, held
near zero by a prior with the repeatability (`solver.model.priors`); noise is the inverse root of a
reading's weight. Repeats, the comparison of the way out with the way back, and the pattern of three
stops of a miss in a step diagonal separate the two. A standard deviation s that was assumed as s0
has the likelihood (Foerstner 1979; after convergence it is the restricted maximum likelihood)

    log L(s) = -1/2 (n log(s^2 / s0^2) + S s0^2 / s^2),    n = sum of redundancies,    S = sum of
    weighted squared residuals

over its rows. Before the search for wrong stops, S comes from the median of the residuals, which
single stops do not change. The prior is normal in the logarithm: the axes of a machine have similar
repeatability, setups of a survey are similar, and both are within a broad range of the assumed
size. The sizes are estimated together as the most likely; where the readings show nothing, the
assumed size stays.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.volume import Vector
from stepdiag.solver.linear.mixed import AnyFit
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import CHECKED, LEAST_FREEDOM, LEAST_U_UM

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
_LOG = np.linspace(-8.0, 8.0, 401)
_COMMON = np.linspace(-8.0, 8.0, 161)
_NORMAL = 1.4826
"""Ratio of the standard deviation of a normal variable to the median of its size."""


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
    # backlash at first stops has the same size in all passes of an axis, so a median would not
    # remove it
    shown = [
        _shown(fit, misses.rows[misses.kind == kind], robust=robust and kind != FIRST)
        for kind in range(FIRST + 1)
    ]
    likely = [_likely(np.exp(2.0 * _LOG), *one) for one in shown]
    log, size = np.log(before.misses_um), assumed.misses_um
    axes = _together(likely[:FIRST], log[:FIRST], size[:FIRST], AXES_ALIKE)
    first = _together(likely[FIRST:], log[FIRST:], size[FIRST:], BROAD)
    noise, freedom = _noise(fit, layout, before, assumed, robust=robust)
    return Scatter(
        misses_um=np.maximum(np.concatenate([axes, first]), LEAST_U_UM),
        noise_um=np.maximum(noise, LEAST_U_UM),
        freedom_misses=np.array([freedom for freedom, _ in shown]),
        freedom_noise=freedom,
    )


def _noise(
    fit: AnyFit, layout: Layout, before: Scatter, assumed: Scatter, *, robust: bool
) -> tuple[Vector, Vector]:
    """Return the noise of every setup, and the degrees of freedom of its estimate, shapes
    (setups,).
    """
    stated = _stated_um(layout)
    used_um = before.u_um(layout)
    likely, freedom = [], np.zeros(len(layout.setups))
    for index in range(len(layout.setups)):
        rows = np.flatnonzero((layout.setup_index == index) & (fit.weight[: len(layout)] > 0))
        freedom[index], squares = _shown(fit, rows, robust=robust)
        size = before.noise_um[index] * np.exp(_LOG)
        share = (
            (stated[rows, None] ** 2 + size**2) / used_um[rows, None] ** 2
            if len(rows)
            else np.ones((1, len(_LOG)))
        )
        likely.append(_likely(np.mean(share, axis=0), freedom[index], squares))
    return _together(likely, np.log(before.noise_um), assumed.noise_um, SETUPS_ALIKE), freedom


def _shown(fit: AnyFit, rows: NDArray[np.int64], *, robust: bool) -> tuple[float, float]:
    """Return degrees of freedom and square sum of the residuals of some rows, as evidence of their
    scatter.
    """
    redundancy = fit.redundancy[rows]
    used = (redundancy > CHECKED) & (fit.weight[rows] > 0)
    checked, freedom = rows[used], float(np.sum(redundancy[used]))
    if freedom < 1.0:
        return 0.0, 0.0
    weighted = fit.weight[checked] * fit.residual[checked] ** 2
    if not robust:
        return freedom, float(np.sum(weighted))
    normalised = np.sqrt(weighted / redundancy[used])
    return freedom, freedom * (_NORMAL * float(np.quantile(normalised, 0.5))) ** 2


def _likely(ratio: Vector, freedom: float, squares: float) -> Vector:
    """Return the log-likelihood of variances larger by ``ratio`` than those of the fit."""
    found: Vector = -0.5 * (freedom * np.log(ratio) + squares / ratio)
    return found


def _together(
    likely: Sequence[Vector], log_before: Vector, assumed: Vector, alike: float
) -> Vector:
    """Return the sizes of a class that are most likely together, shape (k,).

    ``likely`` (k, sizes) are the log-likelihoods of sizes ``before`` * exp(`_LOG`); the class has a
    common size in addition to the assumed.
    """
    best = np.argmax(
        sum(
            (
                np.max(_by_common(*one, alike), axis=1)
                for one in zip(likely, log_before - np.log(assumed), strict=True)
            ),
            -0.5 * (1.0 / BROAD**2 + len(likely) / alike**2) * _COMMON**2,
        )
    )
    found = [
        at
        + _LOG[
            np.argmax(one - 0.5 * ((at + _LOG - np.log(own) - _COMMON[best]) / alike) ** 2)
        ]
        for one, at, own in zip(likely, log_before, assumed, strict=True)
    ]
    return np.array(np.exp(found))


def _by_common(likely: Vector, shift: float, alike: float) -> Vector:
    """Return the log-likelihood and prior of every size (columns) for each common size (rows), less
    the square of the common size: one product and one sum for each pair.
    """
    size = shift + _LOG
    found: Vector = np.outer(_COMMON / alike**2, size)
    found += likely - 0.5 * (size / alike) ** 2
    return found


def unshown(found: Scatter, layout: Layout) -> Sequence[str]:
    """Return the setups whose readings state no noise and show none."""
    shown = found.freedom_noise + np.sum(found.freedom_misses[:FIRST]) >= LEAST_FREEDOM
    return [
        setup.name
        for setup, lacking, seen in zip(layout.setups, _unstated(layout), shown, strict=True)
        if lacking and not seen
    ]


def separated(layout: Layout) -> NDArray[np.bool_]:
    """Return for every setup whether it separates noise from misses: most of its readings share the
    miss of a move with another reading, shape (setups,).

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
