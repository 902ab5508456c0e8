"""Comparison of the passes of a setup, to find a jump of the laser's count: its place, pass and
size.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from stepdiag.base.messages import message
from stepdiag.daq.passes import slips
from stepdiag.daq.passes.doubt import Doubt
from stepdiag.daq.passes.driven import Pass
from stepdiag.daq.passes.slips import (
    Step,
    Vector,
    like_its_axis,
    odd_step,
    scatter_of_steps,
    step_in,
)

CLEARLY = 0.5
"""Largest ratio of two misfits. A finding assigns a jump to one of two passes only if the jump fits
this pass at least twice as well as the other pass.
"""
TELLS = 6.0
"""Least size in a single pass of a step that differs from the other steps of its axis, in robust
standard deviations of the other steps of the pass.
"""
CONFIRMED = 0.5
"""Share of the size of a step that differs from the other steps of its axis. If the step repeats
within this share when the pass is driven again, the machine causes the step, not the count.
"""


def compare(passes: Sequence[Pass], *, alone: bool) -> dict[int, tuple[Doubt, ...]]:
    """Return the doubts about each pass, by the index of the pass.

    Incomplete passes, and runs of the 4-DOF head, have no doubts. ``alone`` means that the plan has
    one pass per setup; the pass is then judged only by its own steps.
    """
    against: dict[int, tuple[Doubt, ...]] = dict.fromkeys(range(len(passes)), ())
    if not passes or passes[0].route.travel.is_fourdof:
        return against
    readings = {
        index: _Readings(each, _one_sided(each))
        for index, each in enumerate(passes)
        if each.whole
    }
    if alone and len(readings) == 1:
        ((only, own),) = readings.items()
        step = own.odd()
        return (
            against
            if step is None or _seen_before(passes[only], step)
            else {**against, only: (_doubt(passes[only], step, None),)}
        )
    blamed: list[tuple[int, Doubt]] = []
    for pair in combinations(readings, 2):
        steps = _blame(*(readings[index] for index in pair))
        blamed += [
            (pair[at], _doubt(passes[pair[at]], step, passes[pair[1 - at]]))
            for at, step in steps.items()
        ]
    votes = Counter(index for index, _ in blamed)
    for index, doubt in blamed:
        if votes[index] == max(votes.values()) and not against[index]:
            against[index] = (doubt,)
    return against


def may_hide_um(each: Pass, stop: int, others: Sequence[Pass]) -> float:
    """Return the largest loss of count in um before a stop that the other passes of the setup do
    not exclude; infinite if every other pass has lost its count in this step.

    Passes with another order of axes are left out, because their steps differ.
    """
    if not each.whole:
        return float("inf")
    one = _Readings(each, _one_sided(each))
    place = stop if one.outward else len(each.route) - stop
    return max(
        (
            _between(one, other, place)
            for other in others
            if other is not each and other.whole and _counted_through(each, other, place)
        ),
        default=float("inf"),
    )


def _counted_through(each: Pass, other: Pass, place: int) -> bool:
    """Return whether the pass ``other`` has the same stops as ``each``, and drove the step to an
    outward stop within one stretch of count.
    """
    along, against = (1 if one.route.outward else -1 for one in (each, other))
    stop = place if other.route.outward else len(other.route) - place
    return other.stretch_at(stop) == other.stretch_at(stop - 1) and np.array_equal(
        each.route.stops_mm[::along], other.route.stops_mm[::against]
    )


def _between(one: "_Readings", other: Pass, place: int) -> float:
    two = _Readings(other, _one_sided(other))
    low, high = max(one.low, two.low), min(one.high, two.high)
    if not low < place < high:
        return float("inf")
    between = slice(low, high - 1)
    return slips.may_hide_um(
        (two.off_um - one.off_um)[low:high],
        np.hypot(one.u_um, two.u_um)[low:high],
        one.axes[between],
        one.share[between],
        place - 1 - low,
    )


def _seen_before(each: Pass, step: Step) -> bool:
    """Return whether every repetition of a pass shows the step. In this case the machine causes the
    step, not the count.
    """
    here, there = each.measured.get(step.stop, ()), each.measured.get(step.stop - 1, ())
    made = [
        (one.beside_mm - before.beside_mm) * 1e3
        for one in here
        for before in there
        if one.stretch == before.stretch and 0 <= one.visit - before.visit <= 1
    ]
    return len(made) > 1 and max(made) - min(made) < CONFIRMED * abs(step.size_um)


def _one_sided(each: Pass) -> int:
    """Return the number of stops at the beginning of a pass before every axis has moved since the
    reversal; 0 without a reversal at the first stop.

    The first move of each axis adds its reversal to the readings of these stops. The reversal is no
    error of the count.
    """
    axes = [each.route.axis_to(index) for index in range(len(each.route))]
    return max(axes.index(axis) for axis in set(axes[1:])) if each.chosen()[0].turned else 0


class _Readings:
    """Measured minus nominal readings of a complete pass in the order of the outward route, and
    their uncertainties, in um.

    Every axis approached the stops ``low`` to ``high`` in the direction of the pass.
    """

    def __init__(self, each: Pass, one_sided: int) -> None:
        chosen = [each.chosen()[index] for index in range(len(each.route))]
        readings = np.array([stop.reading_mm for stop in chosen])
        along = 1 if each.route.outward else -1
        self.outward = each.route.outward
        self.low, self.high = (
            (one_sided, len(each.route)) if self.outward else (0, len(each.route) - one_sided)
        )
        nominal = np.array([each.route.nominal_at_mm(stop.position_mm) for stop in chosen])
        self.off_um: Vector = ((readings - nominal) * 1e3)[::along]
        self.u_um: Vector = np.array([stop.u_um for stop in chosen])[::along]
        axes = [each.route.axis_to(index) for index in range(1, len(each.route))]
        self.axes = axes[::along]
        self.nominal_mm: Vector = np.diff(nominal[::along])
        travel_mm = np.max(np.abs(np.diff(each.route.stops_mm, axis=0)), axis=1)[::along]
        self.share: Vector = np.abs(np.diff(each.route.nominal_mm)[::along]) / travel_mm

    def odd(self) -> Step | None:
        """Return the step that differs from the other steps of its axis, with the index of its stop
        in this pass; None without such a step.
        """
        step = odd_step(
            np.diff(self.off_um),
            np.hypot(self.u_um[1:], self.u_um[:-1]),
            self.axes,
            self.nominal_mm,
        )
        if step is None:
            return None
        other = None if step.instead is None else self._stop_in_pass(step.instead)
        return replace(
            self.in_pass(
                step.stop, step.size_um if self.outward else -step.size_um, step.noise_um
            ),
            instead=other,
        )

    def in_pass(self, place: int, size_um: float, noise_um: float) -> Step:
        """Return the step between the outward stops ``place - 1`` and ``place`` in the order of
        this pass.
        """
        return Step(self._stop_in_pass(place), size_um, noise_um)

    def _stop_in_pass(self, place: int) -> int:
        return place if self.outward else len(self.off_um) - place

    def own_um(self, place: int) -> float:
        """Return the deviation in um of the step to ``place`` from the other steps of its axis, in
        the direction of travel.
        """
        off = like_its_axis(np.diff(self.off_um), self.axes, place)
        return off if self.outward else -off

    def scatter_um(self, place: int) -> float:
        """Return the robust standard deviation in um of the differences between each step of the
        pass and the median step of its axis, without the step to ``place``.
        """
        return scatter_of_steps(np.diff(self.off_um), self.axes, place)


def _blame(one: _Readings, other: _Readings) -> dict[int, Step]:
    """Return the step in which two passes differ. The key is the index of the wrong pass: 0 for
    ``one``, 1 for ``other``. If either pass may be wrong, the result has both keys.
    """
    low, high = max(one.low, other.low), min(one.high, other.high)
    between = slice(low, high - 1)
    step = step_in(
        (other.off_um - one.off_um)[low:high],
        np.hypot(one.u_um, other.u_um)[low:high],
        one.axes[between],
        one.share[between],
    )
    if step is None:
        return {}
    step = replace(step, stop=low + step.stop)
    sizes = (_size_um(one, -step.size_um), _size_um(other, step.size_um))
    misses = [
        abs(each.own_um(step.stop) - size)
        for each, size in zip((one, other), sizes, strict=True)
    ]
    steps = {
        index: each.in_pass(step.stop, sizes[index], step.noise_um)
        for index, each in enumerate((one, other))
    }
    if abs(step.size_um) < TELLS * max(
        one.scatter_um(step.stop), other.scatter_um(step.stop)
    ):
        return steps
    if misses[0] < CLEARLY * misses[1]:
        return {0: steps[0]}
    return {1: steps[1]} if misses[1] < CLEARLY * misses[0] else steps


def _size_um(each: _Readings, along_outward_um: float) -> float:
    """Return the size of a step in um with the sign that the step has in its pass: a return pass
    drives the step in the opposite direction.
    """
    return along_outward_um if each.outward else -along_outward_um


def _doubt(each: Pass, step: Step, other: Pass | None) -> Doubt:
    seen = (
        message("unlike-its-axis")
        if other is None
        else message("against-pass", run=other.run, number=other.number)
    )
    others = message("others-scatter", noise_um=step.noise_um)
    if step.instead is not None:
        others = message("or-instead", size_um=-step.size_um, stop=step.instead)
    slip = message("count-slip", size_um=step.size_um, seen=seen, others=others)
    return each.doubted(each.chosen()[step.stop], slip.code, slip, round(step.size_um, 3))
