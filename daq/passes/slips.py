"""A step of the laser's count that no single reading shows: a slip, a frozen value, a bumped
mirror.

The count of an interferometer slips and continues without any sign; a touched mirror has the same
effect. Repeated passes show the step: the difference between two passes over the same stops (out
and back, or two repetitions) is smooth, reversal and drift included, except at the place of the
step.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.daq.capture.standing.window import MAD_TO_SIGMA
from stepdiag.daq.passes.stretches import SURE

Vector = NDArray[np.float64]

TIMES_NOISE = 6.0
"""A step exceeds its neighbours by this number of robust standard deviations, or more with few
neighbours.
"""
FEW = 6.0
LEAST_UM = 1.0
"""Smaller steps are not searched: machines do not repeat better over a whole diagonal."""
OWN_STEPS, FEW_OF_AXIS = 4, 3.0
"""This number of other steps of an axis shows its scatter. With it, drawn machines of 500 mm to 4 m
that repeat to 0.2 to 1.5 um are named in less than 1 % of the pairs of passes (3 % with two
increments and 1.5 um); without it, in up to 60 %.
"""
FLOOR_UM = 0.15
"""The smallest noise assumed of a handful of differences."""
ALONE_UM = 10.0
ALONE_STEPS = 5
"""Least number of own steps of an axis by which a single pass is judged, and least size of a step
that is reported.
"""
FEW_UM, FEW_UM_M = 50.0, 500.0
"""A smaller number of steps shows no scatter: two steps of one axis cannot differ by more than
this, and by more than this share per metre of step, because of the axis.
"""


@dataclass(frozen=True, slots=True)
class Step:
    """A step on the way to the stop with this index, in um, and the robust noise of the other
    steps.

    ``instead`` is another stop at which the step may have been, with the opposite sign; None
    without one.
    """

    stop: int
    size_um: float
    noise_um: float
    instead: int | None = None


def step_in(
    values_um: Vector, u_um: Vector, axes: Sequence[str], share: Vector
) -> Step | None:
    """Return the single step of an otherwise smooth sequence, or None.

    ``values_um`` (n,) are differences of readings at the stops in order, ``u_um`` their standard
    uncertainties; ``axes`` (n - 1,) is the axis that moves from stop to stop and ``share`` the
    share of its travel in the reading. On a long machine a single axis causes all the scatter, and
    its steps are a third of all.
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
    """Return the largest loss of count, in um, that a step of an otherwise smooth sequence may
    hide: the step itself plus the scatter of such steps; infinite for fewer than three steps.

    Arguments as in `step_in`; ``at`` is the index of the step.
    """
    steps_um = np.diff(values_um)
    if len(steps_um) < 3:
        return float("inf")
    off_um = np.abs(steps_um - np.median(np.delete(steps_um, at)))
    scatter_um, few = _scatter_of_axis(off_um, axes, share, at)
    noise_um = max(scatter_um, float(np.hypot(u_um[at], u_um[at + 1])), FLOOR_UM)
    return float(off_um[at]) + SURE * few * noise_um


def _usual_of_axis(off_um: Vector, axes: Sequence[str], share: Vector, at: int) -> float:
    """Return the limit of a step by the others of its axis: a number of robust standard
    deviations.
    """
    scatter_um, few = _scatter_of_axis(off_um, axes, share, at)
    return TIMES_NOISE * few * scatter_um


def _scatter_of_axis(
    off_um: Vector, axes: Sequence[str], share: Vector, at: int
) -> tuple[float, float]:
    """Return the robust standard deviation of a step by the others of its axis (of all axes if
    these are few), and the factor for their small number.
    """
    others = np.arange(len(off_um)) != at
    own = others & (np.array(axes) == axes[at])
    used = own if np.count_nonzero(own) >= OWN_STEPS else others
    scatter_um = MAD_TO_SIGMA * float(share[at] * np.median(off_um[used] / share[used]))
    return scatter_um, 1.0 + FEW_OF_AXIS / int(np.count_nonzero(used))


def odd_step(
    steps_um: Vector, u_um: Vector, axes: Sequence[str], nominal_mm: Vector
) -> Step | None:
    """Return the single step of a pass that differs from the others of its axis, or None.

    ``steps_um`` (n - 1,) are measured minus nominal steps, ``axes`` their axes and ``nominal_mm``
    their nominal sizes. Tilt of the mirror and scale of the axis change all steps of an axis alike.
    With few steps, only a size that no axis causes is reported; None also for an axis with a single
    step.
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
    """Return the step furthest from the few other steps of an axis, if its distance exceeds the
    limit; else None.
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
    """Return the difference of the step to a stop from the median of the other steps of its axis,
    in um; NaN where there is no other.
    """
    others = [
        steps_um[index]
        for index, axis in enumerate(axes)
        if axis == axes[stop - 1] and index != stop - 1
    ]
    return float(steps_um[stop - 1] - np.median(others)) if others else float("nan")


def scatter_of_steps(steps_um: Vector, axes: Sequence[str], stop: int) -> float:
    """Return the robust standard deviation in um of the steps of a pass, each relative to the steps
    of its axis, without the step to a stop.
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
    """Return the step furthest from the others, if its distance exceeds the limit and its own
    ``usual_um``.
    """
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
