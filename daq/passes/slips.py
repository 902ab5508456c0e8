"""A step of the laser's count that no single reading shows: a slip, a frozen value, a bumped mirror.

The count of an interferometer slips and goes on as if nothing had happened; a mirror that was touched does the same. What was driven
twice tells: the difference between two passes over the same stops (out against back, one repeat against another) is smooth, reversal and
drift included, but for the place where the count went wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

MAD_TO_SIGMA = 1.4826
TIMES_NOISE = 6.0
"""A step is one where it stands out of its neighbours by so many robust standard deviations, more where there are few neighbours."""
FEW = 6.0
LEAST_UM = 1.0
"""Smaller steps are not looked for: machines do not repeat better over a whole diagonal."""
FLOOR_UM = 0.15
"""The least noise that is believed of a handful of differences."""
ALONE_UM = 10.0
ALONE_STEPS = 5
"""A pass that nothing can be compared with is judged by its own steps of one axis: so many of them, and only what is so large."""


@dataclass(frozen=True, slots=True)
class Step:
    """A step on the way to the stop with this index, in um, and the robust noise of the other steps."""

    stop: int
    size_um: float
    noise_um: float


def step_in(values_um: Vector, u_um: Vector) -> Step | None:
    """Return the one step of a sequence that is otherwise smooth, or None.

    ``values_um`` (n,) are differences of readings at the stops in order, ``u_um`` their standard uncertainties.
    """
    return _outlier(np.diff(values_um), np.hypot(u_um[1:], u_um[:-1]), LEAST_UM)


def odd_step(steps_um: Vector, u_um: Vector, axes: Sequence[str]) -> Step | None:
    """Return the one step of a pass that is unlike the others of its axis, or None.

    ``steps_um`` (n - 1,) are measured minus nominal steps, ``axes`` the axis of each. Tilt of the mirror and scale of the axis make all
    steps of an axis alike. None too where an axis makes too few steps to tell.
    """
    found = []
    for axis in dict.fromkeys(axes):
        own = np.array([index for index, each in enumerate(axes) if each == axis])
        if len(own) >= ALONE_STEPS and (step := _outlier(steps_um[own], u_um[own], ALONE_UM)) is not None:
            found.append(Step(int(own[step.stop - 1]) + 1, step.size_um, step.noise_um))
    return max(found, key=lambda step: abs(step.size_um), default=None)


def like_its_axis(steps_um: Vector, axes: Sequence[str], stop: int) -> float:
    """Return by how much the step to a stop differs from the median of the other steps of its axis, in um; NaN where there is no other."""
    others = [steps_um[index] for index, axis in enumerate(axes) if axis == axes[stop - 1] and index != stop - 1]
    return float(steps_um[stop - 1] - np.median(others)) if others else float("nan")


def _outlier(steps_um: Vector, u_um: Vector, least_um: float) -> Step | None:
    if len(steps_um) < 3:
        return None
    off = steps_um - np.median(steps_um)
    worst = int(np.argmax(np.abs(off)))
    others = np.delete(np.abs(off), worst)
    noise = max(MAD_TO_SIGMA * float(np.median(others)), float(np.median(u_um)), FLOOR_UM)
    enough = TIMES_NOISE * (1.0 + FEW / len(steps_um)) * noise
    return Step(worst + 1, float(off[worst]), noise) if abs(off[worst]) > max(least_um, enough) else None
