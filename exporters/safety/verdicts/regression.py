"""Theory of operation: the test whether a table is right. This decision is made only in this
module.

The movement by the files, by the control's law, is regressed on the result's request, function by
function:

    moved = factor * asked + rest

The factor is 1 for a right table and -1 for a turned sign; if two tables are swapped, the factor
for another function is 1; if the table lies beside the volume, the factor at another place is 1;
any other factor with a small rest means a table of the wrong size. A large rest means a table of
another function or machine, and a movement of zero a missing table. The rest is at right angles to
the request, so a table's residue of an error follows from the two: hypot(1 - factor, rest / asked).

Sizes are rms over points of equal weight with their means taken off: an origin is no error. Three
sizes excuse a difference. ``sure_um`` is the part hidden by rounding and the result's uncertainty.
``unheld_um`` is the part that a table with these points cannot represent. The value ``spike_um`` is
the largest plausible scatter at a single place by these two and a tolerated size.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stepdiag.base.volume import Vector, rms
from stepdiag.exporters.safety.verdicts.verdict import Code

SAME = 0.4
"""Largest residue of an error, as a share, with a right table: the change that another survey of an
ordinary machine finds.
"""
SIZED = 0.15
"""Largest share by which a table may differ in size from the right table: rounding stays below it
in every export.
"""
SHAPED = math.sqrt(1.0 - 0.9**2)
"""Largest share of a movement outside the request's shape that counts as the right table in another
size: a correlation of 0.9, about the residue `SAME` of a table of the right size.
"""
OTHER, EXACT = 0.35, 0.1
"""Largest residue at which another function is named; and the residue of a clear case of another
function or place, which has priority over a size.
"""
SPIKE = 3.0
"""Largest excused difference of a table at a single place, relative to the excused size: about the
largest value of a normal scatter.
"""
SURE_UM = 0.2
"""Movements below this value cannot be separated from rounding and noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """One regression. The size of the request is ``asked_um``; ``size_um`` is the size of the
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
        """Return the size of the movement."""
        return float(np.hypot(self.factor * self.asked_um, self.rest_um))

    def left(self, factor: float = 1.0) -> float:
        """Return the share of the error that would remain if the request times ``factor`` were
        exact.
        """
        left_um = float(np.hypot((self.factor - factor) * self.asked_um, self.rest_um))
        return float(np.maximum(0.0, left_um - self.unheld_um)) / max(
            self.size_um, self.sure_um
        )

    @property
    def left_scaled(self) -> float:
        """Return the share of the movement that no size explains."""
        return self.rest_um / self.moved_um if self.moved_um > 0.0 else 1.0

    @property
    def is_large(self) -> bool:
        """Return whether the error exceeds the part that rounding and uncertainty can hide."""
        return self.size_um > self.sure_um

    @property
    def is_alike(self) -> bool:
        """Return whether the movement corrects the error in its right size, except at one place, or
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
        """Return whether the movement corrects the error everywhere."""
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

    A table that is "unlike" at one place only has a regression, a table of another machine none.
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
    """Return the explanation of a movement by its regressions on its ``own`` function, a regression
    per possible form of the request.

    The regressions ``turned`` are the same with the workpiece turned: they can only show that a
    table is right. ``others`` are regressions on the other functions, ``shifted`` regressions at
    other places; they are computed only on demand.
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
    # the shapes of two slopes differ by rounding alone, so among equals the one with the smallest
    # residual of the table wins
    if sized:
        best = min(sized, key=lambda fit: (round(fit.left_scaled, 3), fit.left()))
        return Explained("scaled", best)
    return Explained("unlike" if own else "beside-volume")


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The regression of a measurement by a laser on the effects of several tables: ``factor`` and
    ``u`` (k = 1) of each, shape (tables,).

    The matrix ``weigh`` (rows, readings) gives readings equal scatter ``sigma_um`` and removes the
    free columns; ``values`` are the weighted measured values.
    """

    factor: Vector
    u: Vector
    sigma_um: float
    weigh: Vector
    values: Vector

    def factor_of(
        self, table_um: Vector, beside_um: Vector, others_um: Sequence[Vector] = ()
    ) -> tuple[float, float]:
        """Return the factor of a table with its u, after ``beside_um`` is subtracted from the
        readings, with other tables of any size; u is infinite where these hide the table.
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
        """Return twice the logarithm by which a prediction of the readings is less likely than a
        perfect one."""
        rest = self.values - self.weigh @ predicted_um
        return float(rest @ rest) / self.sigma_um**2


HIDDEN = 1e-9
"""Share of a table that rounding alone leaves if other tables move the laser in the same way."""
LEAST_SCATTER_UM = 0.1
"""No laser and no axis has a smaller scatter; the fit of a few readings can show a smaller one by
chance.
"""


def measured(
    values_um: Vector, tables_um: Vector, free: Vector, held: Vector, scatter: Vector
) -> Measured:
    """Return the regression of readings (N,) on tables (N, T), with the columns ``free`` beside
    them, and the columns ``held`` (N, H) within a standard deviation of 1 each. The covariance of
    the readings is ``scatter`` (N, N) except for its size, which the residuals show.
    """
    size_um = 1.0
    # the scatter sets how much the held columns count, and they change the scatter: it settles in
    # two rounds
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
