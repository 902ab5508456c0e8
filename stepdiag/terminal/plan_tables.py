"""Forecasts of the planner as tables that a person reads in a terminal."""

from collections.abc import Iterator
from math import isfinite

from rich.table import Table

from stepdiag.base.conformity import COVERAGE
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.result.result import AXIS_LETTERS, DISPLACEMENTS, ROTATIONS, SQUARENESS
from stepdiag.solver.planning.foresight import Foresight
from stepdiag.solver.planning.planner import Advice, Forecast
from stepdiag.terminal.viewer import empty_table

_ANGLES = {"assumed": "taken as the usual ones of a machine, not measured", "solved": "solved from the readings"}


def in_words(forecast: Forecast) -> str:
    """Return runs, time, volumetric uncertainty and how the angular errors are dealt with."""
    runs = ", ".join(run.setup + (f" x{run.repeats}" if run.repeats > 1 else "") for run in forecast.plan.runs)
    hours, minutes = divmod(round(forecast.minutes), 60)
    return (
        f"{runs}: {hours} h {minutes:02d} min with setting up; an ideal compensation leaves {forecast.left_um.words()} µm "
        f"(rms over the volume, k = 2), {forecast.left_um.best()} µm most probably; angular errors {_ANGLES[forecast.angles]}"
        f"{_slips(forecast.ahead)}"
    )


def _slips(ahead: Foresight) -> str:
    """Return how large a slip of the laser's count may be without being noticed, and what it makes; nothing without a diagonal."""
    if ahead.unseen is None:
        return ""
    sure = f", one of {ahead.unseen.nearly_um:.2g} µm is nearly always noticed (95 %)" if isfinite(ahead.unseen.u_um) else ""
    return f"; {ahead.hides()}{sure}"


def forecast_table(forecast: Forecast) -> Table:
    """Return the expanded uncertainty of every quantity; a quantity that the survey does not identify is named as such."""
    table = empty_table(message("table-forecast"))
    for word, names, unit in (("positioning, shape", ("EXX", "EYY", "EZZ"), "µm"), ("scale", AXIS_LETTERS, "µm/m")):
        table.add_row(word, *(_u(forecast, name) for name in names), unit)
    for component in "XYZ":
        cells = ["" if axis == component else _u(forecast, f"E{component}{axis}") for axis in "XYZ"]
        table.add_row(f"straightness in {component}", *cells, "µm")
    for component, word in zip("ABC", "XYZ", strict=True):
        table.add_row(f"rotation about {word}", *(_u(forecast, f"E{component}{axis}") for axis in "XYZ"), "µrad")
    table.add_section()
    for name, pair in zip(SQUARENESS, ("Y to X", "Z to X", "Z to Y"), strict=True):
        table.add_row(f"squareness {name} ({pair})", _u(forecast, name), "", "", "µrad")
    table.caption = "-: the survey does not identify it" + _resolved(forecast)
    return table


def _u(forecast: Forecast, name: str) -> str:
    u = forecast.u[name]
    return "-" if u is None else f"{COVERAGE * u:.2f}"


def _resolved(forecast: Forecast) -> str:
    if forecast.resolves_all:
        return "; all 18 functions could be solved from the laser's readings alone"
    return f"; {len(forecast.resolved)} of {len((*DISPLACEMENTS, *ROTATIONS))} functions could be solved without assuming the angular ones"


def front_table(advice: Advice) -> Table:
    """Return one row a survey that is worth its time: minutes, what it leaves, what is bought; below it what the control and a head set."""
    table = empty_table(message("table-front"))
    for each in advice.front:
        table.add_row(f"{each.minutes:.0f}", each.left_um.best(), lines_in_words(each.plan))
    table.caption = "; ".join((*_floor(advice), *_head(advice)))
    return table


def _floor(advice: Advice) -> Iterator[str]:
    if floor_um := advice.forecast.ahead.of.floor_um:
        yield f"tables of one axis each leave {floor_um:.2g} um whatever is driven"


def _head(advice: Advice) -> Iterator[str]:
    if (more := advice.with_head) is not None:
        chosen = advice.best or advice.forecast
        minutes, left = more.minutes - chosen.minutes, chosen.left_um.best()
        yield f"a 4-DOF head along each axis: {left} -> {more.left_um.best()} µm, {minutes:.0f} min more"


def lines_in_words(plan: Plan) -> str:
    """Return what a plan drives: its setups with their shifts, and how."""
    lines = ", ".join(_line(run) for run in plan.runs)
    orders = next((f" in the orders {' '.join(run.axis_orders)}" for run in plan.runs if run.axis_orders), "")
    first = plan.runs[0]
    ways = "out and back" if first.return_pass else "one way"
    times = f"{first.repeats} times {ways}" if first.repeats > 1 else ways
    return f"{lines}; {plan.volume.increments} increments, {times}{orders}"


def _line(run: Run) -> str:
    shift = " ".join(f"{axis}{value:+g}" for axis, value in zip(AXES, run.beam_offset_mm, strict=True) if value)
    return f"{run.setup} ({shift} mm)" if shift else run.setup
