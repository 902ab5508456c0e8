"""The trends of a store as tables for a terminal, as CSV and as JSON."""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Any, Literal

from rich.table import Table
from rich.text import Text

from stepdiag.base.messages import joined, message
from stepdiag.base.result.members import Verdict
from stepdiag.comparing.evolution import Course
from stepdiag.fleet.rows import RMS
from stepdiag.fleet.series import LeftOut, Point
from stepdiag.fleet.trend import Leaving, Trend, already_perhaps, day, statements
from stepdiag.terminal.viewer import empty_table, shown
from stepdiag.texts.texts import UNITS

PHRASES: dict[
    Verdict, Literal["store-conform", "store-not-conform", "store-not-decidable"]
] = {
    "conform": "store-conform",
    "not_conform": "store-not-conform",
    "not_decidable": "store-not-decidable",
}
HEADER = (
    "machine",
    "quantity",
    "unit",
    "time",
    "survey",
    "value",
    "U",
    "low",
    "high",
    "event",
    "software",
    "apart",
)


def trend_table(trends: Sequence[Trend], *, whole: bool) -> Table:
    """Return a table with one row per series: the last value with its U, the trend, the time of
    leaving the tolerance.

    Unless ``whole``, the table contains only the volumetric error of every machine and the series
    that changed or are undecided; the caption contains the number of the omitted series.
    """
    rows = trends if whole else [each for each in trends if _worth_a_row(each)]
    caption = (
        None
        if len(rows) == len(trends)
        else shown(message("more-unchanged", count=len(trends) - len(rows)))
    )
    table = empty_table(message("table-fleet"))
    table.caption = caption
    for each in rows:
        series = each.series
        name = (
            series.quantity if series.other is None else f"{series.quantity} ({series.other})"
        )
        words = shown(joined(statements(each)))
        cells = (
            series.machine,
            name,
            _figure(each.last, UNITS[series.unit]),
            str(len(series.surveys)),
            words,
            leaves(each),
        )
        table.add_row(*map(Text, cells), style="bold" if each.outside == "yes" else "")
    return table


def _worth_a_row(trend: Trend) -> bool:
    alone = len(trend.series.surveys) < 2
    return (
        trend.series.quantity == RMS
        or trend.outside in ("yes", "perhaps")
        or (trend.verdict != "unchanged" and not alone)
    )


def _figure(point: Point, unit: str) -> str:
    if math.isfinite(point.low):
        return f"{point.value:.2f} ({point.low:.2f} to {point.high:.2f}) {unit}"
    return (
        f"{point.value:.2f} {unit}"
        if point.u is None
        else f"{point.value:.2f} ± {2 * point.u:.2f} {unit}"
    )


def leaves(trend: Trend) -> str:
    """Return the verdict about the last value, and the time at which the series leaves its
    tolerance."""
    if trend.conformity is None:
        return "-"
    verdict = shown(message(PHRASES[trend.conformity], limit=trend.tolerance or 0.0))
    return (
        verdict
        if trend.outside == "yes" or already_perhaps(trend)
        else f"{verdict}; {_day_of_leaving(trend)}"
    )


def _day_of_leaving(trend: Trend) -> str:
    if trend.leaving is None or trend.leaving.likely is None:
        return shown(message("no-leaving-date"))
    return (
        f"{day(trend.leaving.likely)} ({_edge(trend.leaving.earliest)} to "
        f"{_edge(trend.leaving.latest)})"
    )


def as_csv(trends: Sequence[Trend]) -> str:
    """Return one row per value of the series, with U at k = 2."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(HEADER)
    writer.writerows(_trend_rows(trends))
    return out.getvalue()


def as_json(trends: Sequence[Trend], left_out: Sequence[LeftOut]) -> dict[str, Any]:
    """Return the series with their trends, and the surveys outside all series, as JSON types; U at
    k = 2."""
    return {
        "series": [_series_json(each) for each in trends],
        "left_out": [_left_out_json(each) for each in left_out],
    }


def _series_json(trend: Trend) -> dict[str, Any]:
    series = trend.series
    return {
        "machine": series.machine,
        "quantity": series.quantity,
        "unit": series.unit,
        "apart": None if series.other is None else str(series.other),
        "points": [
            {
                "time": point.time.isoformat(),
                "survey": point.survey.name,
                "value": point.value,
                "U": _expanded(point.u),
                "low": _finite(point.low),
                "high": _finite(point.high),
                "event": point.survey.event,
            }
            for point in series.points
        ],
        "verdict": trend.verdict,
        "changes": [_course_json(trend, each) for each in trend.explained.courses],
        "further_surveys": trend.explained.further,
        "tolerance": trend.tolerance,
        "outside": trend.outside,
        "conformity": trend.conformity,
        "leaving": _leaving_json(trend.leaving),
    }


def _course_json(trend: Trend, course: Course) -> dict[str, Any]:
    surveys = trend.series.surveys
    return {
        "kind": course.kind,
        "after": surveys[course.first].time.isoformat(),
        "before": surveys[course.last].time.isoformat(),
        "survey": surveys[course.at].name if course.kind == "step" else None,
        "size": course.size,
        "U": 2 * course.u,
        "per_year": course.kind == "line",
        "position_mm": float(trend.series.nodes_mm[course.node])
        if _is_function(trend)
        else None,
        "cause": str(trend.cause(course)) if course.kind == "step" else "",
        "probability": course.probability,
    }


def _is_function(trend: Trend) -> bool:
    return len(trend.series.nodes_mm) > 1


def _left_out_json(left: LeftOut) -> dict[str, Any]:
    return {
        "machine": left.machine,
        "survey": left.name,
        "why": str(left.why),
        "key": left.why.key,
        "damaged": left.damaged,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _trend_rows(trends: Sequence[Trend]) -> Iterator[tuple[object, ...]]:
    for each in trends:
        for point in each.series.points:
            skewed = math.isfinite(point.low)
            yield (
                _safe(each.series.machine),
                each.series.quantity,
                each.series.unit,
                point.time.isoformat(),
                point.survey.name,
                repr(point.value),
                "" if point.u is None else repr(2 * point.u),
                repr(point.low) if skewed else "",
                repr(point.high) if skewed else "",
                _safe(point.survey.event),
                point.survey.software,
                "" if each.series.other is None else _safe(str(each.series.other)),
            )


def _safe(words: str) -> str:
    return f"'{words}" if words.startswith(("=", "+", "-", "@", "\t")) else words


def _leaving_json(leaving: Leaving | None) -> dict[str, object] | None:
    if leaving is None:
        return None
    moments = {name: getattr(leaving, name) for name in ("earliest", "likely", "latest")}
    return {
        "tolerance": leaving.tolerance,
        **{name: None if at is None else at.isoformat() for name, at in moments.items()},
    }


def _edge(moment: datetime | None) -> str:
    return "never" if moment is None else day(moment)


def _expanded(u: float | None) -> float | None:
    return None if u is None else 2 * u
