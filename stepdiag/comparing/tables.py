"""Comparisons of results as tables for a terminal."""

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from stepdiag.base.messages import message
from stepdiag.base.result.result import Result
from stepdiag.comparing.compare import Change, Comparison, Trend
from stepdiag.terminal.printable import printable
from stepdiag.terminal.viewer import empty_table, shown
from stepdiag.texts.texts import UNITS

WHICH = ("machine", "machine_serial", "survey", "begun")
"""Members of a result's ``survey`` that distinguish results; results from readings of another
program can lack some of them."""


def which(result: Result) -> dict[str, str]:
    """Return a text with machine, serial number, name and beginning of the survey of a result, as
    far as known."""
    return {name: value for name in WHICH if (value := getattr(result.survey, name, ""))}


def sources(results: Sequence[Result]) -> Text:
    """Return one line per result: its file and its survey."""
    of = [
        ", ".join(which(one).values()) or shown(message("neither-machine-nor-time"))
        for one in results
    ]
    return Text(
        "\n".join(
            printable(f"{one.source}: {words}")
            for one, words in zip(results, of, strict=True)
        )
    )


def comparison_table(comparison: Comparison, before: str, after: str) -> Table:
    """Return one row per quantity: both values, their difference with its U, and whether the
    difference exceeds U."""
    table = empty_table(message("table-changes"))
    table.title = Text(f"{before} -> {after}")
    for change in comparison.changes:
        table.add_row(*_change_row(change), style="bold" if change.significant else "")
    return table


def _change_row(change: Change) -> tuple[str, ...]:
    expanded = None if change.u is None else 2 * change.u
    numbers = (
        _shown(change.position_mm, 0),
        *(_shown(v) for v in (change.before, change.after, change.difference, expanded)),
    )
    return change.name, *numbers, UNITS[change.unit], change.verdict or "-"


def _shown(value: float | None, decimals: int = 2) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def trend_table(trends: Sequence[Trend], names: Sequence[str]) -> Table:
    """Return one row per quantity and one column per result: the values with their U."""
    table = empty_table(message("table-trends"))
    for name in names:
        table.add_column(Text(name), justify="right")
    for one in trends:
        cells = [
            _shown(value) + ("" if u is None else f" ± {2 * u:.2f}")
            for value, u in zip(one.values, one.u, strict=True)
        ]
        table.add_row(one.name, UNITS[one.unit], *cells)
    return table
