"""Theory of operation: is this table right? The only place of this decision.

The movement by the files, by the control's law, is regressed on the result's request, function by
function:

    moved = factor * asked + rest

The factor is 1 for a right table and -1 for a turned sign; it is 1 for another function if two
tables are swapped, and at another place if the table lies beside the volume; any other factor with
a small rest is a table of the wrong size. A large rest is a table of something else, and a movement
of nothing a missing table. The rest is at right angles to the request, so a table's residue of an
error follows from the two: hypot(1 - factor, rest / asked).

Sizes are rms over points of equal weight with their means taken off: an origin is no error. Three
sizes excuse a difference. ``sure_um`` is the part hidden by rounding and the result's uncertainty.
``unheld_um`` is the part that the points of the table cannot hold. ``spike_um`` is the largest
plausible scatter at a single place by these two and a tolerated size.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from stepdiag.base.volume import Vector, rms

SAME = 0.4
"""Largest residue of an error, as a share, under a right table: the change found by another survey
of an ordinary machine.
"""
SIZED = 0.15
"""Largest share by which a table may differ in size from the right table: rounding stays below it
in every export.
"""
ALIKE = 0.9
"""Correlation from which a table counts as the right table in another size: the residue `SAME` of a
table of the right size.
"""
OTHER, EXACT = 0.35, 0.1
"""Largest residue of another function for its name; and the residue of a clear case of another
function or place, which goes before a size.
"""
SPIKE = 3.0
"""Largest excused difference of a table at a single place over the excused size: about the largest
of a normal scatter.
"""
SURE_UM = 0.2
"""Movements below this are not separated from rounding and noise."""

Cause = Literal["right", "missing", "sign-turned", "other", "beside", "scaled", "spike", "unlike"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """One regression. ``asked_um`` is the size of what was asked for, ``size_um`` that of the
    error, which a share is a share of."""

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

    @property
    def alike(self) -> float:
        """Return the correlation of movement and what was asked for."""
        return self.factor * self.asked_um / self.moved_um if self.moved_um > 0.0 else 0.0

    def left(self, factor: float = 1.0) -> float:
        """Return the share of the error that is left where ``factor`` times what is asked for would
        leave nothing."""
        left_um = float(np.hypot((self.factor - factor) * self.asked_um, self.rest_um))
        return float(np.maximum(0.0, left_um - self.unheld_um)) / max(self.size_um, self.sure_um)

    @property
    def left_scaled(self) -> float:
        """Return the share of the movement that no size explains."""
        return float(np.sqrt(max(0.0, 1.0 - self.alike**2)))

    @property
    def is_large(self) -> bool:
        """Return whether the error is more than what rounding and uncertainty hide."""
        return self.size_um > self.sure_um

    @property
    def is_alike(self) -> bool:
        """Return whether the movement corrects the error in its right size, one place aside, or
        both are too small to separate."""
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


def regress(
    moved_um: Vector,
    asked_um: Vector,
    *,
    size_um: float | None = None,
    sure_um: float = SURE_UM,
    unheld_um: float = 0.0,
    spike_um: float = np.inf,
) -> Fit:
    """Return the regression of a movement on the request, arrays of the same shape; ``size_um`` is
    the size of ``asked_um`` if given.
    """
    own = rms(asked_um)
    factor = float(np.mean(moved_um * asked_um)) / own**2 if own > 0.0 else 0.0
    rest = moved_um - factor * asked_um
    index = int(np.argmax(np.abs(rest)))
    return Fit(
        factor=factor,
        asked_um=own,
        size_um=own if size_um is None else size_um,
        rest_um=rms(rest),
        largest_um=float(np.abs(rest).flat[index]),
        largest_index=index,
        sure_um=sure_um,
        unheld_um=unheld_um,
        spike_um=spike_um,
    )


class Explained(NamedTuple):
    """Explanation of a movement: the cause, its regression, and the other function or place."""

    cause: Cause
    fit: Fit | None = None
    other: str = ""
    shift_mm: float = 0.0


def explain(
    own: Sequence[Fit],
    turned: Sequence[Fit] = (),
    others: Iterable[tuple[str, Fit]] = (),
    shifted: Iterable[tuple[float, Fit]] = (),
) -> Explained:
    """Return the explanation of a movement by its regressions on its ``own`` function, a regression
    per possible form of the request.

    ``turned`` are the same with the workpiece turned: they show what is right and explain nothing
    else. ``others`` are regressions on the other functions, ``shifted`` regressions at other
    places; they are computed only on demand.
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
        return Explained("spike" if fit.is_alike else "scaled", fit)
    unscaled = min((fit.left_scaled for fit in own), default=1.0)
    for name, fit in others:
        if fit.size_um >= 2.0 * fit.sure_um and min(fit.left(), fit.left(-1.0)) <= min(
            OTHER, max(EXACT, unscaled)
        ):
            return Explained("other", fit, other=name)
    elsewhere = [
        (shift, fit)
        for shift, fit in shifted
        if fit.left() <= min(OTHER, unscaled) and fit.is_large
    ]
    if elsewhere:
        shift, fit = min(elsewhere, key=lambda each: each[1].left())
        return Explained("beside", fit, shift_mm=shift)
    sized = [fit for fit in own if abs(fit.alike) >= ALIKE and fit.is_large]
    # two slopes are alike to rounding, whatever their sizes: then the one that the table misses
    # least
    if sized:
        return Explained(
            "scaled", max(sized, key=lambda fit: (round(abs(fit.alike), 6), -fit.left()))
        )
    return Explained("unlike", min(own, key=lambda fit: fit.rest_um, default=None))


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The regression of what a laser measured on what several tables do: ``factor`` and ``u`` (k =
    1) of each, shape (tables,).

    ``weigh`` (rows, readings) brings readings to equal scatter ``sigma_um`` and takes out what is
    free beside the tables; ``values`` are the measured ones so weighed.
    """

    factor: Vector
    u: Vector
    sigma_um: float
    weigh: Vector
    values: Vector

    def factor_of(
        self, table_um: Vector, beside_um: Vector, others_um: Sequence[Vector] = ()
    ) -> tuple[float, float]:
        """Return the factor of a table with its u, after ``beside_um`` is taken off the readings,
        and beside others of any size; u is infinite where these hide it."""
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
"""Share of a table that rounding alone leaves beside others that move the laser as it does."""
LEAST_SCATTER_UM = 0.1
"""No laser and no axis scatters by less; a fit of few readings can seem to."""


def measured(
    values_um: Vector, tables_um: Vector, free: Vector, held: Vector, scatter: Vector
) -> Measured:
    """Return the regression of readings (N,) on tables (N, T), with the columns ``free`` beside
    them, and the columns ``held`` (N, H) within a standard deviation of 1 each. ``scatter`` (N, N)
    is the covariance of the readings except for its size, which the rest shows.
    """
    size_um = 1.0
    for _ in range(
        3
        # the scatter sets how much the held columns count, and they change the scatter: it settles
        # in two rounds
    ):
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
