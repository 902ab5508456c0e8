"""The verdict whether a machine conforms to its tolerances (ISO 14253-1), with the probability of
conformity (JCGM 106).

A tolerance limits a magnitude: the measurand Y conforms if |Y| is at most T. The distribution of a
number is normal, with its value and its combined standard uncertainty. The distribution of a skewed
value (a length, a range) consists of draws from the posterior.

    probability of conformity   p = Pr(-T <= Y <= T | measured)  (JCGM 106:2012, 7)
    conform                     the whole coverage interval (k = 2) is within T
                                (ISO 14253-1, guard band g = U)
    not conform                 the whole coverage interval is outside T
    not decidable               the interval contains a limit

For a normal Y far from the other limit, "conform" means |y| + U <= T: a machine exactly at the
limit is accepted in 2.3 % of all surveys. The interval of a volumetric value
(`base.result.prediction`) excludes the largest 2.3 % and the smallest 0.5 % of the draws.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from math import erf, sqrt
from typing import Literal

import numpy as np

from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.interval import FieldFigures, Interval
from stepdiag.base.result.members import Conformity, Judged, StandardFigures, Verdict
from stepdiag.base.result.prediction import (
    DRAWS,
    TAIL,
    VOLUMETRIC_LARGEST,
    VOLUMETRIC_RMS,
    predicted,
)
from stepdiag.base.result.result import (
    DISPLACEMENTS,
    POSITIONING,
    ROTATIONS,
    Function,
    Result,
)
from stepdiag.base.volume import Vector, anywhere_mm

SQUARENESS_URAD = "squareness_urad"
POSITIONING_UM = {"positioning_e_um": "E", "positioning_a_um": "A"}
"""Values of ISO 230-2 that may have a tolerance: the name of the tolerance and the symbol of the
value."""
COVERAGE = 2.0
"""Coverage factor of every uncertainty that a person reads (ISO/TR 230-9)."""
Unit = Literal["um", "urad"]


def probability(
    value: float, u: float, tolerance: float, least: float | None = None
) -> float:
    """Return the probability that a normal measurand is between ``least`` (None: minus
    ``tolerance``) and ``tolerance`` (JCGM 106:2012, 7.3 to 7.5).

    ``u`` is the standard uncertainty of the measurand; with ``u`` = 0 the result is 0 or 1.
    """
    low = -tolerance if least is None else least
    if u == 0.0:
        return float(low <= value <= tolerance)
    return _normal((tolerance - value) / u) - _normal((low - value) / u)


def _normal(z: float) -> float:
    return 0.5 * (1.0 + erf(z / sqrt(2.0)))


def verdict_of(low: float | None, high: float | None, tolerance: float) -> Verdict:
    """Return the verdict about a measurand by its coverage interval. ``tolerance`` is the largest
    permitted magnitude. A measurand without an interval is not decidable."""
    if low is None or high is None:
        return "not_decidable"
    if -tolerance <= low and high <= tolerance:
        return "conform"
    return "not_conform" if low > tolerance or high < -tolerance else "not_decidable"


def together(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the verdict about a machine: not conform if one of its values is not conform, conform
    if all values are conform."""
    found = set(verdicts)
    if "not_conform" in found:
        return "not_conform"
    return "not_decidable" if "not_decidable" in found or not found else "conform"


def with_tolerance(result: Result, tolerance: Mapping[str, float]) -> Result:
    """Return the result with these tolerances and the verdicts about them. Without tolerances the
    result stays unchanged."""
    if not tolerance:
        return result
    known = replace(result, tolerance=dict(tolerance))
    if (
        known.predicted is not None
        and {VOLUMETRIC_RMS, VOLUMETRIC_LARGEST} & tolerance.keys()
    ):
        points = anywhere_mm(known.volume)
        known = replace(
            known, predicted=predicted(known, points, -error_field_um(known, points))
        )
    return replace(known, conformity=conformity_of(known))


def conformity_of(result: Result) -> Conformity:
    tolerance = result.tolerance or {}
    figures = None if result.predicted is None else result.predicted.without_rigid_motion
    found = (
        *_squareness(result, tolerance),
        *_positioning(result, tolerance),
        *_functions(result, tolerance),
    )
    after = _compensated(result)
    left = (
        *_squareness(after, tolerance),
        *_functions(
            after, {name: tolerance[name] for name in DISPLACEMENTS if name in tolerance}
        ),
    )
    return Conformity(
        as_found=(
            *judged_volume(tolerance, None if figures is None else figures["before"]),
            *found,
        ),
        predicted=(
            *judged_volume(tolerance, None if figures is None else figures["after"]),
            *left,
        ),
    )


def _compensated(result: Result) -> Result:
    """Return the result after an ideal compensation: every identified squareness and displacement
    function is zero within its u.

    A table removes no angular error. The values E and A of the returned result do not contain the
    reversal.
    """
    errors = {
        name: one if one.value is None else replace(one, value=np.zeros_like(one.value))
        for name, one in result.errors.items()
    }
    squareness = {
        name: one if one.value is None else replace(one, value=0.0)
        for name, one in result.squareness.items()
    }
    return replace(result, errors=errors, squareness=squareness)


def judged_volume(
    tolerance: Mapping[str, float], figures: FieldFigures | None
) -> tuple[Judged, ...]:
    """Return the verdicts about the volumetric values that have a tolerance. ``figures`` is None
    for a survey of less than three axes."""
    intervals = (None, None) if figures is None else (figures.rms_um, figures.largest_um)
    pairs = zip((VOLUMETRIC_RMS, VOLUMETRIC_LARGEST), intervals, strict=True)
    return tuple(
        _of_interval(name.removesuffix("_um"), "um", tolerance[name], found)
        for name, found in pairs
        if name in tolerance
    )


def _of_interval(
    quantity: str, unit: Unit, tolerance: float, found: Interval | None
) -> Judged:
    known = found or Interval(value_um=0.0)
    return Judged(
        quantity=quantity,
        unit=unit,
        tolerance=tolerance,
        value=None if found is None else found.value_um,
        low=known.low_um,
        high=known.high_um,
        probability=known.within,
        verdict=verdict_of(known.low_um, known.high_um, tolerance),
    )


def _of_number(
    quantity: str, unit: Unit, tolerance: float, value: float | None, u: float | None
) -> Judged:
    low, high, within = None, None, None
    if value is not None and u is not None:
        low, high, within = (
            value - COVERAGE * u,
            value + COVERAGE * u,
            probability(value, u, tolerance),
        )
    return Judged(
        quantity=quantity,
        unit=unit,
        tolerance=tolerance,
        value=value,
        low=low,
        high=high,
        probability=within,
        verdict=verdict_of(low, high, tolerance),
    )


def _squareness(result: Result, tolerance: Mapping[str, float]) -> Iterator[Judged]:
    most = tolerance.get(SQUARENESS_URAD)
    for name, quantity in result.squareness.items():
        if most is not None:
            yield _of_number(name, "urad", most, quantity.value, quantity.u)


def _positioning(result: Result, tolerance: Mapping[str, float]) -> Iterator[Judged]:
    runs = {
        name: found[0]
        for name, found in (result.standards or {}).items()
        if name.startswith("linear") and found
    }
    for name, symbol in POSITIONING_UM.items():
        most = tolerance.get(name)
        if most is not None:
            of_axes = runs or {"linear": StandardFigures(standard="", source_status="")}
            for run, figures in of_axes.items():
                expanded = (figures.U or {}).get(symbol)
                u = None if expanded is None else expanded / COVERAGE
                yield _of_number(f"{symbol} {run}", "um", most, getattr(figures, symbol), u)


def _functions(result: Result, tolerance: Mapping[str, float]) -> Iterator[Judged]:
    drawn = _drawn(
        result, [name for name in (*DISPLACEMENTS, *ROTATIONS) if name in tolerance]
    )
    for name in (*DISPLACEMENTS, *ROTATIONS):
        unit: Unit = "um" if name in DISPLACEMENTS else "urad"
        function = result.errors.get(name)
        if name not in tolerance:
            continue
        if name in drawn:
            known = _interval(*drawn[name], tolerance[name])
            yield _of_interval(name, unit, tolerance[name], known)
        else:
            yield _of_number(name, unit, tolerance[name], *_range(function))


def _drawn(result: Result, names: list[str]) -> dict[str, tuple[Vector, float]]:
    """Return two ranges (largest less smallest value) of each function: for machines drawn at
    random from the posterior, shape (draws,), and for the estimated function.

    Straightness, and a function with unidentified slope, have their end-point line removed. The
    draws have the correlations of the posterior and the u of the result.
    """
    if result.posterior is None or not names:
        return {}
    deviations, amount = result.posterior.deviations(), result.posterior.drawn(DRAWS)
    drawn: dict[str, tuple[Vector, float]] = {}
    for name in names:
        function = result.errors.get(name)
        if name in deviations and function is not None and function.value is not None:
            at = result.posterior.position_mm[name[2]]
            lined = (
                name in DISPLACEMENTS and name not in POSITIONING
            ) or not function.slope_identified
            share = (at - at[0]) / (at[-1] - at[0]) * lined
            moved, found = (
                rows - lined * rows[:, :1] - (rows[:, -1:] - rows[:, :1]) * share
                for rows in (
                    deviations[name],
                    np.interp(at, function.position_mm, function.value)[None],
                )
            )
            if function.u is not None:
                own = np.sqrt(np.sum(moved[1:] ** 2, axis=0))
                stated = np.interp(at, function.position_mm, function.u)
                moved[1:] *= np.divide(stated, own, out=np.ones_like(own), where=own > 0)
            drawn[name] = np.ptp(found + amount @ moved, axis=1), float(np.ptp(found))
    return drawn


def _interval(drawn: Vector, found: float, tolerance: float) -> Interval:
    """Return the interval (k = 2) of the range of a function, from the ranges of drawn machines;
    ``found`` is the range of the estimated function.

    Noise enlarges a range. The estimated range contains the noise once, the ranges of the draws
    contain it twice. The upper end of the interval is that of the draws, so that a range that is
    short by chance is not accepted. The lower end is the smallest of three values: the lower end of
    the draws, this end less twice the bias of the draws, and the lower end of the pivotal interval
    (2 found - high). A function that a table corrects contains only the drawn difference from the
    estimate; ``found`` is then zero.
    """
    low, middle, high = np.quantile(drawn, (TAIL, 0.5, 1.0 - TAIL)).tolist()
    if found:
        low = max(min(low, low - 2.0 * (middle - found), 2.0 * found - high), 0.0)
    return Interval(
        value_um=middle, low_um=low, high_um=high, within=float(np.mean(drawn <= tolerance))
    )


def _range(function: Function | None) -> tuple[float | None, float | None]:
    if function is None or function.value is None:
        return None, None
    low, high = int(np.argmin(function.value)), int(np.argmax(function.value))
    if (
        low == high and function.u is not None
    ):  # a constant function: any two of its values may be the extremes
        low = high = int(np.argmax(function.u))
    u = None if function.u is None else float(np.hypot(function.u[low], function.u[high]))
    return float(function.value[high] - function.value[low]), u
