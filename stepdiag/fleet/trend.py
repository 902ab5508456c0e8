"""What changed on a machine, since when and after what; where a straight line is justified, and when it leaves the tolerance.

A change between two surveys counts when it is larger than its expanded uncertainty at k = 2, so widened (Sidak) that all comparisons of
one series together err as seldom as one. A line is weighted least squares through the surveys since the last step; it is justified with at
least `FEWEST` of them, a slope beyond its k = 2, residuals that their uncertainties explain (chi-squared, 1 %), and no step that explains
the figures better.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cache

import numpy as np
from numpy.typing import NDArray

from stepdiag.comparing.compare import coverage_factor
from stepdiag.fleet.history import Point, Series

Array = NDArray[np.float64]
FEWEST = 4
YEAR = timedelta(days=365.25)
LATEST = datetime(2200, 1, 1, tzinfo=UTC)
"""Beyond this a date says nothing of a machine."""
_IMPROBABLE = 2.326
"""The normal quantile of 99 %, for the chi-squared of a line (Wilson and Hilferty 1931)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A change between two surveys that is more than its uncertainty; ``after`` is what happened in between, empty where unknown."""

    since: datetime
    survey: str
    change: float
    expanded: float
    """Its U (k = 2)."""
    after: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """The straight line through the surveys since the last step: ``slope`` a year, with its U (k = 2)."""

    begins: datetime
    surveys: int
    slope: float
    expanded: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaving:
    """When the line reaches the tolerance, and between which dates at k = 2; None is not before `LATEST`. ``tolerance`` has its sign."""

    tolerance: float
    earliest: datetime | None
    likely: datetime | None
    latest: datetime | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """What one series says. ``outside`` is None without a tolerance, else whether the last survey is beyond it for sure or perhaps."""

    series: Series
    steps: tuple[Step, ...]
    line: Line | None
    leaving: Leaving | None
    tolerance: float | None
    outside: str | None

    @property
    def last(self) -> Point:
        """Return the newest survey's figure."""
        return self.series.points[-1]


def trend_of(series: Series, tolerance: float | None = None) -> Trend:
    """Return what a series says; ``tolerance`` is the largest magnitude allowed, in the series' unit."""
    points = [point for point in series.points if point.u is not None]
    begins = _stretches(points)
    begin = begins[-1] if begins else 0
    steps = _steps(points, begins)
    fitted = _fitted(points[begin:])
    line, leaving = None, None
    if fitted is not None:
        slope, u_slope = fitted.slope, math.sqrt(fitted.covariance[1][1])
        line = Line(begins=points[begin].time, surveys=len(points) - begin, slope=slope, expanded=2 * u_slope)
        leaving = _leaving(fitted, points[-1].time, tolerance) if tolerance is not None else None
    return Trend(
        series=series, steps=steps, line=line, leaving=leaving, tolerance=tolerance, outside=_outside(series.points[-1], tolerance)
    )


def severity(trend: Trend) -> float:
    """Return how bad the last figure is: against its tolerance where there is one, else against its own U."""
    last = trend.last
    scale = trend.tolerance or 2 * (last.u or 0.0)
    return abs(last.value) / scale if scale else abs(last.value)


def already_perhaps(trend: Trend) -> bool:
    """Tell whether the last figure may be beyond the tolerance within its U, and no later day is known on which it would be."""
    likely = None if trend.leaving is None else trend.leaving.likely
    return trend.outside == "perhaps" and (likely is None or likely <= trend.last.time)


def _stretches(points: Sequence[Point]) -> list[int]:
    """Return where each stretch begins, oldest first."""
    begins: list[int] = []
    end = len(points)
    while end:
        end = _begin_of_stretch(points[:end])
        begins.insert(0, end)
    return begins


def _begin_of_stretch(points: Sequence[Point]) -> int:
    """Return the earliest survey from which on a constant or a line explains all of them up to the last."""
    years = np.array([(point.time - points[-1].time) / YEAR for point in points])[::-1]
    values = np.array([point.value - points[-1].value for point in points])[::-1]
    weights = np.array([(point.u or np.inf) ** -2.0 for point in points])[::-1]
    sum_w, sum_x, sum_y = (np.cumsum(weights * each) for each in (1.0, years, values))
    with np.errstate(divide="ignore", invalid="ignore"):
        around = np.cumsum(weights * values**2) - sum_y**2 / sum_w
        spread = np.cumsum(weights * years**2) - sum_x**2 / sum_w
        together = np.cumsum(weights * years * values) - sum_x * sum_y / sum_w
        around_line = around - np.where(spread > 0, together**2 / spread, 0.0)
    counts = np.arange(1, len(points) + 1)
    allowed = np.array([0.0, *(_largest_misfit(int(freedom)) for freedom in counts[:-1])])
    constant = (counts == 1) | (around <= allowed)
    line = np.zeros(len(points), dtype=bool)
    line[FEWEST - 1 :] = around_line[FEWEST - 1 :] <= allowed[FEWEST - 2 : len(points) - 1]
    return len(points) - 1 - int(np.flatnonzero(constant | line)[-1])


def _steps(points: Sequence[Point], begins: Sequence[int]) -> tuple[Step, ...]:
    factor = coverage_factor(max(len(points) - 1, 1))
    found = []
    for at in begins[1:]:
        before, after = points[at - 1], points[at]
        u = math.hypot(before.u or 0.0, after.u or 0.0)
        change = after.value - before.value
        if abs(change) > factor * u:
            found.append(Step(since=after.time, survey=after.survey, change=change, expanded=2 * u, after=_cause(before, after)))
    return tuple(found)


def _cause(before: Point, after: Point) -> str:
    """Return what the survey says of the time before it, and that other tables are loaded where they are."""
    loaded = ["other compensation files loaded"] if before.active != after.active else []
    return "; ".join([*([after.event] if after.event else []), *loaded])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fitted:
    """Value and slope a year at the mean time, with their covariance."""

    at: datetime
    value: float
    slope: float
    covariance: tuple[tuple[float, float], tuple[float, float]]


def _fitted(points: Sequence[Point]) -> _Fitted | None:
    """Return the line through the points of a stretch; None where it is not justified."""
    if len(points) < FEWEST or any(not point.u for point in points):
        return None
    mean = datetime.fromtimestamp(float(np.mean([point.time.timestamp() for point in points])), UTC)
    years = np.array([(point.time - mean) / YEAR for point in points])
    value, u = np.array([point.value for point in points]), np.array([point.u for point in points], dtype=float)
    if np.ptp(years) == 0.0:
        return None
    design = np.column_stack([np.ones(len(points)), years])
    weighted = design / u[:, None]
    covariance = np.linalg.inv(weighted.T @ weighted)
    level, slope = covariance @ weighted.T @ (value / u)
    if abs(slope) <= 2 * math.sqrt(covariance[1, 1]) or _rather_a_step(value, u, value - design @ np.array([level, slope])):
        return None
    (a, b), (c, d) = covariance.tolist()
    return _Fitted(at=mean, value=float(level), slope=float(slope), covariance=((a, b), (c, d)))


def _rather_a_step(value: Array, u: Array, beside_line: Array) -> bool:
    """Tell whether two levels, one before and one behind some survey, explain the figures better than a line does.

    ``beside_line`` are the figures less that line. What is common to all surveys is in their U, so a step may be within it and yet be no
    drift; a line through it would go on for ever.
    """
    weights, value = u**-2.0, value - value[-1]
    sums = [np.cumsum(weights * each) for each in (1.0, value, value**2)]
    before, behind = [each[:-1] for each in sums], [each[-1] - each[:-1] for each in sums]
    around = sum(squares - firsts**2 / total for total, firsts, squares in (before, behind))
    return bool(np.min(around) < np.sum(weights * beside_line**2))


@cache
def _largest_misfit(freedom: int) -> float:
    """Return the chi-squared that is exceeded in one case of a hundred."""
    return float(freedom * (1 - 2 / (9 * freedom) + _IMPROBABLE * math.sqrt(2 / (9 * freedom))) ** 3)


def _leaving(fitted: _Fitted, now: datetime, tolerance: float) -> Leaving:
    """Return when the line, and its band at k = 2, cross the tolerance towards which it runs; a date in the past stands for now."""
    limit = math.copysign(tolerance, fitted.slope)
    rising = math.copysign(1.0, fitted.slope)

    def crossing(k: float) -> datetime | None:
        """Find by bisection where the line, moved outwards by k standard uncertainties, first reaches the limit."""

        def beyond(moment: datetime) -> bool:
            years = (moment - fitted.at) / YEAR
            (a, b), (c, d) = fitted.covariance
            u = math.sqrt(max(a + years * (b + c) + years * years * d, 0.0))
            return rising * (fitted.value + fitted.slope * years + rising * k * u - limit) >= 0

        if beyond(now):
            return now
        if not beyond(LATEST):
            return None
        low, high = now, LATEST
        while high - low > timedelta(hours=12):
            middle = low + (high - low) / 2
            low, high = (low, middle) if beyond(middle) else (middle, high)
        return high

    return Leaving(tolerance=limit, earliest=crossing(2.0), likely=crossing(0.0), latest=crossing(-2.0))


def _outside(last: Point, tolerance: float | None) -> str | None:
    if tolerance is None:
        return None
    expanded = 2 * (last.u or 0.0)
    if abs(last.value) - expanded > tolerance:
        return "yes"
    return "perhaps" if abs(last.value) + expanded > tolerance else "no"
