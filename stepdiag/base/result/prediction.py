"""The expected volumetric errors before and after compensation: root mean square and largest error,
as intervals.

Machines are drawn from the posterior of the result and measured at points of the volume, as in an
independent check. The interval covers 97 % of the drawn machines: `TAIL` is the share above its
upper end (k = 2), `BELOW` the smaller share below its lower end. All commands, the report and the
page use the same draws.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from stepdiag.base.result.arches import Between, arches_of
from stepdiag.base.result.field import (
    Smoothed,
    Tabulated,
    bend_um,
    error_field_um,
    field_of_um,
    rigid_motions,
)
from stepdiag.base.result.interval import FieldFigures, Interval, Predicted, When
from stepdiag.base.result.posterior import Posterior
from stepdiag.base.result.result import DISPLACEMENTS, SQUARENESS, Result
from stepdiag.base.volume import Vector

DRAWS, FOR_LARGEST = 2000, 250
VOLUMETRIC_RMS, VOLUMETRIC_LARGEST = "volumetric_rms_um", "volumetric_largest_um"
"""Names of the tolerances of the root mean square and of the largest error (`Result.tolerance`)."""
TAIL = 0.02275
"""Probability of a normal value beyond k = 2 on one side."""
BELOW = 0.005
"""Probability below the lower end of the interval of the volume. This probability is smaller than
`TAIL`, because assumed errors (drift, warmth, air) are drawn even if the machine does not have
these errors. With k = 2 on both sides, one in eight good machines was below the interval."""
BETWEEN_SHARE = 8.0 / 15.0
"""Mean square of an arch (a parabola between two targets), divided by the square of its height."""


def predicted(
    result: Result, points_mm: Vector, correction_um: Vector, beside_um: Vector | float = 0.0
) -> Predicted:
    """Return the expected result of an independent check at points (N, 3), before and after
    ``correction_um`` (N, 3) is applied.

    ``beside_um`` (N, 3) is a known error during the measurement that the result does not contain,
    such as steps between the targets.
    """
    motions = rigid_motions(result.volume, points_mm)
    return _predicted(
        _machines(result, points_mm, beside_um, DRAWS),
        motions,
        correction_um,
        result.tolerance or {},
    )


def predicted_with_u(
    result: Result, posterior: Posterior, points_mm: Vector, correction_um: Vector
) -> tuple[Predicted, float]:
    """Return the prediction of `predicted`, and the root mean square over the volume of the
    standard uncertainty of the error vector, rigid motion removed. ``posterior`` is that of the
    result."""
    machines, motions = (
        _machines(result, points_mm, 0.0, DRAWS),
        rigid_motions(result.volume, points_mm),
    )
    return _predicted(
        machines, motions, correction_um, result.tolerance or {}
    ), _volumetric_u_um(posterior, machines.moved, motions)


def _predicted(
    machines: "_Machines",
    motions: Vector,
    correction_um: Vector,
    tolerance: Mapping[str, float],
) -> Predicted:
    moved_um2, rigid_um2 = machines.moved_um2(motions)
    waves_um, every_um = machines.between.drawn_um(FOR_LARGEST), machines.every_um()
    parts: dict[str, dict[When, FieldFigures]] = {}
    none: Mapping[str, float] = {}
    for name, free, square_um2, allowed in (
        ("as_it_is", None, moved_um2, none),
        ("without_rigid_motion", motions, moved_um2 - rigid_um2, tolerance),
    ):
        fields = machines.drawn(correction_um, free)
        # the uncertainty is equal before and after: only the drawn fields differ
        beside_um = _flat(every_um, free).reshape(every_um.shape)
        if waves_um is not None:
            beside_um = beside_um + waves_um
        parts[name] = {
            when: machines.figures(drawn, square_um2, beside_um, allowed)
            for when, drawn in fields.items()
        }
    return Predicted(**parts)


def interval_of(drawn: Vector, known: bool, most: float | None = None) -> Interval:
    """Return the median of draws, and the interval with the share `BELOW` of the draws below it and
    `TAIL` above it.

    With a tolerance ``most``, ``Interval.within`` is the share of draws that do not exceed the
    tolerance.
    """
    low, value, high = (float(end) for end in np.quantile(drawn, (BELOW, 0.5, 1.0 - TAIL)))
    if not known:
        return Interval(value_um=value)
    return Interval(
        value_um=value,
        low_um=low,
        high_um=high,
        within=None if most is None else float(np.mean(drawn <= most)),
    )


class ErrorAt(NamedTuple):
    """The error vector (actual - commanded) at points and its combined standard uncertainty, shapes
    (N, 3) in um, relative to the low corner of the volume. ``u_um`` is None for a result without a
    posterior."""

    error_um: Vector
    u_um: Vector | None


def errors_at(result: Result, points_mm: Vector) -> ErrorAt:
    """Return the error of the tool at points (N, 3), rigid motion not removed.

    ``u_um`` is the root mean square of all deviations in the posterior: offset, modes, independent
    values, and deviations between two targets.
    """
    error_um = error_field_um(result, points_mm)
    if result.posterior is None:
        return ErrorAt(error_um, None)
    amount = result.posterior.drawn(DRAWS)
    moved = _moved(result, result.posterior, points_mm)
    together = _together(amount)
    square_um2 = moved[0] ** 2 + np.einsum(
        "kl,kni,lni->ni", together, moved[1:], moved[1:], optimize=True
    )
    beside_um2 = np.mean(
        arches_of(result, points_mm, FOR_LARGEST).square_um(slice(None)), axis=0
    )
    return ErrorAt(error_um, np.sqrt(np.maximum(square_um2 + beside_um2, 0.0)))


def squares_um2(
    result: Result, points_mm: Vector, correction_um: Vector, beside_um: Vector | float = 0.0
) -> tuple[Vector, Vector]:
    """Return the squared length of the error vector at the points for each of `FOR_LARGEST` draws,
    rigid motion removed, before and after a correction, shapes (draws, N). Arguments as in
    `predicted`. A result without a posterior gives a single draw."""
    machines = _machines(result, points_mm, beside_um, FOR_LARGEST)
    drawn = machines.drawn(correction_um, rigid_motions(result.volume, points_mm))
    before, after = (
        machines.squares_um2(drawn["before"]),
        machines.squares_um2(drawn["after"]),
    )
    return before, after


class _Drawn(NamedTuple):
    """The error fields of drawn machines. ``whole`` (deviations, 3 N) is multiplied by the amounts
    of each machine. ``likely`` (3 N,) is the mean field of the draws without the noise of the
    estimate. ``over_um2`` (draws,) is the amount by which the square sum of a drawn field over all
    points is too large."""

    whole: Vector
    likely: Vector
    over_um2: Vector


class _Machines(NamedTuple):
    """Drawn machines. ``before``: the estimated error field at the points. ``moved``: the effect of
    each deviation of the posterior. ``amount`` (draws, deviations): the drawn amounts. ``between``:
    the deviations between the targets. ``noise``: the part of the field that is noise of the
    estimate (`_adjusted_um`). ``common_um2`` and ``bent_um2``: the covariances of this noise
    (`_common_um2`), rigid motion not removed."""

    before: Vector
    moved: Vector
    amount: Vector
    between: Between
    noise: Vector
    bent: Vector
    together: Vector
    common_um2: float
    bent_um2: float
    known: bool

    def drawn(self, correction_um: Vector, motions: Vector | None) -> dict[When, _Drawn]:
        """Return the drawn error fields before and after a correction (N, 3); with the basis
        ``motions``, their rigid motion is removed."""
        flat, found = _flat(self.moved, motions), _flat(self.before[None], motions)
        square_um2 = max(float(np.sum(found**2)), 1e-30)
        common_um2, bent_um2 = self._shared_um2(motions)
        met = self.between.met(flat[1:])
        fields: dict[When, _Drawn] = {}
        changes: dict[When, Vector] = {
            "before": np.zeros_like(found),
            "after": _flat(correction_um[None], motions),
        }
        for when, change in changes.items():
            field = found + change
            # tables remove the estimated error and the noise in it, so ``common_um2`` decreases
            # with the correction; the noise of the curve between the values (``bent_um2``) stays in
            # both fields
            over_um2 = common_um2 * float(
                np.clip(np.sum(found * field) / square_um2, 0.0, 1.0)
            )
            whole = np.vstack([field + flat[:1], flat[1:]])
            likely = (field - min(over_um2 / square_um2, 1.0) * found + flat[:1])[0]
            across_um2 = self.between.across_um2(met + self.between.met(whole[:1]))
            fields[when] = _Drawn(whole, likely, 2.0 * over_um2 + bent_um2 - across_um2)
        return fields

    def _shared_um2(self, motions: Vector | None) -> tuple[float, float]:
        """Return two sums over the points: the covariance of the complete error with the noise of
        the estimate, and the variance of the part between the targets by the smooth curve."""
        moved, noise, bent = (
            _flat(each, None) for each in (self.moved, self.noise, self.bent)
        )
        both = [(moved, noise, self.common_um2), (bent, bent, self.bent_um2)]
        common, bending = (
            whole
            if motions is None
            else whole - _common_um2(one @ motions, other @ motions, self.together)
            for one, other, whole in both
        )
        return max(common, 0.0), max(bending, 0.0)

    def moved_um2(self, motions: Vector) -> tuple[Vector, Vector]:
        """Return, for all deviations but the offset, the square sum of their effect over all
        points, (draws,), and the square sum of the rigid motions in this effect, (draws,).

        A correction changes neither of the two sums.
        """
        flat, amount = _flat(self.moved, None)[1:], self.amount[:, 1:]
        return np.sum((amount @ (flat @ flat.T)) * amount, axis=1), np.sum(
            (amount @ (flat @ motions)) ** 2, axis=1
        )

    def every_um(self) -> Vector:
        """Return the effect of all deviations but the offset in `FOR_LARGEST` draws, rigid motion
        not removed, shape (draws, N, 3)."""
        amount, flat = self.amount[:FOR_LARGEST, 1:], _flat(self.moved, None)[1:]
        every: Vector = (amount @ flat).reshape(len(amount), *self.moved.shape[1:])
        return every

    def figures(
        self,
        drawn: _Drawn,
        moved_um2: Vector,
        beside_um: Vector,
        tolerance: Mapping[str, float],
    ) -> FieldFigures:
        """Return the values of the whole volume. ``moved_um2`` (draws,) is the square sum of the
        effect of all deviations but the offset. ``beside_um`` (draws, N, 3) is this effect plus the
        drawn deviations between the targets (`Between.drawn_um`)."""
        rms_um = _rms_um(drawn, self.amount, self.between, moved_um2)
        largest_um = _largest_um(drawn.likely, beside_um)
        return FieldFigures(
            rms_um=interval_of(rms_um, self.known, tolerance.get(VOLUMETRIC_RMS)),
            largest_um=interval_of(largest_um, self.known, tolerance.get(VOLUMETRIC_LARGEST)),
        )

    def squares_um2(self, drawn: _Drawn) -> Vector:
        """Return the squared length of the error vector at each point, shape (draws, N); its mean
        over all points agrees with `figures`.

        The correction for noise and for the arches between the targets is known only for the whole
        volume. Each point gets a part of this correction in proportion to its squared error.
        """
        fields = (self.amount @ drawn.whole).reshape(len(self.amount), -1, 3)
        square: Vector = np.sum(fields**2 + self.between.square_um(slice(None)), axis=2)
        total = np.sum(square, axis=1, keepdims=True)
        cleared: Vector = square * np.maximum(
            1.0 - drawn.over_um2[:, None] / np.maximum(total, 1e-30), 0.0
        )
        return cleared


def _machines(
    result: Result, points_mm: Vector, beside_um: Vector | float, draws: int
) -> _Machines:
    posterior = result.posterior
    before = error_field_um(result, points_mm) + beside_um
    if posterior is not None:
        before = before + bend_um(result, points_mm)
    amount = np.ones((1, 1)) if posterior is None else posterior.drawn(draws)
    arches = arches_of(result, points_mm, len(amount))
    moved, together = _moved(result, posterior, points_mm), _together(amount)
    noise, bent = _adjusted_um(result, posterior, points_mm)
    of_moved, of_noise, of_bent = (_flat(each, None) for each in (moved, noise, bent))
    return _Machines(
        before,
        moved,
        amount,
        arches,
        noise,
        bent,
        together,
        _common_um2(of_moved, of_noise, together),
        _common_um2(of_bent, of_bent, together),
        posterior is not None,
    )


def _moved(result: Result, posterior: Posterior | None, points_mm: Vector) -> Vector:
    """Return the effect of each deviation of the posterior on the error at the points, shape
    (deviations, N, 3), the offset first."""
    if posterior is None:
        return np.zeros((1, len(points_mm), 3))
    deviations = posterior.deviations()
    functions = {
        name: Tabulated(posterior.position_mm[name[2]], value)
        for name, value in deviations.items()
        if name[0] == "E"
    }
    squareness = {name: value[:, 0] for name, value in deviations.items() if name[0] != "E"}
    return field_of_um(result.volume, result.chain, functions, squareness, points_mm)


def _adjusted_um(
    result: Result, posterior: Posterior | None, points_mm: Vector
) -> tuple[Vector, Vector]:
    """Return the part of `_moved` (deviations, N, 3) that is an error of quantities determined by
    the readings without a prior.

    Angular functions, which are expected or given values, and unidentified quantities are left out.
    """
    none = np.zeros((1, len(points_mm), 3))
    if posterior is None:
        return none, none
    deviations, found = posterior.deviations(), {}
    for name in (name for name in DISPLACEMENTS if name in deviations):
        function = result.errors.get(name)
        if function is None or function.value is None:
            continue
        at, values = posterior.position_mm[name[2]], deviations[name]
        if not function.slope_identified:
            values = values - values[:, -1:] * (at - at[0]) / (at[-1] - at[0])
        found[name] = (at, values)
    squareness = {
        name: deviations[name][:, 0]
        for name in SQUARENESS
        if name in deviations and result.squareness[name].value is not None
    }
    if not found and not squareness:
        return none, none
    straight, smooth = (
        field_of_um(
            result.volume,
            result.chain,
            {name: between(*one) for name, one in found.items()},
            squareness,
            points_mm,
        )
        for between in (Tabulated, Smoothed)
    )
    return straight, smooth - straight


def _together(amount: Vector) -> Vector:
    drawn = amount[:, 1:] - np.mean(amount[:, 1:], axis=0)
    found: Vector = drawn.T @ drawn / len(drawn)
    return found


def _common_um2(moved: Vector, noise: Vector, together: Vector) -> float:
    """Return the covariance, summed over the points, of the complete error and of the error
    determined without a prior.

    The estimate contains the noise, and each draw around the estimate contains noise again. The
    square sum of the machine is therefore smaller than that of the draws by twice this covariance
    (the bias of Stein 1956). ``noise`` and ``moved`` are rows of deviations, ``together`` is the
    covariance of their amounts.
    """
    return float(np.sum((together @ noise[1:]) * moved[1:])) if len(noise) > 1 else 0.0


def _flat(fields_um: Vector, motions: Vector | None) -> Vector:
    """Return fields (k, N, 3) as rows (k, 3 N); with the basis ``motions``, their rigid motion is
    removed."""
    flat = fields_um.reshape(len(fields_um), -1)
    return flat if motions is None else flat - (flat @ motions) @ motions.T


def _rms_um(drawn: _Drawn, amount: Vector, between: Between, moved_um2: Vector) -> Vector:
    """Return the root mean square of the error vector of every draw, shape (draws,), as a quadratic
    form of the amounts.

    ``moved_um2`` (draws,) is the part of second order in the amounts, computed once for all fields.
    The mean square of the deviations between the targets is added.
    """
    centre, moved = drawn.whole[0], drawn.whole[1:]
    square = moved_um2 + 2.0 * (amount[:, 1:] @ (moved @ centre)) + centre @ centre
    square = square + between.size_um**2 @ np.sum(between.arch**2, axis=1)
    found: Vector = np.sqrt(np.maximum(square - drawn.over_um2, 0.0) / (len(centre) // 3))
    return found


def _largest_um(likely_um: Vector, beside_um: Vector) -> Vector:
    drawn = beside_um + likely_um.reshape(-1, 3)
    drawn *= drawn
    largest: Vector = np.sqrt(
        np.max(drawn[:, :, 0] + drawn[:, :, 1] + drawn[:, :, 2], axis=1)
    )
    return largest


def _volumetric_u_um(posterior: Posterior, fields_um: Vector, motions: Vector) -> float:
    """Return the uncertainty of `predicted_with_u` from the effect of each deviation on the error
    at the points, (deviations, N, 3)."""
    moved = _flat(fields_um, motions)
    between = sum(float(np.mean(sizes**2)) for sizes in posterior.between_um.values())
    sized = posterior.sized
    own = moved[1 + posterior.count - sized.scale.shape[1] : 1 + posterior.count]
    # the shifts of the modes of unknown size are not independent: their common effect replaces the
    # sum of their single effects
    together = np.sum((sized.shift @ own) ** 2) / len(sized.shift) - np.sum(
        np.mean(sized.shift**2, axis=0) @ own**2
    )
    return float(
        np.sqrt(
            (np.sum(moved[1:] ** 2) + together) / fields_um.shape[1] + BETWEEN_SHARE * between
        )
    )
