"""Forecasts of the planner as tables for a terminal."""

from collections.abc import Iterator

from rich.table import Table

from stepdiag.base.conformity import COVERAGE
from stepdiag.base.messages import Message, Words, joined, message
from stepdiag.base.names import AXES
from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.result.result import AXIS_LETTERS, DISPLACEMENTS, ROTATIONS, SQUARENESS
from stepdiag.base.setups import setup_of
from stepdiag.solver.planning.foresight import Foresight
from stepdiag.solver.planning.planner import Advice, Forecast
from stepdiag.terminal.viewer import empty_table, shown

FEW, FEW_OF_A_ROW = 7, 4
"""Largest number of measured lines that are shown by their corners, in a sentence and in a row of a
table. More corners would not fit three lines of text in a terminal, or four lines of text in a
row."""
KINDS = {
    "step": message("kind-step"),
    "body": message("kind-body"),
    "face": message("kind-face"),
    "linear": message("kind-linear"),
    "fourdof": message("kind-fourdof"),
}
_ANGLES = {"assumed": message("angles-assumed"), "solved": message("angles-solved")}


def in_words(forecast: Forecast, *, by_name: bool) -> Words:
    """Return a sentence about a forecast: runs, time, volumetric uncertainty, and the treatment of
    the angular errors."""
    lines = forecast.plan.runs
    few = by_name or len(lines) <= FEW
    runs = [_repeated(run) for run in lines] if few else _kinds(forecast.plan)
    hours, minutes = divmod(round(forecast.minutes), 60)
    about = message(
        "forecast",
        runs=runs,
        hours=hours,
        minutes=f"{minutes:02d}",
        left=forecast.left_um.words(),
        best=forecast.left_um.best(),
        angles=_ANGLES[forecast.angles],
    )
    return joined([about, *_slips(forecast.ahead)])


def _repeated(run: Run) -> Words:
    named = message("setup-named", setup=run.setup)
    return message("run-repeated", of=named, count=run.repeats) if run.repeats > 1 else named


def _slips(ahead: Foresight) -> Iterator[Words]:
    if ahead.unseen is not None:
        nearly_um = ahead.unseen.nearly_um
        yield (
            ahead.hides()
            if nearly_um is None
            else message("noticed-from", what=ahead.hides(), nearly_um=nearly_um)
        )


def forecast_table(forecast: Forecast) -> Table:
    """Return a table of the expanded uncertainty of every quantity; an unidentified quantity is
    marked."""
    table = empty_table(message("table-forecast"))
    rows = (
        (message("row-positioning"), ("EXX", "EYY", "EZZ"), "µm"),
        (message("row-scale"), AXIS_LETTERS, "µm/m"),
    )
    for word, names, unit in rows:
        table.add_row(shown(word), *(_u(forecast, name) for name in names), unit)
    for component in "XYZ":
        cells = [
            "" if axis == component else _u(forecast, f"E{component}{axis}") for axis in "XYZ"
        ]
        table.add_row(shown(message("row-straightness", axis=component)), *cells, "µm")
    for component, about in zip("ABC", "XYZ", strict=True):
        table.add_row(
            shown(message("row-rotation", axis=about)),
            *(_u(forecast, f"E{component}{axis}") for axis in "XYZ"),
            "µrad",
        )
    table.add_section()
    for name, pair in zip(SQUARENESS, ("YX", "ZX", "ZY"), strict=True):
        table.add_row(
            shown(message("row-squareness", name=name, one=pair[0], other=pair[1])),
            _u(forecast, name),
            "",
            "",
            "µrad",
        )
    table.caption = shown(message("forecast-caption", what=_resolved(forecast)))
    return table


def _u(forecast: Forecast, name: str) -> str:
    u = forecast.u[name]
    return "-" if u is None else f"{COVERAGE * u:.2f}"


def _resolved(forecast: Forecast) -> Message:
    if forecast.resolves_all:
        return message("resolves-all")
    return message(
        "resolves-some", count=len(forecast.resolved), of=len((*DISPLACEMENTS, *ROTATIONS))
    )


def front_table(advice: Advice, *, verbose: bool) -> Table:
    """Return a table with one row per recommended survey, and below it the limits of control and
    head; ``verbose`` adds the lines of each survey."""
    table = empty_table(message("table-front"))
    for each in advice.front:
        table.add_row(
            f"{each.minutes:.0f}",
            each.left_um.best(),
            shown(lines_in_words(each.plan, by_name=verbose)),
        )
    table.caption = shown(joined([*_floor(advice), *_head(advice)]))
    return table


def _floor(advice: Advice) -> Iterator[Message]:
    if floor_um := advice.forecast.ahead.of.floor_um:
        yield message("tables-leave", floor_um=floor_um)


def _head(advice: Advice) -> Iterator[Message]:
    if (more := advice.with_head) is not None:
        chosen = advice.best or advice.forecast
        minutes, left = more.minutes - chosen.minutes, chosen.left_um.best()
        yield message("head-leaves", before=left, after=more.left_um.best(), minutes=minutes)


def lines_in_words(plan: Plan, *, by_name: bool = True) -> Message:
    """Return a text about the runs of a plan: the setups with their shifts, or for many setups the
    number of each kind, and the passes."""
    few = by_name or len(plan.runs) <= FEW_OF_A_ROW
    lines = [_run_words(run) for run in plan.runs] if few else _kinds(plan)
    orders = next((run.driven_orders for run in plan.runs if run.driven_orders), ())
    first = plan.runs[0]
    ways = message("out-and-back" if first.return_pass else "one-way")
    times = (
        message("times-driven", count=first.repeats, ways=ways) if first.repeats > 1 else ways
    )
    return message(
        "lines-driven",
        lines=lines,
        increments=plan.volume.increments,
        dwell_s=plan.pace.dwell_s,
        times=message("in-orders", times=times, names=orders) if orders[1:] else times,
    )


def _kinds(plan: Plan) -> list[Words]:
    counted: list[Words] = []
    for kind, word in KINDS.items():
        runs = [run for run in plan.runs if setup_of(run.setup).kind == kind]
        if runs:
            shifted = sum(any(run.beam_offset_mm) for run in runs)
            of = message("lines-of-kind", count=len(runs), kind=word)
            counted.append(
                message("of-them-shifted", of=of, shifted=shifted) if shifted else of
            )
    return counted


def _run_words(run: Run) -> Words:
    named = message("setup-named", setup=run.setup)
    shift = " ".join(
        f"{axis}{value:+g}"
        for axis, value in zip(AXES, run.beam_offset_mm, strict=True)
        if value
    )
    return message("run-shifted", of=named, shift=shift) if shift else named
