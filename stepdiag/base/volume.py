"""The measured volume, its diagonals and the ordered stops of a pass (contract 1; Wang 2000,
sections II and III.E)."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

MOST_INCREMENTS = 500
"""Largest number of increments of an axis. A survey with this number, out and back along four
diagonals, takes thirteen hours; the solver then needs a minute and 2.4 GB. Both grow with the
second to third power of the number."""
SHORTEST_MACHINE_MM = 10.0

POSITION_TOLERANCE_MM = 0.125
"""Largest distance of a stop from its target: a program with one decimal is wrong by 0.05 mm, and a
G91 program accumulates its rounding. The edge of the box can be wrong by the same amount, so the
distance between a stop and a node can be twice as large. Over this distance an error function
changes only by nanometres."""
SHARE_OF_STEP = 0.25
"""Largest distance of a stop from its target as a share of the increment, so that two targets stay
distinct; the smaller of this and `POSITION_TOLERANCE_MM` is used."""
ROUNDING_MM = 1e-6
"""Distance in mm below which two positions count as equal: no control distinguishes them, and a
slope between them has no meaning."""

BESIDE_EVEN, CLOSEST_MM = 0.3, 1.0
"""Largest shift of an irregular target from its even position, as a share of the distance between
even targets; and the smallest distance of two targets in mm."""

IN_STEP = 0.05
"""Smallest difference between an increment and a whole number of waves, as a share of the
wavelength. With a smaller difference, the targets have nearly the same phase: ten increments do not
cover a full period."""

POINTS = 350
"""Number of points of `anywhere_mm`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Volume:
    """A box that is cut into ``increments`` equal increments per axis.

    An axis without travel has the size 0: the box is then a face or a line.
    """

    origin_mm: tuple[float, float, float]
    size_mm: tuple[float, float, float]
    increments: int

    @property
    def step_mm(self) -> Vector:
        return np.asarray(self.size_mm, dtype=np.float64) / self.increments

    @property
    def length_mm(self) -> Vector:
        """Return the size of each axis as a divisor, shape (3,): 1 mm for an axis without
        travel."""
        size = np.asarray(self.size_mm, dtype=np.float64)
        return np.where(size > 0, size, 1.0)

    @property
    def travelled(self) -> tuple[bool, bool, bool]:
        x, y, z = self.size_mm
        return x > 0, y > 0, z > 0

    @property
    def solid(self) -> bool:
        """Return whether the survey travelled along all three axes."""
        return all(self.travelled)

    @property
    def tolerance_mm(self) -> Vector:
        """Return, for each axis, the largest distance of a stop from its target, shape (3,)."""
        return position_tolerance_mm(self.step_mm)

    def nodes_mm(self, axis: int) -> Vector:
        """Return the target positions of one axis (0, 1, 2), ascending, shape (increments + 1,)."""
        low = self.origin_mm[axis]
        return low + self.size_mm[axis] * np.arange(self.increments + 1) / self.increments

    def even_mm(self, axis: int, count: int) -> Vector:
        """Return even positions from end to end of an axis (0, 1, 2), ascending, shape (count,)."""
        even: Vector = self.origin_mm[axis] + self.size_mm[axis] * np.linspace(
            0.0, 1.0, count
        )
        return even


def position_tolerance_mm(step_mm: Vector) -> Vector:
    """Return the largest distance of a stop from its target, shape (k,), for targets that are
    ``step_mm`` apart; 0 for an axis with one target."""
    tolerance: Vector = (
        np.minimum(
            POSITION_TOLERANCE_MM, np.where(step_mm > 0, SHARE_OF_STEP * step_mm, np.inf)
        )
        + ROUNDING_MM
    )
    return tolerance


def reads_like_metres(size_mm: Iterable[float]) -> bool:
    """Return whether all lengths are below a centimetre, so that their unit must be metres."""
    return max(size_mm) < SHORTEST_MACHINE_MM


def travel_signs(diagonal: str) -> NDArray[np.int64]:
    """Return the direction of travel of the outward pass for ``ppp`` .. ``ppn``: +1 or -1 per axis,
    shape (3,)."""
    return np.array([1 if letter == "p" else -1 for letter in diagonal], dtype=np.int64)


def diagonal_direction(volume: Volume, diagonal: str) -> Vector:
    """Return the unit vector of travel along a body diagonal, shape (3,) (Wang 2000, Eq. 3)."""
    travel = travel_signs(diagonal) * np.asarray(volume.size_mm, dtype=np.float64)
    unit: Vector = travel / np.linalg.norm(travel)
    return unit


def nodes_to_mm(volume: Volume, nodes: NDArray[np.int64]) -> Vector:
    positions: Vector = (
        np.asarray(volume.origin_mm)
        + np.asarray(volume.size_mm, dtype=np.float64) * nodes / volume.increments
    )
    return positions


def irregular_mm(volume: Volume, axis: int, count: int) -> Vector:
    """Return about ``count`` targets along an axis, ascending: the nodes, and between them
    irregular places that are not in phase with a periodic error.

    ISO 230-2 requires P_i = (i - 1) p + r with another r at each target. Here r is a fraction of p
    within `BESIDE_EVEN` from the multiples of the golden ratio, so every program of a survey has
    the same targets. The targets are whole hundredths of a millimetre, not closer than
    `CLOSEST_MM`.
    """
    nodes, step_mm = volume.nodes_mm(axis), float(volume.step_mm[axis])
    parts = max(min(round(count / volume.increments), int(step_mm / CLOSEST_MM)), 1)
    number = np.arange(volume.increments * parts)
    beside = BESIDE_EVEN * (2.0 * np.mod(number * (np.sqrt(5.0) - 1.0) / 2.0, 1.0) - 1.0)
    inner = number % parts != 0
    between = volume.origin_mm[axis] + (number + beside)[inner] * step_mm / parts
    targets: Vector = np.sort(np.concatenate([nodes, np.round(between, 2)]))
    return targets


def in_step(step_mm: float, pitch_mm: float) -> bool:
    """Return whether the targets have the same phase, within a twentieth, in a wave of a whole or
    half pitch."""
    turns = [step_mm / length_mm for length_mm in (pitch_mm, pitch_mm / 2.0)]
    return any(round(turn) >= 1 and abs(turn - round(turn)) <= IN_STEP for turn in turns)


def anywhere_mm(volume: Volume) -> Vector:
    """Return `POINTS` places of the tool, spread evenly over the volume and not in phase with the
    targets, shape (points, 3).

    The places are a Kronecker sequence with the powers of the root of x^4 = x + 1 (Roberts 2018).
    """
    share = np.mod(
        0.5 + np.outer(np.arange(1, POINTS + 1), 1.2207440846057596 ** -np.arange(1.0, 4.0)),
        1.0,
    )
    points: Vector = np.asarray(volume.origin_mm) + share * np.asarray(volume.size_mm)
    return points


def grid_points_mm(volume: Volume, nodes: int) -> Vector:
    """Return a regular grid over the volume with ``nodes`` points along each axis, the index of Z
    changing fastest, shape (nodes ** 3, 3)."""
    axes = [volume.even_mm(axis, nodes) for axis in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def rms(values: Vector) -> float:
    """Return the root mean square of all values; 0 for an empty array."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
