"""Arrivals of the axes at the stops of a pass: their side and their errors.

An axis that does not move keeps its place. Each move of an axis draws an error of arrival along
this axis, and all stops see the error until the axis moves again. The error moves the tool; a laser
sees its component along the beam.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag.virtual.drive.sequence import DrivenPass
from stepdiag.virtual.physics.error_functions import Array

Three = tuple[float, float, float]
_MOVED_MM = 1e-9
"""A smaller change of a commanded position is rounding and no move."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """Standard deviations for each axis in um: ``arrival_um`` beyond the encoder, ``servo_um``
    within it (position error at standstill)."""

    arrival_um: Three = (0.0, 0.0, 0.0)
    servo_um: Three = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Standing:
    """State of the axes at a stand, all (3,): the commanded position, the sign of each axis' last
    movement, and the errors of the arrival in um.
    """

    position_mm: Array
    side: Array
    arrival_um: Array
    servo_um: Array


@dataclass(frozen=True, slots=True)
class Arrivals:
    """The axes at every stop of a pass, all (M, 3): sides of approach and errors of the arrival in
    um."""

    side: Array
    arrival_um: Array
    servo_um: Array

    @property
    def off_mm(self) -> Array:
        """Return how far the axes stand beside the commanded positions, shape (M, 3)."""
        off: Array = 1e-3 * (self.arrival_um + self.servo_um)
        return off


def arrivals(
    driven: DrivenPass,
    scatter: Scatter,
    rng: np.random.Generator,
    *,
    before: Standing | None = None,
    overrun: bool = True,
) -> Arrivals:
    """Return how the axes come to the stops of a pass.

    ``before`` is where they stood when the pass began (None: somewhere else). With ``overrun``
    every axis of the pass comes to the first stop in the direction of the pass, else on the
    straight way from ``before``: an axis that stands there already does not move.
    """
    moves = np.diff(driven.stop_mm, axis=0)
    begins = (
        driven.approach if before is None else _first_move(driven, before, overrun=overrun)
    )
    moved = np.vstack(
        [
            np.ones(3, dtype=np.bool_) if before is None else begins != 0.0,
            np.abs(moves) > _MOVED_MM,
        ]
    )
    kept = before or Standing(driven.stop_mm[0], driven.approach, np.zeros(3), np.zeros(3))
    sides = np.vstack([begins, np.sign(moves)])
    return Arrivals(
        side=_held(sides, moved, kept.side),
        arrival_um=_held(
            rng.normal(size=moved.shape) * scatter.arrival_um, moved, kept.arrival_um
        ),
        servo_um=_held(rng.normal(size=moved.shape) * scatter.servo_um, moved, kept.servo_um),
    )


def _first_move(driven: DrivenPass, before: Standing, *, overrun: bool) -> Array:
    """Return the sign of each axis' movement to the first stop, 0 for a standing axis, shape
    (3,).
    """
    way = driven.stop_mm[0] - before.position_mm
    straight: Array = np.where(np.abs(way) > _MOVED_MM, np.sign(way), 0.0)
    return (
        np.where(driven.approach != 0.0, driven.approach, straight) if overrun else straight
    )


def _held(
    drawn: Array, moved: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], before: Array
) -> Array:
    """Return the value drawn at the last move of each axis, ``before`` until its first move, shape
    (M, 3).
    """
    last = np.maximum.accumulate(np.where(moved, np.arange(len(moved))[:, None], -1), axis=0)
    return np.where(last >= 0, np.take_along_axis(drawn, np.maximum(last, 0), axis=0), before)


def standing_at_end(driven: DrivenPass, came: Arrivals) -> Standing:
    """Return where the axes stand after a pass."""
    return Standing(driven.stop_mm[-1], came.side[-1], came.arrival_um[-1], came.servo_um[-1])
