"""Stability and comparison tests of the 4-DOF head (Feng 2008, sections 3.1 and 3.3)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.solver.standards.straightness import LineMethod, residuals_um

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stability:
    """Fluctuation of a quantity at standstill, raw and compensated, in its unit.

    ``removed_percent`` is the part of the raw fluctuation (largest minus smallest value) that the
    compensation removed; it is negative if the fluctuation increased. ``raw_allan`` and
    ``compensated_allan`` are the Allan deviations for the averaging times ``tau_s``.
    """

    raw_fluctuation: float
    compensated_fluctuation: float
    removed_percent: float
    raw_s: float
    compensated_s: float
    tau_s: Vector
    raw_allan: Vector
    compensated_allan: Vector


def stability(raw: Vector, compensated: Vector, interval_s: float) -> Stability:
    """Return the stability of two equally spaced series (N,) of one quantity."""
    if len(raw) != len(compensated) or len(raw) < 3:
        raise DataError(
            "stability",
            expected=message("two-series-3-samples"),
            found=message("raw-and-compensated", raw=len(raw), compensated=len(compensated)),
        )
    before, after = float(np.ptp(raw)), float(np.ptp(compensated))
    tau_s, raw_allan = allan_deviation(raw, interval_s)
    return Stability(
        raw_fluctuation=before,
        compensated_fluctuation=after,
        removed_percent=100 * (1 - after / before) if before > 0 else 0.0,
        raw_s=float(raw.std(ddof=1)),
        compensated_s=float(compensated.std(ddof=1)),
        tau_s=tau_s,
        raw_allan=raw_allan,
        compensated_allan=allan_deviation(compensated, interval_s)[1],
    )


def allan_deviation(values: Vector, interval_s: float) -> tuple[Vector, Vector]:
    """Return averaging times (octaves) and the overlapping Allan deviation of equally spaced
    readings.

    The Allan variance is half the mean square of the differences of neighbouring averages (NIST SP
    1065, 5.2.4).
    """
    sums = np.concatenate([[0.0], np.cumsum(values - np.mean(values))])
    lengths = [
        1 << octave
        for octave in range(len(values).bit_length())
        if 2 << octave <= len(values)
    ]
    deviation = []
    for length in lengths:
        averages = (sums[length:] - sums[:-length]) / length
        steps = averages[length:] - averages[:-length]
        deviation.append(np.sqrt(np.mean(steps**2) / 2))
    return interval_s * np.array(lengths, dtype=np.float64), np.array(deviation)


@dataclass(frozen=True, slots=True, kw_only=True)
class Arm:
    """The arm from the first head to the second, x, y, z in mm (3,), with standard uncertainties. A
    component is NaN if no known rotation determines it.

    ``residual_um`` contains the residuals of the fit for each straightness function.
    """

    mm: Vector
    u_mm: Vector
    residual_um: dict[str, Vector]

    def rms_um(self, name: str) -> float:
        return float(np.sqrt(np.mean(self.residual_um[name] ** 2)))

    def as_json(self) -> dict[str, object]:
        """Return the arm as JSON values, with null for a component that is not determined."""
        mm, u_mm = (
            [value if np.isfinite(value) else None for value in each.tolist()]
            for each in (self.mm, self.u_mm)
        )
        return {
            "mm": mm,
            "u_mm": u_mm,
            "rms_um": {name: self.rms_um(name) for name in self.residual_um},
        }


def abbe_arm(
    position_mm: Vector, apart_um: Mapping[str, Vector], turning_urad: Mapping[str, Vector]
) -> Arm | None:
    """Return the arm between two heads on an axis from the differences of their straightness
    functions, or None if the differences do not determine the arm.

    A carriage that turns by ``a`` moves a point at ``r`` by ``a x r``. Both functions (EYX, EZX ..)
    are fitted by least squares to the known rotations at the same positions (EAX .., shapes (N,)),
    each with its own straight line. The uncertainties are computed from the residuals.
    """
    blocks = []
    for number, name in enumerate(apart_um):
        component = "XYZ".index(name[1])
        block = np.zeros((len(position_mm), 3 + 2 * len(apart_um)))
        for by, of, sign in (
            ((component + 1) % 3, (component + 2) % 3, 1.0),
            ((component + 2) % 3, (component + 1) % 3, -1.0),
        ):
            block[:, of] += (
                sign
                * 1e-3
                * turning_urad.get(f"E{'ABC'[by]}{name[2]}", np.zeros(len(position_mm)))
            )
        block[:, 3 + 2 * number] = 1.0
        block[:, 4 + 2 * number] = (position_mm - position_mm.mean()) / np.ptp(position_mm)
        blocks.append(block)
    rows, target = np.vstack(blocks), np.concatenate(list(apart_um.values()))
    seen = np.flatnonzero(np.linalg.norm(rows, axis=0) > 0.0)
    freedom = len(target) - len(seen)
    if freedom < 2 or seen[0] > 2 or np.linalg.matrix_rank(rows[:, seen]) < len(seen):
        return None
    inverse = np.linalg.pinv(rows[:, seen])
    found = inverse @ target
    left = target - rows[:, seen] @ found
    u = np.sqrt(float(left @ left) / freedom * np.sum(inverse**2, axis=1))
    arm = seen < 3
    mm, u_mm = np.full(3, np.nan), np.full(3, np.nan)
    mm[seen[arm]], u_mm[seen[arm]] = found[arm], u[arm]
    return Arm(
        mm=mm,
        u_mm=u_mm,
        residual_um=dict(zip(apart_um, np.split(left, len(apart_um)), strict=True)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Differences of a quantity from a reference instrument at the measured positions, in its
    unit."""

    position_mm: Vector
    residual: Vector
    lowest: float
    highest: float
    rms: float


def compare(
    position_mm: ArrayLike,
    measured: ArrayLike,
    reference_mm: ArrayLike,
    reference: ArrayLike,
    line: LineMethod | None = None,
) -> Comparison:
    """Return the measured values minus the reference, which is interpolated linearly.

    With ``line`` (straightness) the reference line of each series is subtracted; without ``line``
    (angles) the value at the first common position is subtracted. Only positions within the range
    of the reference are used. Raises DataError for fewer than two such positions.
    """
    position, ours = (
        np.asarray(position_mm, dtype=np.float64),
        np.asarray(measured, dtype=np.float64),
    )
    order = np.argsort(np.asarray(reference_mm, dtype=np.float64))
    known = np.asarray(reference_mm, dtype=np.float64)[order]
    low, high = (known[0], known[-1]) if len(known) else (0.0, 0.0)
    covered = (position >= low) & (position <= high)
    count = len(np.unique(position[covered])) if len(known) else 0
    if count < 2:
        raise DataError(
            "comparison",
            expected=message("two-positions-more-within", low=low, high=high),
            found=str(count),
        )
    position, ours = position[covered], ours[covered]
    theirs = np.interp(position, known, np.asarray(reference, dtype=np.float64)[order])
    if line is None:
        residual = ours - ours[0] - (theirs - theirs[0])
    else:
        residual = residuals_um(position, ours, line) - residuals_um(position, theirs, line)
    return Comparison(
        position_mm=position,
        residual=residual,
        lowest=float(residual.min()),
        highest=float(residual.max()),
        rms=float(np.sqrt(np.mean(residual**2))),
    )
