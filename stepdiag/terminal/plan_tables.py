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

FEW = 7
"""Largest number of lines whose names fit into two lines of a terminal."""
KINDS = {
    "step": message("kind-step"),
    "body": message("kind-body"),
    "face": message("kind-face"),
    "linear": message("kind-linear"),
    "fourdof": message("kind-fourdof"),
}
_ANGLES = {"assumed": message("angles-assumed"), "solved": message("angles-solved")}


def in_words(forecast: Forecast) -> Words:
    """Return runs, time, volumetric uncertainty and how the angular errors are dealt with."""
    runs = ", ".join(
        run.setup + (f" x{run.repeats}" if run.repeats > 1 else "") for run in forecast.plan.runs
    )
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


def _slips(ahead: Foresight) -> Iterator[Words]:
    """Yield the size of a slip of the laser's count that may stay unnoticed, and its effect;
    nothing without a diagonal.
    """
    if ahead.unseen is not None:
        nearly_um = ahead.unseen.nearly_um
        yield (
            ahead.hides()
            if nearly_um is None
            else message("noticed-from", what=ahead.hides(), nearly_um=nearly_um)
        )


def forecast_table(forecast: Forecast) -> Table:
    """Return the expanded uncertainty of every quantity; a quantity that the survey does not
    identify is marked.
    """
    table = empty_table(message("table-forecast"))
    rows = (
        (message("row-positioning"), ("EXX", "EYY", "EZZ"), "µm"),
        (message("row-scale"), AXIS_LETTERS, "µm/m"),
    )
    for word, names, unit in rows:
        table.add_row(shown(word), *(_u(forecast, name) for name in names), unit)
    for component in "XYZ":
        cells = ["" if axis == component else _u(forecast, f"E{component}{axis}") for axis in "XYZ"]
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
    """Return one row per survey that is worth its time, its lines by name if ``verbose``; below it
    the limits of control and head.
    """
    table = empty_table(message("table-front"))
    for each in advice.front:
        table.add_row(
            f"{each.minutes:.0f}",
            each.left_um.best(),
            shown(lines_in_words(each.plan, by_name=verbose)),
        )
    table.caption = shown(joined([*_floor(advice), *_head(advice)]))
    return table


def diagonals_in_words(advice: Advice) -> Message | None:
    """Return the diagonals of the surveys in the list by their corners, with the short name; None
    without a diagonal.
    """
    plans = [advice.forecast.plan, *(each.plan for each in advice.front)]
    lines = {setup_of(setup_of(run.setup).base) for plan in plans for run in plan.runs}
    diagonals = [line for line in lines if not line.axis]
    ordered = sorted(diagonals, key=lambda line: line.order)
    named = [message("setup-named", setup=line.name) for line in ordered]
    return message("diagonals-named", setups=named) if named else None


def _floor(advice: Advice) -> Iterator[Message]:
    if floor_um := advice.forecast.ahead.of.floor_um:
        yield message("tables-leave", floor_um=floor_um)


def _head(advice: Advice) -> Iterator[Message]:
    if (more := advice.with_head) is not None:
        chosen = advice.best or advice.forecast
        minutes, left = more.minutes - chosen.minutes, chosen.left_um.best()
        yield message("head-leaves", before=left, after=more.left_um.best(), minutes=minutes)


def lines_in_words(plan: Plan, *, by_name: bool = True) -> Message:
    """Return the runs of a plan: its setups with their shifts, or the number of each kind if there
    are many, and the way of driving.
    """
    lines = [_line(run) for run in plan.runs] if by_name or len(plan.runs) <= FEW else _kinds(plan)
    orders = next((run.driven_orders for run in plan.runs if run.driven_orders), ())
    first = plan.runs[0]
    ways = message("out-and-back" if first.return_pass else "one-way")
    times = message("times-driven", count=first.repeats, ways=ways) if first.repeats > 1 else ways
    return message(
        "lines-driven",
        lines=lines,
        increments=plan.volume.increments,
        dwell_s=plan.pace.dwell_s,
        times=message("in-orders", times=times, names=orders) if orders[1:] else times,
    )


def _kinds(plan: Plan) -> list[Words]:
    """Return the number of lines of each kind in a plan, and how many of these have a shifted
    laser."""
    counted: list[Words] = []
    for kind, word in KINDS.items():
        runs = [run for run in plan.runs if setup_of(run.setup).kind == kind]
        if runs:
            shifted = sum(any(run.beam_offset_mm) for run in runs)
            of = message("lines-of-kind", count=len(runs), kind=word)
            counted.append(message("of-them-shifted", of=of, shifted=shifted) if shifted else of)
    return counted


def _line(run: Run) -> str:
    shift = " ".join(
        f"{axis}{value:+g}" for axis, value in zip(AXES, run.beam_offset_mm, strict=True) if value
    )
    return f"{run.setup} ({shift} mm)" if shift else run.setup
