"""Jumps of the laser's count that no single reading shows: a slip, a frozen value, a bumped mirror.

The count of an interferometer slips without any sign; a bumped mirror also shifts all later
readings. Repeated passes show the jump: the difference between two passes over the same stops
contains reversal and drift, and is smooth except at the jump.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.daq.capture.standing.window import MAD_TO_SIGMA
from stepdiag.daq.passes.stretches import SURE

Vector = NDArray[np.float64]

TIMES_NOISE = 6.0
"""Least size of a jump in robust standard deviations of the other steps; the limit is higher for
few other steps.
"""
FEW = 6.0
LEAST_UM = 1.0
"""Least size of a reported jump in um: machines do not repeat better over a whole diagonal."""
OWN_STEPS, FEW_OF_AXIS = 4, 3.0
"""Least number of other steps that determine the scatter of an axis. A limit from n steps is 1 +
`FEW_OF_AXIS` / n times as high. The limits were tested on pairs of passes of random machines with
500 mm to 4 m of travel and a repeatability of 0.2 to 1.5 um. With both limits, less than 1 % of the
pairs show a false jump (3 % with two increments and 1.5 um); without the limits, up to 60 %.
"""
FLOOR_UM = 0.15
"""Least assumed noise in um of a few differences."""
ALONE_UM = 10.0
ALONE_STEPS = 5
"""Least number of steps of an axis for the judgement of a single pass, and least size in um of a
reported jump.
"""
FEW_UM, FEW_UM_M = 50.0, 500.0
"""Limit of the difference of two steps that an axis can cause, in um, and in um per metre of step;
used for an axis with too few steps to show its scatter.
"""


@dataclass(frozen=True, slots=True)
class Step:
    """A jump before the stop with the index ``stop``: its size and the robust noise of the other
    steps, in um.

    ``instead`` is another possible stop of the jump, with the opposite sign; None without such a
    stop.
    """

    stop: int
    size_um: float
    noise_um: float
    instead: int | None = None


def step_in(
    values_um: Vector, u_um: Vector, axes: Sequence[str], share: Vector
) -> Step | None:
    """Return the single jump of an otherwise smooth sequence, or None.

    ``values_um`` (n,) are differences of readings at the stops in order, ``u_um`` their standard
    uncertainties. ``axes`` (n - 1,) is the axis that moves from stop to stop, and ``share`` the
    part of the axis's travel that appears in the reading. The scatter is computed for each axis,
    because on a long machine one axis, with a third of the steps, can cause all the scatter.
    """
    steps_um = np.diff(values_um)
    if len(steps_um) < 3:
        return None
    off_um, noise_um = np.abs(steps_um - np.median(steps_um)), np.hypot(u_um[1:], u_um[:-1])
    usual_um = np.array(
        [_usual_of_axis(off_um, axes, share, at) for at in range(len(off_um))]
    )
    return _outlier(steps_um, noise_um, LEAST_UM, usual_um)


def may_hide_um(
    values_um: Vector, u_um: Vector, axes: Sequence[str], share: Vector, at: int
) -> float:
    """Return the largest loss of count in um that one step of a sequence may hide: the size of the
    step plus the scatter of similar steps; infinite for fewer than three steps.

    The other arguments are those of `step_in`; ``at`` is the index of the step.
    """
    steps_um = np.diff(values_um)
    if len(steps_um) < 3:
        return float("inf")
    off_um = np.abs(steps_um - np.median(np.delete(steps_um, at)))
    scatter_um, few = _scatter_of_axis(off_um, axes, share, at)
    noise_um = max(scatter_um, float(np.hypot(u_um[at], u_um[at + 1])), FLOOR_UM)
    return float(off_um[at]) + SURE * few * noise_um


def _usual_of_axis(off_um: Vector, axes: Sequence[str], share: Vector, at: int) -> float:
    """Return the largest usual size in um of a step, from the robust standard deviation of the
    other steps of its axis.
    """
    scatter_um, few = _scatter_of_axis(off_um, axes, share, at)
    return TIMES_NOISE * few * scatter_um


def _scatter_of_axis(
    off_um: Vector, axes: Sequence[str], share: Vector, at: int
) -> tuple[float, float]:
    """Return the robust standard deviation of a step in um, and the factor that raises its limit
    for a small number of steps. The other steps of the axis are used, or the steps of all axes if
    the axis has few.
    """
    others = np.arange(len(off_um)) != at
    own = others & (np.array(axes) == axes[at])
    used = own if np.count_nonzero(own) >= OWN_STEPS else others
    scatter_um = MAD_TO_SIGMA * float(share[at] * np.median(off_um[used] / share[used]))
    return scatter_um, 1.0 + FEW_OF_AXIS / int(np.count_nonzero(used))


def odd_step(
    steps_um: Vector, u_um: Vector, axes: Sequence[str], nominal_mm: Vector
) -> Step | None:
    """Return the single step of a pass that differs from the other steps of its axis, or None.

    ``steps_um`` (n - 1,) are measured minus nominal steps, ``axes`` their axes and ``nominal_mm``
    their nominal sizes. The tilt of the mirror and the scale of the axis change all steps of an
    axis alike. A step of an axis with few steps is returned only if the step is larger than an axis
    can cause. The single step of an axis is never returned.
    """
    found = []
    for axis in dict.fromkeys(axes):
        own = np.array([index for index, each in enumerate(axes) if each == axis])
        if (
            len(own) >= ALONE_STEPS
            and (step := _outlier(steps_um[own], u_um[own], ALONE_UM)) is not None
        ):
            found.append(Step(int(own[step.stop - 1]) + 1, step.size_um, step.noise_um))
        elif 1 < len(own) < ALONE_STEPS:
            found += _unlike(
                own,
                steps_um[own],
                FEW_UM + FEW_UM_M * 1e-3 * float(np.max(np.abs(nominal_mm[own]))),
            )
    return max(found, key=lambda step: abs(step.size_um), default=None)


def _unlike(own: NDArray[np.int64], steps_um: Vector, least_um: float) -> list[Step]:
    """Return the step with the largest distance from the few other steps of its axis, if the
    distance exceeds ``least_um``; otherwise an empty list.
    """
    off = np.array(
        [step - np.median(np.delete(steps_um, index)) for index, step in enumerate(steps_um)]
    )
    worst = len(off) - 1 - int(np.argmax(np.abs(off[::-1])))
    if abs(off[worst]) <= least_um:
        return []
    return [
        Step(
            int(own[worst]) + 1,
            float(off[worst]),
            least_um,
            int(own[0]) + 1 if len(own) == 2 else None,
        )
    ]


def like_its_axis(steps_um: Vector, axes: Sequence[str], stop: int) -> float:
    """Return the difference in um of the step to a stop from the median of the other steps of its
    axis; NaN without another step.
    """
    others = [
        steps_um[index]
        for index, axis in enumerate(axes)
        if axis == axes[stop - 1] and index != stop - 1
    ]
    return float(steps_um[stop - 1] - np.median(others)) if others else float("nan")


def scatter_of_steps(steps_um: Vector, axes: Sequence[str], stop: int) -> float:
    """Return the robust standard deviation in um of the differences between each step of a pass and
    the median step of its axis, without the step to ``stop``.
    """
    off: list[float] = []
    for axis in dict.fromkeys(axes):
        own = np.array(
            [
                steps_um[index]
                for index, each in enumerate(axes)
                if each == axis and index != stop - 1
            ]
        )
        off += (own - np.median(own)).tolist() if len(own) > 1 else []
    return MAD_TO_SIGMA * float(np.median(np.abs(off))) if off else float("inf")


def _outlier(
    steps_um: Vector, u_um: Vector, least_um: float, usual_um: Vector | None = None
) -> Step | None:
    if len(steps_um) < 3:
        return None
    off = steps_um - np.median(steps_um)
    usual = np.zeros(len(off)) if usual_um is None else usual_um
    worst = int(np.argmax(np.abs(off) - usual))
    others = np.delete(np.abs(off), worst)
    noise = max(MAD_TO_SIGMA * float(np.median(others)), float(np.median(u_um)), FLOOR_UM)
    enough = TIMES_NOISE * (1.0 + FEW / len(steps_um)) * noise
    return (
        Step(worst + 1, float(off[worst]), noise)
        if abs(off[worst]) > max(least_um, enough, usual[worst])
        else None
    )
