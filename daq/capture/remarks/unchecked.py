"""Signals that the machine does not send, and the checks that are therefore missing: reported
before, during and after a survey.
"""

from collections.abc import Collection, Iterator

import numpy as np

from stepdiag.base.findings import Finding, finding, info, warning
from stepdiag.base.messages import Message, message
from stepdiag.base.setups import setup_of
from stepdiag.daq.capture.conditions import CONDITIONS, needed_conditions
from stepdiag.daq.capture.naming.route import agrees, route_of
from stepdiag.daq.survey.formats import promised
from stepdiag.daq.survey.models import Survey

POSITIONS = ("x_mm", "y_mm", "z_mm")
OF_THE_STOPS = {
    "stop_count": message("without-stop-count"),
    "running": message("without-running"),
    "heartbeat": message("without-heartbeat"),
    "alarm": message("without-alarm"),
}
"""Signals whose absence every survey reports. Other findings report a missing position or setup,
and the result lists missing conditions.
"""
WITHOUT = {
    **OF_THE_STOPS,
    "setup": message("signals-absent.setup"),
    "x_mm": message("without-position"),
    **{name: message("without-condition", name=words) for name, words in CONDITIONS.items()},
}
"""The check that is missing, or uses another source, if the machine does not send a signal; by
signal (contract 2).
"""


def places_known(survey: Survey) -> bool:
    """Return whether the machine sends its commanded position."""
    return survey.plc.silent or all(name in survey.plc.signals for name in POSITIONS)


def unchecked(survey: Survey, without: Collection[str] = ()) -> tuple[Finding, ...]:
    """Return a finding for each check that is impossible because the survey file does not map its
    signal.

    ``without`` are conditions that other findings report.
    """
    if survey.plc.silent:
        return (
            warning("no-signals", whys=list(_without_signals(survey))),
            *assumed(survey, without),
        )
    texts = list(_without_position(survey)) if not places_known(survey) else []
    missing = [
        words for name, words in OF_THE_STOPS.items() if name not in survey.plc.signal_names
    ]
    findings = [warning("signals-absent.position", whys=texts)] if texts else []
    if texts and "setup" not in survey.plc.signal_names and len(_diagonals(survey)) > 1:
        text = message("signals-absent.setup")
        findings.append(finding("warning", text))
    if missing:
        findings.append(info("signals-absent", whys=missing))
    return (*findings, *assumed(survey, without))


def assumed(survey: Survey, without: Collection[str] = ()) -> tuple[Finding, ...]:
    """Return findings about the unmeasured conditions on which the readings depend; none if the
    survey file states them as fixed.
    """
    if survey.environment.source == "fixed":
        return ()
    measured = (*survey.plc.signal_names, *promised(survey))
    needed = needed_conditions(survey)
    unmeasured = [name for name in needed if name not in measured and name not in without]
    values = [
        message(
            "condition-value", name=CONDITIONS[name], value=getattr(survey.environment, name)
        )
        for name in unmeasured
    ]
    if not values:
        return ()
    text = message("air-unknown.plan", values=values)
    return (finding("warning", text),)


def _without_signals(survey: Survey) -> Iterator[Message]:
    """Yield messages of the faults that no check finds if only the laser identifies the stops."""
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
    """Return the axes whose steps along a diagonal give the laser the same reading."""
    if not _diagonals(survey):
        return []
    route = route_of(survey.planned, _diagonals(survey)[0], 1)
    steps = {
        route.axis_to(stop).upper(): float(np.diff(route.nominal_mm)[stop - 1])
        for stop in (1, 2, 3)
    }
    return [
        axis
        for axis, step in steps.items()
        if any(agrees(step, other) for name, other in steps.items() if name != axis)
    ]
