"""What the machine does not say, and what therefore nobody can check: said before, during and after a survey."""

from collections.abc import Collection, Iterator

import numpy as np

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import message
from stepdiag.base.setups import setup_of
from stepdiag.daq.capture.conditions import needed_conditions
from stepdiag.daq.capture.place.route import agrees, make_route
from stepdiag.daq.survey.formats import promised
from stepdiag.daq.survey.models import Survey

POSITIONS = ("x_mm", "y_mm", "z_mm")
WITHOUT = {
    "stop_count": "a stop that was not seen on Modbus is known by the laser alone, and no handshake is possible",
    "running": "an aborted program is known by where the laser says the machine is",
    "heartbeat": "a control that no longer renews its signals is not noticed",
    "alarm": "an alarm in a pass is not noticed",
    "setup": "which setup runs is told by the plan alone",
    "x_mm": "the commanded position is not checked against the survey",
    "material_temperature_c": "the material temperature is taken from [environment]",
    "air_temperature_c": "the air temperature is taken from [environment]",
    "air_pressure_hpa": "the air pressure is taken from [environment]",
    "relative_humidity_percent": "the humidity is taken from [environment]",
}
"""What can no longer be checked, or is taken from elsewhere, without a signal (contract 2)."""
OF_THE_STOPS = ("stop_count", "running", "heartbeat", "alarm")
"""Those that every survey is told of; position and setup have findings of their own, conditions stand in the result."""


def places_known(survey: Survey) -> bool:
    """Tell whether the machine says where it is commanded to stand."""
    return survey.plc.silent or all(name in survey.plc.signals for name in POSITIONS)


def unchecked(survey: Survey, without: Collection[str] = ()) -> tuple[Finding, ...]:
    """Return what cannot be checked because the survey file maps no signal for it; nothing where every signal is mapped.

    ``without`` are conditions of which somebody else speaks.
    """
    if survey.plc.silent:
        return (Finding(code="no-signals", severity="warning", text="; ".join(_without_signals(survey))), *assumed(survey, without))
    texts = list(_without_position(survey)) if not places_known(survey) else []
    missing = [f"without {name} {WITHOUT[name]}" for name in OF_THE_STOPS if name not in survey.plc.signal_names]
    findings = [Finding(code="signals-absent", severity="warning", text=f"{'; '.join(texts)}")] if texts else []
    if "setup" not in survey.plc.signal_names and len(_diagonals(survey)) > 1:
        text = message("signals-absent.setup")
        findings.append(finding("warning", text))
    if missing:
        findings.append(Finding(code="signals-absent", severity="info", text="; ".join(missing)))
    return (*findings, *assumed(survey, without))


def assumed(survey: Survey, without: Collection[str] = ()) -> tuple[Finding, ...]:
    """Return which conditions nobody measures although the readings depend on them; nothing where a person states them as fixed."""
    if survey.environment.source == "fixed":
        return ()
    told = (*survey.plc.signal_names, *promised(survey))
    needed = needed_conditions(survey)
    values = [f"{name} {getattr(survey.environment, name):g}" for name in needed if name not in told and name not in without]
    if not values:
        return ()
    text = message("air-unknown.plan", values=values)
    return (finding("warning", text),)


def _without_signals(survey: Survey) -> Iterator[str]:
    """Yield what cannot be told apart where the laser alone places and names the stops."""
    yield "the machine says nothing: the stops are placed and named by the laser's plateaus, each at its planned position"
    yield "which setup is driven is what a person says, for the laser all body diagonals are alike"
    yield "a program that drives elsewhere is noticed only where a step is off by more than 2 % and 20 um"
    if alike := _alike(survey):
        text = f"{' and '.join(alike)} make the same step along the diagonal, so the laser cannot tell which of them moved"
        yield f"{text}, nor a pass that begins one stop too early or too late"
    if any(setup_of(setup).kind == "linear" for setup in survey.plan.setups):
        yield "all steps of a linear run are alike: one that begins a stop too early or too late is noticed only by the way back"
    yield "a lost beam ends the pass, and an alarm or a control that hangs is not noticed"


def _without_position(survey: Survey) -> Iterator[str]:
    yield "the commanded position is not read, so every stop is taken to be where the plan has it"
    yield "a program that drives elsewhere is noticed only where a step is off by more than 2 % and 20 um"
    if "setup" in survey.plc.signal_names and len(_diagonals(survey)) > 1:
        yield "a program that drives another diagonal than its setup code is not noticed: for the laser all body diagonals are alike"
    alike = _alike(survey)
    if alike:
        yield f"{' and '.join(alike)} make the same step along the diagonal, so the laser cannot tell which of them moved"


def _diagonals(survey: Survey) -> list[str]:
    return [name for name in survey.plan.all_setups if setup_of(name).is_diagonal]


def _alike(survey: Survey) -> list[str]:
    """Return the axes whose steps along a diagonal are the same for the laser."""
    if not _diagonals(survey):
        return []
    route = make_route(survey.volume, _diagonals(survey)[0], survey.axis_order, outward=True)
    steps = {route.axis_to(stop).upper(): float(np.diff(route.nominal_mm)[stop - 1]) for stop in (1, 2, 3)}
    return [axis for axis, step in steps.items() if any(agrees(step, other) for name, other in steps.items() if name != axis)]
