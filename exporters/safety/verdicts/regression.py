"""The test whether a table is right. No other module decides whether a table is right.

The movement by the files, under the control's law, is regressed on the request of the result,
function by function:

    moved = factor * asked + rest

A right table has the factor 1, a table with a turned sign the factor -1. If two tables are swapped,
the factor for another function is 1. If the table is shifted along its axis, the factor at the
shifted positions is 1. Any other factor with a small rest means a table of the wrong size. A large
rest means a table of another function or machine. A movement of zero means a missing table. The
rest is orthogonal to the request, so the share of the error that stays with the table is hypot(1 -
factor, rest / asked).

Sizes are rms over points of equal weight, without their mean, because an origin is no error. Three
sizes excuse a difference. ``sure_um`` is the effect of rounding and of the uncertainty of the
result. ``unheld_um`` is the part that a table with these points cannot represent. ``spike_um`` is
the largest plausible scatter at a single place, from the first two sizes and a tolerated size.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stepdiag.base.volume import Vector, rms
from stepdiag.exporters.safety.verdicts.verdict import Code

SAME = 0.4
"""Largest share of an error that may remain with a right table: the change of an ordinary machine
between two surveys.
"""
SIZED = 0.15
"""Largest share by which the size of a table may differ from the right size. Rounding causes less
in every export.
"""
SHAPED = math.sqrt(1.0 - 0.9**2)
"""Largest share of a movement that may have another shape than the request, for the verdict that
only the size of the table is wrong. The share belongs to a correlation of 0.9 between movement and
request; it is about `SAME`.
"""
OTHER, EXACT = 0.35, 0.1
"""Limits of the share of the error that remains with another function or place. Up to `OTHER`, the
verdict names the other function or place. Up to `EXACT`, another function has priority over another
size.
"""
SPIKE = 3.0
"""Largest allowed difference of a table at a single position, as a multiple of the allowed rms
difference: about the largest value of a normal scatter.
"""
SURE_UM = 0.2
"""Movements below this value cannot be separated from rounding and noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """One regression. ``asked_um`` is the size of the request. ``size_um`` is the size of the
    error, to which shares refer.
    """

    factor: float
    asked_um: float
    size_um: float
    rest_um: float
    largest_um: float
    largest_index: int
    sure_um: float = SURE_UM
    unheld_um: float = 0.0
    spike_um: float = np.inf

    @property
    def moved_um(self) -> float:
        return float(np.hypot(self.factor * self.asked_um, self.rest_um))

    def left(self, factor: float = 1.0) -> float:
        """Return the share of the error that would remain if the right movement were the request
        times ``factor``.
        """
        left_um = float(np.hypot((self.factor - factor) * self.asked_um, self.rest_um))
        return float(np.maximum(0.0, left_um - self.unheld_um)) / max(
            self.size_um, self.sure_um
        )

    @property
    def left_scaled(self) -> float:
        """Return the share of the movement with another shape than the request, which no size of
        the table explains.
        """
        return self.rest_um / self.moved_um if self.moved_um > 0.0 else 1.0

    @property
    def is_large(self) -> bool:
        """Return whether the error exceeds the part that rounding and uncertainty can hide."""
        return self.size_um > self.sure_um

    @property
    def is_alike(self) -> bool:
        """Return whether the movement corrects the error in its right size except at one place, or
        both are too small to separate.
        """
        off_um = abs(self.factor - 1.0) * self.asked_um - self.unheld_um
        unsure = self.sure_um / max(self.size_um, self.sure_um)
        small = max(self.size_um, self.moved_um) < self.sure_um
        return small or bool(
            self.left() <= np.hypot(SAME, unsure)
            and off_um <= np.hypot(SIZED * self.size_um, self.sure_um)
        )

    @property
    def is_right(self) -> bool:
        return self.is_alike and self.largest_um <= self.spike_um


def regress(moved_um: Vector, asked_um: Vector) -> Fit:
    """Return the regression of a movement on the request of an error, arrays of the same shape."""
    own = rms(asked_um)
    factor = float(np.mean(moved_um * asked_um)) / own**2 if own > 0.0 else 0.0
    rest = moved_um - factor * asked_um
    index = int(np.argmax(np.abs(rest)))
    return Fit(
        factor=factor,
        asked_um=own,
        size_um=own,
        rest_um=rms(rest),
        largest_um=float(np.abs(rest).flat[index]),
        largest_index=index,
    )


class Explained(NamedTuple):
    """Explanation of a movement: the verdict, its regression, and the other function or place.

    The code "unlike" has a regression for a table that is wrong at one position, and no regression
    for a table of another machine.
    """

    code: Code
    fit: Fit | None = None
    other: str = ""
    shift_mm: float = 0.0


def explain(
    own: Sequence[Fit],
    turned: Sequence[Fit],
    others: Iterable[tuple[str, Fit]],
    shifted: Iterable[tuple[float, Fit]],
) -> Explained:
    """Return the explanation of a movement. ``own`` contains the regressions on its own function,
    one per possible form of the request.

    ``turned`` contains the same regressions for a rotated workpiece, which is used only for the
    verdict "right". ``others`` contains regressions on the other functions, ``shifted`` regressions
    at other places; both are computed only on demand.
    """
    every = (*own, *turned)
    right = [fit for fit in every if fit.is_right]
    if right:
        return Explained("right", min(right, key=Fit.left))
    if own and all(fit.moved_um < fit.sure_um for fit in own):
        return Explained("missing", max(own, key=lambda fit: fit.size_um))
    for fit in own:
        if fit.left(-1.0) <= SAME and fit.is_large:
            return Explained("sign-turned", fit)
    near = [fit for fit in every if fit.is_alike or fit.left() <= SAME]
    if near:
        fit = min(near, key=lambda fit: fit.rest_um)
        return Explained("unlike" if fit.is_alike else "scaled", fit)
    unscaled = min((fit.left_scaled for fit in own), default=1.0)
    for name, fit in others:
        if fit.size_um >= 2.0 * fit.sure_um and min(fit.left(), fit.left(-1.0)) <= min(
            OTHER, max(EXACT, unscaled)
        ):
            return Explained("axes-swapped", fit, other=name)
    elsewhere = [
        (shift, fit)
        for shift, fit in shifted
        if fit.left() <= min(OTHER, unscaled) and fit.is_large
    ]
    if elsewhere:
        shift, fit = min(elsewhere, key=lambda each: each[1].left())
        return Explained("beside-volume", fit, shift_mm=shift)
    sized = [fit for fit in own if fit.left_scaled <= SHAPED and fit.is_large]
    # The shapes of two slopes differ only by rounding: the smallest residual decides.
    if sized:
        best = min(sized, key=lambda fit: (round(fit.left_scaled, 3), fit.left()))
        return Explained("scaled", best)
    return Explained("unlike" if own else "beside-volume")


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The regression of laser readings on the effects of several tables: ``factor`` and ``u`` (k =
    1) of each table, shape (tables,).

    The matrix ``weigh`` (rows, readings) gives readings equal scatter ``sigma_um`` and removes the
    free columns. ``values`` contains the weighted readings.
    """

    factor: Vector
    u: Vector
    sigma_um: float
    weigh: Vector
    values: Vector

    def factor_of(
        self, table_um: Vector, beside_um: Vector, others_um: Sequence[Vector] = ()
    ) -> tuple[float, float]:
        """Return the factor of a table and its standard uncertainty. ``beside_um`` is subtracted
        from the readings before. The effects ``others_um`` are fitted with any size. The
        uncertainty is infinite if these effects hide the effect of the table.
        """
        column = self.weigh @ table_um
        if others_um:
            others = self.weigh @ np.column_stack(others_um)
            column = column - others @ np.linalg.lstsq(others, column)[0]
        size = float(np.linalg.norm(column))
        if size <= HIDDEN * float(np.linalg.norm(table_um)):
            return 1.0, np.inf
        rest = self.values - self.weigh @ beside_um
        return float(column @ rest) / size**2, self.sigma_um / size

    def misfit(self, predicted_um: Vector) -> float:
        """Return minus twice the logarithm of the likelihood of a prediction, relative to a
        prediction that equals the readings.
        """
        rest = self.values - self.weigh @ predicted_um
        return float(rest @ rest) / self.sigma_um**2


HIDDEN = 1e-9
"""If other tables move the laser in the same way as a table, this share of the table's effect
remains because of rounding.
"""
LEAST_SCATTER_UM = 0.1
"""Least scatter of a laser or an axis. The fit of a few readings can show a smaller scatter by
chance.
"""


def measured(
    values_um: Vector, tables_um: Vector, free: Vector, held: Vector, scatter: Vector
) -> Measured:
    """Return the regression of readings (N,) on tables (N, T). The columns ``free`` may have any
    size. Each of the columns ``held`` (N, H) has a size with the standard deviation 1. The
    covariance of the readings is proportional to ``scatter`` (N, N); the factor is estimated from
    the residuals.
    """
    size_um = 1.0
    # The scatter determines the weight of the held columns, and these columns change the
    # scatter. Two rounds are enough.
    for _ in range(3):
        root = np.linalg.inv(np.linalg.cholesky(scatter + held @ held.T / size_um**2))
        beside = np.linalg.qr(root @ free)[0]
        weigh = root - beside @ (beside.T @ root)
        values, columns = weigh @ values_um, weigh @ tables_um
        spread = np.linalg.pinv(columns.T @ columns)
        factor = spread @ (columns.T @ values)
        rest = values - columns @ factor
        degrees = max(len(values_um) - free.shape[1] - tables_um.shape[1], 1)
        size_um = max(float(np.sqrt(rest @ rest / degrees)), LEAST_SCATTER_UM)
    return Measured(
        factor=factor,
        u=size_um * np.sqrt(np.diag(spread)),
        sigma_um=size_um,
        weigh=weigh,
        values=values,
    )
