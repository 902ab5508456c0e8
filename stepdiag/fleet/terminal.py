"""Trends for people at a terminal, for tables (CSV) and for programs (JSON)."""

import csv
import io
from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Any

from rich.table import Table
from rich.text import Text

from stepdiag.fleet.trend import Leaving, Trend, already_perhaps

HEADER = ("machine", "quantity", "unit", "time", "survey", "value", "U", "event", "software")


def trend_table(trends: Sequence[Trend]) -> Table:
    """Return one row a series: the last figure with its U, since when it is so, where it goes."""
    table = Table(title="trend")
    for column in ("machine", "quantity", "last", "U (k = 2)", "unit", "surveys", "changed last", "a year", "leaves tolerance"):
        table.add_column(column, justify="right" if column in {"last", "U (k = 2)", "surveys", "a year"} else "left")
    for each in trends:
        last = each.last
        expanded = "-" if last.u is None else f"{2 * last.u:.2f}"
        words = (each.series.machine, each.series.quantity, f"{last.value:.2f}", expanded, each.series.unit, str(len(each.series.points)))
        table.add_row(*map(Text, (*words, changed(each), _slope(each), leaves(each))), style="bold" if each.outside == "yes" else "")
    return table


def changed(trend: Trend) -> str:
    """Return the last step in words: since when, by how much, after what; what is not more than its uncertainty is no change."""
    if not trend.steps:
        return f"steadily since {day(trend.line.begins)}" if trend.line is not None else "not more than its uncertainty"
    step = trend.steps[-1]
    after = f", after: {step.after}" if step.after else ""
    return f"{day(step.since)} by {step.change:+.2f} (U {step.expanded:.2f}){after}"


def leaves(trend: Trend) -> str:
    """Return where the series stands against its tolerance, and when it leaves it."""
    if trend.tolerance is None:
        return "-"
    if trend.outside == "yes":
        return f"outside {trend.tolerance:g}"
    if already_perhaps(trend):
        return "perhaps outside already"
    if trend.leaving is None or trend.leaving.likely is None:
        return "no date from these surveys"
    return f"{day(trend.leaving.likely)} ({_edge(trend.leaving.earliest)} to {_edge(trend.leaving.latest)})"


def day(moment: datetime) -> str:
    """Return the day of a moment (UTC)."""
    return moment.date().isoformat()


def as_csv(trends: Sequence[Trend]) -> str:
    """Return every figure of the series, one a row; U is at k = 2."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(HEADER)
    writer.writerows(_rows(trends))
    return out.getvalue()


def as_json(trends: Sequence[Trend]) -> list[dict[str, Any]]:
    """Return the series with what they say, for programs; every U is at k = 2."""
    return [
        {
            "machine": each.series.machine,
            "quantity": each.series.quantity,
            "unit": each.series.unit,
            "points": [
                {
                    "time": point.time.isoformat(), "survey": point.survey, "value": point.value,
                    "U": _expanded(point.u), "event": point.event,
                }
                for point in each.series.points
            ],
            "steps": [
                {"since": step.since.isoformat(), "survey": step.survey, "change": step.change, "U": step.expanded, "after": step.after}
                for step in each.steps
            ],
            "line": None if each.line is None else {
                "begins": each.line.begins.isoformat(), "surveys": each.line.surveys,
                "slope_per_year": each.line.slope, "U": each.line.expanded,
            },
            "tolerance": each.tolerance,
            "outside": each.outside,
            "leaving": _leaving_json(each.leaving),
        }
        for each in trends
    ]  # fmt: skip


def _rows(trends: Sequence[Trend]) -> Iterator[tuple[object, ...]]:
    for each in trends:
        for point in each.series.points:
            yield (
                _safe(each.series.machine), each.series.quantity, each.series.unit, point.time.isoformat(), point.survey,
                repr(point.value), "" if point.u is None else repr(2 * point.u), _safe(point.event), point.software,
            )  # fmt: skip


def _safe(words: str) -> str:
    """Return a text that a spreadsheet shows instead of computing it."""
    return f"'{words}" if words.startswith(("=", "+", "-", "@", "\t")) else words


def _leaving_json(leaving: Leaving | None) -> dict[str, object] | None:
    if leaving is None:
        return None
    moments = {name: getattr(leaving, name) for name in ("earliest", "likely", "latest")}
    return {"tolerance": leaving.tolerance, **{name: None if at is None else at.isoformat() for name, at in moments.items()}}


def _slope(trend: Trend) -> str:
    return "-" if trend.line is None else f"{trend.line.slope:+.2f} ± {trend.line.expanded:.2f}"


def _edge(moment: datetime | None) -> str:
    return "never" if moment is None else day(moment)


def _expanded(u: float | None) -> float | None:
    return None if u is None else 2 * u
