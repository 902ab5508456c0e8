"""The straightness by the 4-DOF head in a result: its values by three reference lines, and its
comparison with the diagonals.

If head and diagonals contradict each other, either may be wrong. The result then does not contain a
mean of both, but the values of the diagonals, with an uncertainty that includes the head's values.
An export is refused until the cause is removed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, error, warning
from stepdiag.base.result.members import Difference, HeadStraightness
from stepdiag.base.result.result import DISPLACEMENTS, POSITIONING, Function
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.linear.components import sized
from stepdiag.solver.linear.families import family_of, size_by_all
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.model.between import BETWEEN, USUAL_UM
from stepdiag.solver.model.effects import TURNING
from stepdiag.solver.model.lateral import MeasuredStraightness, of_known_angles
from stepdiag.solver.standards.straightness import residuals_um, straightness_um

LEAST_CHECKED = 2
"""Smallest number of checked values of the head for which agreement is reported."""
NORMAL_999 = 3.09  # the 99.9 % point of the normal distribution
LIKELY = 0.8
"""The assumed size of the waves between the nodes is this quantile of their likely sizes. The
likely sizes are computed from differences among the head's values. With 0.8, 6 of 180 surveys
without a fault had a contradiction (12 with 0.5), none of them with waves of at least `BENT`. From
0.95 on, some wrong signs are not detected."""
BENT = 2.0 / 8.0
"""Deviation of a function in the middle between two nodes from the straight line, as a share of
its second differences at the nodes: 1/8 for a smooth function, 1/4 for waves of two increments."""


class Adjusted(Protocol):
    @property
    def adjustment(self) -> Adjustment: ...

    def curve(self, name: str, nodes: int) -> tuple[Vector, Vector, Vector] | None: ...


Done = TypeVar("Done", bound=Adjusted)


def agreeing(
    estimated: Callable[[Sequence[MeasuredStraightness]], Done],
    measured: Sequence[MeasuredStraightness],
) -> tuple[Done, dict[str, HeadStraightness]]:
    """Return the estimate with the functions of the head that the readings do not contradict, and
    the report on all functions of the head.

    Functions are omitted one by one, the largest contradiction first, because a wrong function
    causes contradictions in other functions.
    """
    kept, apart = list(measured), dict[str, HeadStraightness]()
    alone = estimated(())
    sizes = sizes_of(alone)
    while kept:
        done = estimated(kept)
        report = head_report(done.adjustment, kept, sizes)
        worst = max(
            _contradicting(report),
            key=lambda name: report[name].misclosure or 0.0,
            default=None,
        )
        if worst is None:
            return done, {**report, **apart}
        apart[worst] = report[worst]
        kept = [one for one in kept if one.name != worst]
    return alone, apart


def sizes_of(alone: Adjusted) -> dict[str, float]:
    """Return two sizes that the laser's readings show, relative to their usual sizes and at least
    1: of the angular functions, and of the waves between the nodes.

    The comparison of the head with the diagonals uses these sizes. With free sizes, angles of 80
    urad or waves between the nodes would explain an error of 8 um in the head's values.
    """
    effects = zip(alone.adjustment.effects, alone.adjustment.sizes.factor, strict=True)
    turning = {
        effect.name: max(1.0, float(factor))
        for effect, factor in effects
        if effect.name in TURNING
    }
    increments = alone.adjustment.layout.volume.increments
    curves = [
        alone.curve(name, increments) for name in DISPLACEMENTS if name not in POSITIONING
    ]
    bends = np.concatenate(
        [np.zeros(1), *(np.diff(curve[0], n=2) for curve in curves if curve is not None)]
    )
    return {
        **turning,
        BETWEEN: max(
            1.0, BENT * float(np.sqrt(np.sum(bends**2) / max(len(bends) - 1, 1))) / USUAL_UM
        ),
    }


def beside_head(
    errors: Mapping[str, Function],
    report: Mapping[str, HeadStraightness],
    measured: Sequence[MeasuredStraightness],
    found: Adjustment,
) -> tuple[dict[str, Function], dict[str, HeadStraightness]]:
    """Return the functions and the report. If head and diagonals contradict each other, the
    report contains their difference, and U of the function includes the difference."""
    wider, compared = dict(errors), dict(report)
    for name in _contradicting(report):
        mine, function = [one for one in measured if one.name == name], errors[name]
        if function.value is None or function.u is None:
            continue
        at, of_head = _mean(
            np.concatenate([one.position_mm for one in mine]),
            np.concatenate(
                [
                    residuals_um(
                        one.position_mm,
                        one.value_um - of_known_angles(found.design, one, found.angles),
                    )
                    for one in mine
                ]
            ),
        )
        there = np.interp(at, function.position_mm, function.value)
        apart = residuals_um(at, of_head) - residuals_um(at, there)
        half = 0.5 * np.interp(function.position_mm, at, np.abs(apart))
        wider[name] = replace(function, u=np.hypot(function.u, half))
        difference = Difference(position_mm=tuple(at.tolist()), value=tuple(apart.tolist()))
        compared[name] = replace(report[name], used=False, difference_um=difference)
    return wider, compared


def _contradicting(report: Mapping[str, HeadStraightness]) -> list[str]:
    return [
        name
        for name, facts in report.items()
        if facts.misclosure is not None and facts.misclosure > 1.0
    ]


def head_report(
    found: Adjustment, measured: Sequence[MeasuredStraightness], sizes: Mapping[str, float]
) -> dict[str, HeadStraightness]:
    """Return the report on each function of the head: passes, straightness by each reference line
    with its uncertainty, agreement with the readings.

    ``residual_um`` is the rms difference between the head's values and the adjusted function.
    ``misclosure`` is chi-square of the comparison divided by its 99.9 % limit: above 1, head and
    diagonals contradict each other. ``sign_hidden`` is True if a wrong sign would not be detected.
    """
    rows = _head_rows(found, measured)
    checked = _checked(found, sizes, rows)
    return {
        name: _of_function(
            [one for one in measured if one.name == name], mine, checked.alone[name], checked
        )
        for name, mine in rows.items()
    }


@dataclass(frozen=True, eq=False)
class _Checked:
    """``fit`` is the fit of all readings and all values of the head. ``alone`` contains a separate
    fit of the head's values of each function. ``as_usual`` (q,) is the factor from the size of each
    random effect to its usual size."""

    fit: MixedFit
    alone: Mapping[str, MixedFit]
    as_usual: Vector


def _checked(
    found: Adjustment, sizes: Mapping[str, float], functions: Mapping[str, NDArray[np.bool_]]
) -> _Checked:
    """Return the fits for the comparison; random effects have their usual size, except those in
    ``sizes``.

    The size of the waves between the nodes is computed for each function separately: a common size
    could hide a wrong sign if head and diagonals have few common positions.
    """
    between = np.repeat(
        [effect.name == BETWEEN for effect in found.effects],
        [effect.count for effect in found.effects],
    )
    beside = bool(np.any(found.fit.causes.pattern[len(found.layout) :, between]))
    of_turning = {name: size for name, size in sizes.items() if name != BETWEEN}
    usual = _of_sizes(found, {**of_turning, BETWEEN: 1.0} if beside else of_turning)
    alone = {name: usual.of_rows(mine) for name, mine in functions.items()}
    if not beside:
        return _Checked(usual, alone, np.ones(len(between)))
    size = max(
        sizes[BETWEEN],
        size_by_all([family_of(one, between, 0.0) for one in alone.values()], LIKELY),
    )
    grown = np.where(between, size, 1.0)
    return _Checked(
        sized(usual, grown),
        {name: sized(one, grown) for name, one in alone.items()},
        1.0 / grown,
    )


def _of_sizes(found: Adjustment, sizes: Mapping[str, float]) -> MixedFit:
    factor = [
        sizes.get(effect.name, size) / size
        for effect, size in zip(found.effects, found.sizes.factor, strict=True)
    ]
    return sized(
        found.as_usual(*sizes), np.repeat(factor, [effect.count for effect in found.effects])
    )


def _misclosure(whole: MixedFit, others: MixedFit, alone: MixedFit) -> float | None:
    """Return the larger of two values of chi-square, each divided by its limit: of a function's
    rows against all ``others``, and of these rows among themselves. Return None if too few rows are
    checked. A single chi-square over all passes could hide a difference between the head and all
    other passes."""
    among = _over_chance(alone.chi_square, alone.freedom)
    return max(
        (one for one in (_apart(whole, others, alone), among) if one is not None),
        default=None,
    )


def _apart(whole: MixedFit, others: MixedFit, alone: MixedFit) -> float | None:
    return _over_chance(
        whole.chi_square - others.chi_square - alone.chi_square,
        whole.freedom - others.freedom - alone.freedom,
    )


def _chi_square_limit(freedom: int) -> float:
    """Return the 99.9 % point of chi-square (Wilson and Hilferty's approximation, exact to 1 %
    from 3 degrees of freedom)."""
    spread = 2.0 / (9.0 * freedom)
    return float(freedom * (1.0 - spread + NORMAL_999 * np.sqrt(spread)) ** 3)


def _over_chance(chi_square: float, freedom: int) -> float | None:
    return chi_square / _chi_square_limit(freedom) if freedom >= LEAST_CHECKED else None


def _sign_hidden(
    checked: _Checked, rows: NDArray[np.bool_], others: MixedFit, alone: MixedFit
) -> bool:
    """Return whether the head's values agree with all other readings in both signs because waves
    between the nodes explain the difference."""
    if np.all(checked.as_usual == 1.0):
        return False
    signs = checked.fit, _turned_over(checked.fit, rows)
    if max(_apart(whole, others, alone) or 0.0 for whole in signs) > 1.0:
        return False
    others, alone = (sized(one, checked.as_usual) for one in (others, alone))
    return (
        max(_apart(sized(whole, checked.as_usual), others, alone) or 0.0 for whole in signs)
        > 1.0
    )


def _turned_over(whole: MixedFit, rows: NDArray[np.bool_]) -> MixedFit:
    return whole.for_target(np.where(rows, -1.0, 1.0) * whole.fixed.target)


def _head_rows(
    found: Adjustment, measured: Sequence[MeasuredStraightness]
) -> dict[str, NDArray[np.bool_]]:
    name = np.array([one.name for one in measured for _ in one.position_mm])
    before, after = len(found.layout), len(found.fit.weight) - len(found.layout) - len(name)
    return {one.name: np.pad(name == one.name, (before, after)) for one in measured}


def _of_function(
    passes: Sequence[MeasuredStraightness],
    rows: NDArray[np.bool_],
    alone: MixedFit,
    checked: _Checked,
) -> HeadStraightness:
    position = np.concatenate([one.position_mm for one in passes])
    value = np.concatenate([residuals_um(one.position_mm, one.value_um) for one in passes])
    at, mean = _mean(position, value)
    others = checked.fit.of_rows(~rows)
    return HeadStraightness(
        passes=len(passes),
        end_point_um=straightness_um(at, mean, "end-point"),
        least_squares_um=straightness_um(at, mean, "least-squares"),
        minimum_zone_um=straightness_um(at, mean, "minimum-zone"),
        u_um=float(
            np.sqrt(np.mean(np.concatenate([one.u_um for one in passes]) ** 2) / len(passes))
        ),
        residual_um=float(np.sqrt(np.mean(checked.fit.residual[rows] ** 2))),
        misclosure=_misclosure(checked.fit, others, alone),
        sign_hidden=_sign_hidden(checked, rows, others, alone),
    )


def _mean(position: Vector, value: Vector) -> tuple[Vector, Vector]:
    at, place = np.unique(position, return_inverse=True)
    return at, np.bincount(place, weights=value) / np.bincount(place)


def head_findings(report: Mapping[str, HeadStraightness]) -> list[Finding]:
    """Return the findings about functions with a contradiction, and about functions with an
    undetectable sign."""
    bad = _contradicting(report)
    hidden = [name for name, facts in report.items() if facts.sign_hidden and name not in bad]
    return [
        *([_misclosed(report, bad)] if bad else []),
        *([_unchecked(hidden)] if hidden else []),
    ]


def _misclosed(report: Mapping[str, HeadStraightness], bad: Sequence[str]) -> Finding:
    worst = max(bad, key=lambda name: report[name].misclosure or 0.0)
    apart = report[worst].difference_um
    if apart is None:
        return error("straightness-misclosure", names=bad)
    apart_um = float(np.max(np.abs(apart.value)))
    return error("straightness-misclosure.by", names=bad, apart_um=apart_um, name=worst)


def _unchecked(hidden: Sequence[str]) -> Finding:
    return warning("straightness-unchecked", names=hidden)
