"""What the machine does not say, and what therefore nobody can check: said before, during and after a survey."""

from collections.abc import Collection, Iterator

import numpy as np

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Message, message
from stepdiag.base.setups import setup_of
from stepdiag.daq.capture.conditions import CONDITIONS, needed_conditions
from stepdiag.daq.capture.place.route import agrees, route_of
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
OF_THE_STOPS = {
    "stop_count": message("without-stop-count"),
    "running": message("without-running"),
    "heartbeat": message("without-heartbeat"),
    "alarm": message("without-alarm"),
}
"""Those that every survey is told of; position and setup have findings of their own, conditions stand in the result."""


def places_known(survey: Survey) -> bool:
    """Tell whether the machine says where it is commanded to stand."""
    return survey.plc.silent or all(name in survey.plc.signals for name in POSITIONS)


def unchecked(survey: Survey, without: Collection[str] = ()) -> tuple[Finding, ...]:
    """Return what cannot be checked because the survey file maps no signal for it; nothing where every signal is mapped.

    ``without`` are conditions of which somebody else speaks.
    """
    if survey.plc.silent:
        return (finding("warning", message("no-signals", whys=list(_without_signals(survey)))), *assumed(survey, without))
    texts = list(_without_position(survey)) if not places_known(survey) else []
    missing = [said for name, said in OF_THE_STOPS.items() if name not in survey.plc.signal_names]
    findings = [finding("warning", message("signals-absent.position", whys=texts))] if texts else []
    if "setup" not in survey.plc.signal_names and len(_diagonals(survey)) > 1:
        text = message("signals-absent.setup")
        findings.append(finding("warning", text))
    if missing:
        findings.append(finding("info", message("signals-absent", whys=missing)))
    return (*findings, *assumed(survey, without))


def assumed(survey: Survey, without: Collection[str] = ()) -> tuple[Finding, ...]:
    """Return which conditions nobody measures although the readings depend on them; nothing where a person states them as fixed."""
    if survey.environment.source == "fixed":
        return ()
    told = (*survey.plc.signal_names, *promised(survey))
    needed = needed_conditions(survey)
    unsaid = [name for name in needed if name not in told and name not in without]
    values = [message("condition-value", name=CONDITIONS[name], value=getattr(survey.environment, name)) for name in unsaid]
    if not values:
        return ()
    text = message("air-unknown.plan", values=values)
    return (finding("warning", text),)


def _without_signals(survey: Survey) -> Iterator[Message]:
    """Yield what cannot be told apart where the laser alone places and names the stops."""
    yield message("unseen-all")
    yield message("unseen-person")
    yield message("unseen-elsewhere")
    if alike := _alike(survey):
        yield message("unseen-alike-late", axes=alike)
    if any(setup_of(setup).kind == "linear" for setup in survey.plan.setups):
        yield message("unseen-linear")
    yield message("unseen-beam")


def _without_position(survey: Survey) -> Iterator[Message]:
    yield message("unseen-position")
    yield message("unseen-elsewhere")
    if "setup" in survey.plc.signal_names and len(_diagonals(survey)) > 1:
        yield message("unseen-diagonal")
    alike = _alike(survey)
    if alike:
        yield message("unseen-alike", axes=alike)


def _diagonals(survey: Survey) -> list[str]:
    return [name for name in survey.plan.all_setups if setup_of(name).is_diagonal]


def _alike(survey: Survey) -> list[str]:
    """Return the axes whose steps along a diagonal are the same for the laser."""
    if not _diagonals(survey):
        return []
    route = route_of(survey.planned, _diagonals(survey)[0], 1)
    steps = {route.axis_to(stop).upper(): float(np.diff(route.nominal_mm)[stop - 1]) for stop in (1, 2, 3)}
    return [axis for axis, step in steps.items() if any(agrees(step, other) for name, other in steps.items() if name != axis)]
