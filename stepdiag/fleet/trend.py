"""Changes of each machine of a store, their time and cause, and the time at which a quantity leaves
its tolerance.

`stepdiag.comparing.evolution` contains the model of a machine over time. A quantity has a date of
leaving its tolerance only if an accepted line leads towards the tolerance.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conformity import verdict_of
from stepdiag.base.messages import Message, message
from stepdiag.base.result.members import Verdict as Conforming
from stepdiag.comparing.chance import Verdict
from stepdiag.comparing.evolution import (
    HELD,
    Calendar,
    Course,
    Explained,
    Figures,
    explained,
    fit,
    scatter,
    waves_of,
)
from stepdiag.fleet.series import OF_VOLUME, Point, Series, Survey
from stepdiag.texts.texts import UNITS

Array = NDArray[np.float64]
YEAR = timedelta(days=365.25)
LATEST = datetime(2200, 1, 1, tzinfo=UTC)
"""Latest date that is reported: a later date contains no information about a machine."""
STATES = ("yes", "perhaps", "no")
CONFORMITY: dict[str, Conforming] = {
    "yes": "not_conform",
    "perhaps": "not_decidable",
    "no": "conform",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaving:
    """The time at which the line of a series reaches the tolerance, and the interval of this time
    at k = 2. A time is None if it is after `LATEST`. ``tolerance`` is negative for a falling
    line."""

    tolerance: float
    earliest: datetime | None
    likely: datetime | None
    latest: datetime | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """The trend of a series.

    ``outside`` states whether the last value is outside its tolerance: "yes", "perhaps" or "no",
    None without a tolerance. A value without uncertainty is "perhaps" outside.
    """

    series: Series
    explained: Explained
    leaving: Leaving | None
    tolerance: float | None
    outside: str | None

    @property
    def last(self) -> Point:
        return self.series.point(-1)

    @property
    def conformity(self) -> Conforming | None:
        """Return the verdict about the last value by ISO 14253-1; None without a tolerance."""
        return None if self.outside is None else CONFORMITY[self.outside]

    @property
    def verdict(self) -> Verdict:
        """Return the verdict about the quantity: changed, unchanged or undecided."""
        return self.explained.verdict

    @property
    def line(self) -> Course | None:
        """Return the line of the quantity's course that still continues, None without a line."""
        return next((each for each in self.explained.courses if each.kind == "line"), None)

    @property
    def steps(self) -> tuple[Course, ...]:
        """Return the sudden changes (steps) of the quantity."""
        return tuple(each for each in self.explained.courses if each.kind == "step")

    def cause(self, course: Course) -> Message | str:
        """Return the possible causes of a step: the event stated in a survey between the last
        survey before the step and the first survey after it, and the loading of tables. The result
        is empty without a cause."""
        surveys = self.series.surveys
        named = [
            surveys[at].event
            for at in (course.at, *range(course.first + 1, course.last + 1))
            if surveys[at].event
        ]
        loaded = surveys[course.at - 1].active != surveys[course.at].active
        if not loaded:
            return named[0] if named else ""
        return (
            message("event-and-tables", event=named[0]) if named else message("tables-loaded")
        )


def trends_of(
    series: Sequence[Series], tolerance: Callable[[str, str], float | None]
) -> list[Trend]:
    """Return the trend of every series; ``tolerance`` returns the largest permitted magnitude of a
    quantity of a machine, if any."""
    found: dict[int, Trend] = {}
    for _, group in groupby(enumerate(series), key=lambda item: item[1].machine):
        alike: dict[str, list[int]] = {}
        for number, each in group:
            alike.setdefault("" if each.other is None else str(each.other), []).append(number)
        for numbers in alike.values():
            found |= zip(
                numbers,
                _of_machine([series[number] for number in numbers], tolerance),
                strict=True,
            )
    return [found[number] for number in range(len(series))]


def _of_machine(
    series: Sequence[Series], tolerance: Callable[[str, str], float | None]
) -> Iterator[Trend]:
    surveys = sorted(
        {each.name: each for one in series for each in one.surveys}.values(),
        key=lambda each: (each.time, each.name),
    )
    place = {each.name: number for number, each in enumerate(surveys)}
    figures, rows = [], []
    for each in series:
        mine = np.array([place[survey.name] for survey in each.surveys])
        whole = [np.full((len(surveys), each.values.shape[1]), np.nan) for _ in range(3)]
        for full, part in zip(whole, (each.values, _own(each), each.u), strict=True):
            full[mine] = part
        figures.append(Figures(values=whole[0], u_own=whole[1], u=whole[2]))
        rows.append(mine)
    calendar = _calendar(surveys)
    beyond = scatter(figures, calendar)
    wide = [each.widened(beyond) for each in figures]
    found = explained(wide, calendar)
    moved = any(each.verdict == "changed" for each in found)
    for each, mine, one in zip(series, rows, found, strict=True):
        own = one.renumbered({int(at): number for number, at in enumerate(mine)})
        if moved and each.quantity in OF_VOLUME and own.verdict == "unchanged":
            own = Explained(
                verdict="undecided", courses=()
            )  # a part of the volumetric error changed, by less than its own U shows
        allowed = tolerance(each.machine, each.quantity)
        yield Trend(
            series=each,
            explained=own,
            leaving=None if allowed is None else _leaving(each, own, beyond, allowed),
            tolerance=allowed,
            outside=None if allowed is None else _outside(each.point(-1), allowed),
        )


def _calendar(surveys: Sequence[Survey]) -> Calendar:
    first = surveys[0].time
    loaded = [False, *(one.active != other.active for one, other in pairwise(surveys))]
    return Calendar(
        years=np.array([(each.time - first) / YEAR for each in surveys]),
        broken=np.array(loaded),
        named=np.array([bool(each.event) for each in surveys]),
    )


def _own(series: Series) -> Array:
    """Return the part of the uncertainty that differs from survey to survey, shape (surveys,
    nodes).

    The part that is common to surveys with the usual instruments is left out. Surveys with other
    instruments have another common part. It is the same deviation in n surveys, so it is treated as
    an independent deviation of sqrt(n) times this size in each of the n surveys.
    """
    common = series.common[:, None] * series.u
    squared = series.u**2 - common**2
    named = [survey.standing.instruments for survey in series.surveys]
    usual = max(named, key=named.count)
    for other in set(named) - {usual}:
        mine = np.array([name == other for name in named])
        squared[mine] += np.count_nonzero(mine) * (
            common[mine] ** 2 + np.mean(common[~mine] ** 2, axis=0)
        )
    own: Array = np.sqrt(np.maximum(squared, 0.0))
    return own


def rank(trend: Trend) -> tuple[int, float]:
    """Return a key that sorts trends by their last value. The first number is that of the state of
    the value (outside, perhaps, inside). The second number is the ratio of the value to its
    tolerance, or without a tolerance to its U."""
    last = trend.last
    scale = trend.tolerance or 2 * (last.u or 0.0)
    beyond = STATES.index(trend.outside) if trend.outside in STATES else len(STATES)
    return -beyond, abs(last.value) / scale if scale else abs(last.value)


def _leaving(
    series: Series, found: Explained, scattered: float, tolerance: float
) -> Leaving | None:
    """Return the time at which the line of a series, and its band at k = 2, cross the tolerance;
    for a date in the past the time of the last survey.

    None without a line, or for a line away from the tolerance. For a quantity with a season, the
    mean over the year is used.
    """
    line = next((each for each in found.courses if each.kind == "line"), None)
    kept = np.isfinite(series.shown[:, 1]) & (series.shown[:, 1] > 0)
    if line is None or np.count_nonzero(kept) < 3:
        return None
    times = [survey.time for survey in series.surveys]
    years = np.array([(time - times[-1]) / YEAR for time in times])
    loaded = np.flatnonzero(_calendar(series.surveys).broken).tolist()
    steps = sorted({*loaded, *(each.at for each in found.courses if each.kind == "step")})
    waves = waves_of(years) if any(each.kind == "season" for each in found.courses) else ()
    design = np.column_stack(
        [
            np.ones(len(years)),
            years,
            *(-(np.arange(len(years)) < at).astype(float) for at in steps),
            *waves,
        ]
    )
    weights = (1 - series.common[kept] ** 2 + scattered**2) ** -1.0 * series.shown[
        kept, 1
    ] ** -2.0
    amounts, covariance = fit(_centred(series)[kept, None], weights[:, None], design[kept])
    level, slope = float(amounts[0, 0]), float(amounts[1, 0])
    magnitude = len(series.nodes_mm) > 1 or series.quantity in OF_VOLUME
    if slope == 0.0 or (magnitude and slope < 0):
        return None
    rising = math.copysign(1.0, slope)
    offset = float(series.common[-1] * series.shown[-1, 1])
    band = covariance[0, :2, :2] + np.array([[offset**2, 0.0], [0.0, 0.0]])
    limit = rising * tolerance

    def crossing(k: float) -> datetime | None:
        """Find by bisection where the line, moved outwards by k standard uncertainties, first
        reaches the limit."""

        def beyond(year: float) -> bool:
            at = np.array([1.0, year])
            return (
                rising * (level + slope * year - limit)
                + k * math.sqrt(max(float(at @ band @ at), 0.0))
                >= 0
            )

        low, high = 0.0, (LATEST - times[-1]) / YEAR
        if beyond(low):
            return times[-1]
        if not beyond(high):
            return None
        while high - low > 1e-3:
            middle = (low + high) / 2
            low, high = (low, middle) if beyond(middle) else (middle, high)
        return times[-1] + high * YEAR

    latest = crossing(-2.0) if line.probability >= HELD else None  # else it may level off
    return Leaving(
        tolerance=limit, earliest=crossing(2.0), likely=crossing(0.0), latest=latest
    )


def _centred(series: Series) -> Array:
    middle = series.shown[:, 2:].mean(axis=1)
    centred: Array = np.where(np.isfinite(middle), middle, series.shown[:, 0])
    return centred


def _outside(last: Point, tolerance: float) -> str:
    low, high = (
        last.interval() if last.u is not None or math.isfinite(last.low) else (None, None)
    )
    verdict = verdict_of(low, high, tolerance)
    return next(state for state, of in CONFORMITY.items() if of == verdict)


def already_perhaps(trend: Trend) -> bool:
    """Return whether the interval of the last value extends beyond the tolerance, so that no
    future date can be given."""
    likely = None if trend.leaving is None else trend.leaving.likely
    return trend.outside == "perhaps" and (likely is None or likely <= trend.last.time)


def statements(trend: Trend) -> list[Message]:
    """Return the trend of a quantity in words: one message per change, or only the verdict without
    a change."""
    if trend.explained.courses:
        return [_statement(trend, each) for each in trend.explained.courses]
    if trend.verdict == "unchanged":
        return [message("trend-unchanged")]
    further = trend.explained.further
    return [
        message("trend-undecided-open")
        if further is None
        else message("trend-undecided", count=further)
    ]


def _statement(trend: Trend, course: Course) -> Message:
    unit, surveys = UNITS[trend.series.unit], trend.series.surveys
    first, last = (day(surveys[at].time) for at in (course.first, course.last))
    expanded = 2 * course.u
    if course.kind == "line":
        return message(
            "trend-line", slope=course.size, unit=unit, expanded=expanded, first=first
        )
    if course.kind == "run-in":
        return message(
            "trend-run-in", change=course.size, unit=unit, expanded=expanded, first=first
        )
    if course.kind == "season":
        return message("trend-season", change=course.size, unit=unit, expanded=expanded)
    after = trend.cause(course)
    if after:
        return message(
            "trend-step-after",
            change=course.size,
            unit=unit,
            expanded=expanded,
            first=first,
            last=last,
            after=after,
        )
    return message(
        "trend-step", change=course.size, unit=unit, expanded=expanded, first=first, last=last
    )


def day(moment: datetime) -> str:
    return moment.date().isoformat()
