"""The scatter of the machine and the laser, estimated before the search for contradictions.

Theory of operation. A reading differs from the model by two random errors:

    miss    the positioning deviation of a move along its axis, common to all stops until the next
            move of this axis. Its standard deviation is the repeatability of the axis.
    noise   the scatter of a single stop: the stated noise of the laser, and in addition vibration
            and turbulence in the setup.

The misses at the first stop of a pass have a separate standard deviation, because they include the
backlash if there is no overrun. Misses are unknowns with a prior (`solver.model.priors`). Noise is
the inverse root of a reading's weight. Repetitions, out-and-back pairs, and the three stops of each
miss in a step diagonal separate misses from noise. All standard deviations together maximise the
restricted likelihood times a prior. The prior is normal in the logarithm: the axes of a machine are
similar, the setups of a survey are similar, and both are near the assumed value. Without
information in the readings the result is the assumed value.

The maximum is computed in rounds. Each kind of rows has n, the sum of its redundancies, and S, the
weighted square sum of its residuals, with the present standard deviation s0. For a new standard
deviation s, the log-likelihood is about (Foerstner 1979; exact at the maximum, where r = 1)

    -1/2 (n log r + S / r),    r = 1 - w + w s^2 / s0^2

where w is the share of s0^2 in the variance, because the stated part of the noise is constant. The
maximum of this expression with the prior is the next s0. For r > 1, n log r is replaced by its
upper bound n r, which prevents oscillation. Standard deviations that are hardly separated converge
slowly, so each step is extrapolated.

Before the search for wrong stops, S is n times a robust mean of the squares.
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
"""Kind of the misses at first stops; kinds 0, 1, 2 are the axes."""
FIRST_UM = 1.0
"""Assumed miss at a first stop: half the backlash of an ordinary machine without overrun."""
BROAD = 1.0
"""Prior standard deviation of the logarithm of a size: for 0.5 um the 95 % range is 0.07 to 3.5
um, from a grinding machine to a worn machine."""
AXES_ALIKE = 0.3
"""Prior standard deviation of the logarithm of an axis' repeatability relative to the other
axes."""
SETUPS_ALIKE = 0.5
"""Prior standard deviation of the logarithm of a setup's noise relative to the other setups."""
BESIDE_STATED_UM = 0.05
"""Assumed noise in addition to the stated noise; the mean over a dwell removes most of the
vibration."""
SETTLED = 0.05
"""Relative change of all sizes below which the rounds end."""
ROUNDS = 8
_STEPS, _LONGEST, _EXACT = 40, 1.0, 1e-6
"""Newton's iteration on the logarithms: largest number of steps, longest step, and length of the
last step."""
_USUAL_RATE, _RATES = 0.3, (-1.0, 0.5)
"""Usual ratio of two successive steps, and the permitted range of the ratio."""
LEAST_SHOWN = 1.0
"""Smallest number of degrees of freedom with which a standard deviation may increase; with
fewer, a single contradiction would increase the standard deviation."""
_LEAST_REDUNDANCY = 1e-6
_MOST, _OF_NORMAL = 1.5, 0.778465
"""Limit of a residual in a robust mean, in standard deviations, and the mean square of a normal
variable clipped at this limit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scatter:
    """``misses_um`` (4,) is the standard deviation of a miss of each axis, and at the first stop
    of a pass (`FIRST`). ``noise_um`` (setups,) is the noise of a reading in addition to its
    stated noise. ``freedom_misses`` and ``freedom_noise`` are their degrees of freedom."""

    misses_um: Vector
    noise_um: Vector
    freedom_misses: Vector
    freedom_noise: Vector

    @property
    def repeatability_um(self) -> float:
        """Return the root mean square repeatability over the axes with degrees of freedom, or
        over all axes if there are none."""
        shown = self.freedom_misses[:FIRST] > 0
        return float(
            np.sqrt(
                np.mean(self.misses_um[:FIRST][shown if np.any(shown) else slice(None)] ** 2)
            )
        )

    @classmethod
    def assumed(cls, layout: Layout, assumed: Assumptions) -> Self:
        return cls(
            misses_um=np.append(
                np.full(3, max(assumed.repeatability_um, LEAST_U_UM)), FIRST_UM
            ),
            noise_um=np.where(_unstated(layout), assumed.reading_um, BESIDE_STATED_UM),
            freedom_misses=np.zeros(FIRST + 1),
            freedom_noise=np.zeros(len(layout.setups)),
        )

    def u_um(self, layout: Layout) -> Vector:
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
        size_um = np.maximum(np.exp(log_um), LEAST_U_UM)
        return replace(self, misses_um=size_um[: FIRST + 1], noise_um=size_um[FIRST + 1 :])

    def near(self, other: "Scatter", layout: Layout) -> bool:
        own, others = (one.u_um(layout) for one in (self, other))
        misses = np.hypot(self.misses_um, np.mean(own)) / np.hypot(
            other.misses_um, np.mean(others)
        )
        return bool(np.max(np.abs(np.log(np.concatenate([misses, own / others])))) < SETTLED)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Misses:
    """The prior rows of the misses: ``rows`` (k,), and their ``kind`` (k,), which is the axis or
    `FIRST`."""

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
    """Return the scatter for the next round, from a fit with the scatter ``before``. With
    ``robust``, wrong stops hardly influence the result."""
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
    """Return a step (k,) extrapolated by Aitken's delta-squared process from the ``last`` step."""
    rate = np.where(
        last == 0.0,
        _USUAL_RATE,
        np.clip(step * last / np.maximum(last**2, _EXACT**2), *_RATES),
    )
    found: Vector = step / (1.0 - rate)
    return found


def _shown(fit: AnyFit, rows: NDArray[np.int64], *, robust: bool) -> tuple[float, float]:
    redundancy = fit.redundancy[rows]
    used = (redundancy > _LEAST_REDUNDANCY) & (fit.weight[rows] > 0)
    checked, redundancy = rows[used], redundancy[used]
    weighted = fit.weight[checked] * fit.residual[checked] ** 2
    freedom, squares = float(np.sum(redundancy)), float(np.sum(weighted))
    if robust and squares > 0.0:
        squares = freedom * _robust_mean(weighted / redundancy)
    return freedom, squares if freedom >= LEAST_SHOWN else min(squares, freedom)


def _robust_mean(square: Vector) -> float:
    """Return the mean of squares (k,) of normal variables, clipped at `_MOST` standard
    deviations (Huber's proposal 2)."""
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
    """Return the most likely logarithms of all sizes, shape (4 + setups,), by their n
    (``freedom``), S (``squares``) and w (``share``) at the logarithms ``before``."""
    prior, log = _prior_information(len(before) - FIRST - 1), before
    for _ in range(_STEPS):
        size = share * np.exp(2.0 * (log - before))
        ratio = 1.0 - share + size
        now, left = size / ratio, squares / ratio
        # n log r is replaced by n r for r > 1
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
    """Return the setups without a stated or an estimated noise."""
    shown = found.freedom_noise + np.sum(found.freedom_misses[:FIRST]) >= LEAST_FREEDOM
    return [
        setup.name
        for setup, lacking, seen in zip(layout.setups, _unstated(layout), shown, strict=True)
        if lacking and not seen
    ]


def separated(layout: Layout) -> NDArray[np.bool_]:
    """Return for every setup whether its readings separate noise from misses, shape (setups,).

    Noise and misses are separable if most readings of the setup share the last move of an axis
    with another reading. In a linear run each reading has its own move, so noise and misses
    have the same pattern.
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
    return np.where(np.isfinite(layout.u_um), layout.u_um, 0.0)


def _unstated(layout: Layout) -> NDArray[np.bool_]:
    return np.array(
        [
            not np.all(np.isfinite(layout.u_um[layout.setup_index == index]))
            for index in range(len(layout.setups))
        ]
    )
