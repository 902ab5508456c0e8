"""What a result says about the 4-DOF head's straightness: its figures by the three reference lines, and whether the diagonals agree.

Where they contradict each other neither is known to be right, and their mean would be wrong with certainty. The result then holds what
the diagonals say, with an uncertainty that reaches to the head's values, and nothing is exported before a person has found the cause.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.adjustment.diagnostics import chi_square_limit
from stepdiag.solver.findings import Finding
from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.components import sized
from stepdiag.solver.linear.fit import fit
from stepdiag.solver.linear.mixed import Causes, MixedFit
from stepdiag.solver.model.effects import TURNING
from stepdiag.solver.model.lateral import MeasuredStraightness, of_known_angles
from stepdiag.solver.result.result import Function
from stepdiag.solver.standards.straightness import LineMethod, residuals_um, straightness_um

_LINES: dict[str, LineMethod] = {
    "end_point_um": "end-point",
    "least_squares_um": "least-squares",
    "minimum_zone_um": "minimum-zone",
}
LEAST_FREEDOM = 2
"""Where the diagonals and other passes check less than two of the head's values, nothing is said about agreement."""


class Adjusted(Protocol):
    """What an estimate has that is needed here."""

    @property
    def adjustment(self) -> Adjustment: ...


Done = TypeVar("Done", bound=Adjusted)


def agreeing(
    estimated: Callable[[Sequence[MeasuredStraightness]], Done], measured: Sequence[MeasuredStraightness]
) -> tuple[Done, dict[str, dict[str, Any]]]:
    """Return the estimate from those of the head's functions that the readings do not contradict, and the report on all of them.

    The worst is left out first: a function that is wrong makes others look wrong.
    """
    kept, apart = list(measured), dict[str, dict[str, Any]]()
    alone = estimated(())
    turning = turning_of(alone.adjustment)
    while kept:
        done = estimated(kept)
        report = head_report(done.adjustment, kept, turning)
        worst = max(_contradicting(report), key=lambda name: float(report[name]["misclosure"]), default=None)
        if worst is None:
            return done, {**report, **apart}
        apart[worst] = report[worst]
        kept = [one for one in kept if one.name != worst]
    return alone, apart


def turning_of(alone: Adjustment) -> dict[str, float]:
    """Return how large angular functions are beside the usual, by the name of the effect, as the readings alone say; one at least.

    The head's values are held against the diagonals with these: eight micrometres by which it is wrong would else be taken for 80 urad.
    """
    found = zip(alone.effects, alone.sizes.factor, strict=True)
    return {effect.name: max(1.0, float(factor)) for effect, factor in found if effect.name in TURNING}


def beside_head(
    errors: Mapping[str, Function], report: Mapping[str, dict[str, Any]], measured: Sequence[MeasuredStraightness], found: Adjustment
) -> tuple[dict[str, Function], dict[str, dict[str, Any]]]:
    """Return functions and report; where head and diagonals contradict each other the report has the difference, and U reaches over it."""
    wider, told = dict(errors), {name: dict(facts) for name, facts in report.items()}
    for name in _contradicting(report):
        mine, function = [one for one in measured if one.name == name], errors[name]
        if function.value is None or function.u is None:
            continue
        at, of_head = _mean(
            np.concatenate([one.position_mm for one in mine]),
            np.concatenate(
                [residuals_um(one.position_mm, one.value_um - of_known_angles(found.design, one, found.angles)) for one in mine]
            ),
        )
        there = np.interp(at, function.position_mm, function.value)
        apart = residuals_um(at, of_head) - residuals_um(at, there)
        half = 0.5 * np.interp(function.position_mm, at, np.abs(apart))
        wider[name] = replace(function, u=np.hypot(function.u, half))
        told[name] |= {"used": False, "difference_um": {"position_mm": at, "value": apart}}
    return wider, told


def _contradicting(report: Mapping[str, dict[str, Any]]) -> list[str]:
    return [name for name, facts in report.items() if facts["misclosure"] is not None and facts["misclosure"] > 1.0]


def head_report(found: Adjustment, measured: Sequence[MeasuredStraightness], turning: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Return for each function the head measured: passes, straightness by each line, its uncertainty, and how it fits the readings.

    ``residual_um`` is the rms of the head's values against the adjusted function; ``misclosure`` is `_misclosure` over what chance allows
    (its 99.9 % point): above 1 the head and the diagonals contradict each other. Causes are as usual there, angular functions as large as
    `turning_of` says.
    """
    rows, checked = _rows(found, measured), _checked(found, turning)
    names = dict.fromkeys(one.name for one in measured)
    return {
        name: _of_function([(one, rows[index]) for index, one in enumerate(measured) if one.name == name], found, checked) for name in names
    }


def _checked(found: Adjustment, turning: Mapping[str, float]) -> MixedFit:
    """Return the fit as usual, with angular functions of the sizes given."""
    usual = found.as_usual(*turning)
    factor = [turning.get(effect.name, size) / size for effect, size in zip(found.effects, found.sizes.factor, strict=True)]
    return sized(usual, np.repeat(factor, [effect.count for effect in found.effects]))


def _misclosure(checked: MixedFit, found: Adjustment, rows: NDArray[np.int64]) -> float | None:
    """Return chi-square of what rows and all others say apart from each other, or of what the rows say among themselves where that is
    worse, over what chance allows; None where too few of them are checked.

    Passes that agree with each other would hide in one sum what they have against the others.
    """
    others, alone = (_with(checked, found, ~np.isin(np.arange(len(checked.weight)), rows) == kept) for kept in (True, False))
    apart = checked.chi_square - others.chi_square - alone.chi_square, checked.freedom - others.freedom - alone.freedom
    tested = [one for one in (apart, (alone.chi_square, alone.freedom)) if one[1] >= LEAST_FREEDOM]
    return max((chi_square / chi_square_limit(freedom) for chi_square, freedom in tested), default=None)


def _with(whole: MixedFit, found: Adjustment, kept: NDArray[np.bool_]) -> MixedFit:
    """Return a fit with some of its rows alone."""
    before = whole.fixed
    target = before.residual + before.rows.times(before.unknowns)
    some = fit(before.rows, found.design.blocks, target, np.where(kept, before.weight, 0.0))
    return MixedFit(some, Causes.of(some, whole.causes.pattern), whole.size)


def _rows(found: Adjustment, measured: Sequence[MeasuredStraightness]) -> list[NDArray[np.int64]]:
    """Return the rows of the fit that belong to each pass: they follow the readings."""
    edges = len(found.layout) + np.concatenate([[0], np.cumsum([len(one.position_mm) for one in measured])])
    return [np.arange(edges[index], edges[index + 1]) for index in range(len(measured))]


def _of_function(passes: Sequence[tuple[MeasuredStraightness, NDArray[np.int64]]], found: Adjustment, checked: MixedFit) -> dict[str, Any]:
    position = np.concatenate([one.position_mm for one, _ in passes])
    value = np.concatenate([residuals_um(one.position_mm, one.value_um) for one, _ in passes])
    rows = np.concatenate([mine for _, mine in passes])
    at, mean = _mean(position, value)
    excess = _misclosure(checked, found, rows)
    return {
        "passes": len(passes),
        **{key: straightness_um(at, mean, line) for key, line in _LINES.items()},
        "u_um": float(np.sqrt(np.mean(np.concatenate([one.u_um for one, _ in passes]) ** 2) / len(passes))),
        "residual_um": float(np.sqrt(np.mean(checked.residual[rows] ** 2))),
        "misclosure": excess,
    }


def _mean(position: Vector, value: Vector) -> tuple[Vector, Vector]:
    at, place = np.unique(position, return_inverse=True)
    return at, np.bincount(place, weights=value) / np.bincount(place)


def head_findings(report: dict[str, dict[str, Any]]) -> list[Finding]:
    """Return the finding on functions that head and diagonals see differently."""
    bad = _contradicting(report)
    if not bad:
        return []
    worst = max(bad, key=lambda name: float(report[name]["misclosure"]))
    apart = report[worst].get("difference_um")
    size = "" if apart is None else f" (by up to {float(np.max(np.abs(apart['value']))):.2g} um in {worst})"
    text = (
        f"{', '.join(bad)}: the 4-DOF head and the diagonals differ by more than their uncertainties{size}: a roll that is not known, air "
        "that bends the head's beam, or a wrong sign of the head; the head's values are not in the result, U reaches to them, and nothing "
        "is exported: find the cause, or solve the readings without the head's straightness"
    )
    return [Finding(code="straightness-misclosure", severity="error", text=text)]
