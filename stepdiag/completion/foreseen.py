"""Weaknesses of a survey that its plan shows before the drive."""

from collections.abc import Iterator
from pathlib import Path

from stepdiag.base.errors import UsageError
from stepdiag.base.findings import Finding, info
from stepdiag.base.names import AXES, BODY_DIAGONALS
from stepdiag.base.volume import MOST_INCREMENTS, in_step
from stepdiag.daq.survey.assumed import assumptions_of
from stepdiag.daq.survey.models import Head, Survey
from stepdiag.daq.survey.rules import least_dwell_s
from stepdiag.exporters.profiles.file import load_profile
from stepdiag.exporters.profiles.registry import CONTROLLERS
from stepdiag.exporters.tables.controller import Multiplying
from stepdiag.solver.planning.circumstances import PITCH_AND_YAW, Circumstances
from stepdiag.solver.planning.information import Zone
from stepdiag.solver.planning.planner import forecast

LINUXCNC = "linuxcnc"
"""The control that can use a lattice, by an option of its kinematics."""


def circumstances(survey: Survey, folder: Path | None = None) -> Circumstances:
    """Return the circumstances of a survey from the survey file and from the profiles in
    ``folder``."""
    turns = _turns(survey.head)
    controls = [
        CONTROLLERS[each.controller]
        for each in survey.exports
        if each.controller in CONTROLLERS
    ]
    by_axis = bool(controls) and not any(
        isinstance(control, Multiplying) or control.name == LINUXCNC for control in controls
    )
    finer = () if survey.uncertainty.pitch_mm is None else range(1, MOST_INCREMENTS + 1)
    return Circumstances(
        chain=survey.machine.chain,
        assumed=assumptions_of(survey),
        head=survey.head is not None,
        head_turns=turns,
        head_u_urad=survey.head.angles.u_urad
        if survey.head is not None and survey.head.angular
        else Circumstances().head_u_urad,
        aim="tables" if by_axis else "lattice",
        zone=None if folder is None else _zone(survey, folder),
        dwells_s=tuple(
            dwell_s
            for dwell_s in Circumstances().dwells_s
            if dwell_s >= least_dwell_s(survey)
        ),
        in_step=tuple(
            n
            for n in finer
            if any(
                in_step(edge_mm / n, survey.uncertainty.pitch_mm or 1.0)
                for edge_mm in survey.volume.size_mm
            )
        ),
    )


def _turns(head: Head | None) -> tuple[str, ...]:
    if head is not None and head.format == "tqd":
        return ()
    if head is None or not head.angular:
        return PITCH_AND_YAW
    return tuple(
        f"E{turn[1]}{axis.upper()}" for axis in AXES for turn in head.angles.turns(axis)
    )


def _zone(survey: Survey, folder: Path) -> Zone | None:
    if not survey.exports or survey.exports[0].controller not in CONTROLLERS:
        return None
    first = survey.exports[0]
    try:
        named = load_profile(
            folder / first.profile, CONTROLLERS[first.controller], survey.volume
        ).zone
    except UsageError:
        return None
    ends = [
        (low, low + edge)
        for low, edge in zip(survey.volume.origin_mm, survey.volume.size_mm, strict=True)
    ]
    x, y, z = (named.get(axis.upper(), end) for axis, end in zip(AXES, ends, strict=True))
    return (x, y, z) if named else None


def hidden_slip(survey: Survey) -> Iterator[Finding]:
    """Yield the size of a slip of the count that can stay undetected if each setup is driven once.

    Passes out and back, or repeated passes, show a slip without other setups.
    """
    plan = survey.plan
    if plan.passes_per_setup > 1 or not any(name in BODY_DIAGONALS for name in plan.setups):
        return
    if hides := forecast(survey.planned, circumstances(survey)).ahead.hides():
        yield info("plan-hides.slip", hides=hides)


def hidden_waves(survey: Survey) -> Iterator[Finding]:
    """Yield a finding about the axes whose targets do not show the periodic error of the ball
    screw. The finding contains the next number of increments whose targets show this error.

    Yields nothing for a survey file without a pitch, for linear scales, and for runs with irregular
    targets.
    """
    pitch_mm, volume = survey.uncertainty.pitch_mm, survey.volume
    if pitch_mm is None or survey.uncertainty.feedback != "screw":
        return
    shown = {run.travel.axis for run in survey.planned.runs if run.targets}
    steps_mm = {
        axis: edge_mm / volume.increments
        for axis, edge_mm in zip(AXES, volume.size_mm, strict=True)
        if axis not in shown
    }
    hidden = [
        f"{axis} {step_mm:g} mm"
        for axis, step_mm in steps_mm.items()
        if in_step(step_mm, pitch_mm)
    ]
    if not hidden:
        return
    finer = range(volume.increments + 1, MOST_INCREMENTS + 1)
    better = next(
        (
            n
            for n in finer
            if not any(in_step(edge_mm / n, pitch_mm) for edge_mm in volume.size_mm)
        ),
        None,
    )
    if better is None:
        yield info("plan-hides.pitch", steps=hidden, pitch_mm=pitch_mm)
    else:
        yield info(
            "plan-hides.pitch-shown", steps=hidden, pitch_mm=pitch_mm, increments=better
        )
