"""Writes the files for a control from a result.

All checks are complete before the first file is written, and a file with other contents is never
overwritten. An export also contains restore files, a readable report, a SHA-256 list and the steps
of loading. If the sense of a table was not tested on this machine within twelve months, the name of
its file contains ``_UNTESTED_SIGN``.
"""

from collections.abc import Collection
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path

import msgspec
import numpy as np

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.base.findings import Finding
from stepdiag.base.messages import message
from stepdiag.base.result.result import AXIS_LETTERS, Result
from stepdiag.base.volume import Vector
from stepdiag.exporters.export.planning import planned
from stepdiag.exporters.export.report import report_text
from stepdiag.exporters.export.volume import export_etalon, export_kinematics, export_lattice
from stepdiag.exporters.export.written import REPORT, ExportReport
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import UNTESTED, suffixed
from stepdiag.exporters.files.sets import write_set
from stepdiag.exporters.linuxcnc.control import LinuxCncOptions
from stepdiag.exporters.neutral import etalon
from stepdiag.exporters.profiles.file import quick_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.checks import (
    Case,
    refuse,
    run_checks,
    untested_kinds,
)
from stepdiag.exporters.safety.compensation import remarks as compensation_remarks
from stepdiag.exporters.safety.compensation import require_agreement, require_answer
from stepdiag.exporters.safety.gate import gate_findings, require_clean
from stepdiag.exporters.safety.identity import require_same_machine
from stepdiag.exporters.safety.levers import require_levers
from stepdiag.exporters.safety.remarks import missed_um, remarks
from stepdiag.exporters.safety.restore import restore_files
from stepdiag.exporters.safety.standing import standing_findings
from stepdiag.exporters.safety.state import UNPROVEN, states
from stepdiag.exporters.safety.verify import contents, harm_findings, predict, worse_findings
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.controller import Controller, Plan, Reporting
from stepdiag.exporters.tables.profile import Profile

MET_UM, FINEST_PART = 0.05, 10
"""Limits of the table steps in an export without a profile. `MET_UM` is the largest error in um
that the points of a table may cause at a measured position. `FINEST_PART` is the largest number of
table steps in one increment of the survey; uneven targets need several steps.
"""


def export(
    result: Result,
    controller: str,
    profile: Profile | None,
    *,
    step_mm: float | None = None,
    accept: Collection[str] = (),
    out_dir: Path,
    today: date | None = None,
) -> ExportReport:
    """Write the compensation files of a result and return the report of the export.

    If ``profile`` is None, the tables have their points at the measured positions or every
    ``step_mm``. With a profile, ``step_mm`` replaces the steps of the profile. ``accept`` contains
    the codes of the accepted warnings. ``today`` is the date for the age of a sign test, so that a
    replay can repeat an old export.

    Raises ``DataError`` for a function that the result does not identify, ``SafetyError`` for a
    failed check, ``UsageError`` for a wrong profile. After a failed check no file is written, with
    one exception: if only the machine's own punch files are missing, the readable report is
    written.
    """
    require_answer(result)
    if controller == lattice.NAME:
        own = (
            step_mm
            if step_mm is not None or profile is None
            else min(axis.step_mm for axis in profile.axes.values())
        )
        return export_lattice(result, _steps(own, result), out_dir)
    if controller == etalon.NAME:
        return export_etalon(result, out_dir)
    control = controller_named(controller)
    settled = _settled(profile, control, result, step_mm)
    require_same_machine(result, settled)
    require_agreement(result, settled)
    require_levers(result, settled)
    if isinstance(settled.options, LinuxCncOptions) and settled.options.way == "kinematics":
        return export_kinematics(result, settled, accept, out_dir)
    made = planned(result, control, settled, today or datetime.now(tz=UTC).date())
    case, plan, standing = made.case, made.plan, made.standing
    _require_something(plan, case.profile)
    findings = (
        *run_checks(case),
        *standing_findings(standing, result, case.profile),
        *states(result, control, case.profile),
    )
    where = message("export-of", control=controller)
    asked = (item for item in findings if item.key != UNPROVEN)
    refuse(
        (*asked, *(item for item in plan.findings if _may_refuse(item, case.profile))),
        accept,
        where,
    )
    prediction = predict(result, *standing.acting(result, case.profile))
    refuse(tuple(worse_findings(prediction, standing, result, case.profile)), accept, where)
    all_findings = (
        *findings,
        *plan.findings,
        *compensation_remarks(result, case.profile),
        *remarks(case),
        *harm_findings(prediction, result),
    )
    text = report_text(case, plan, all_findings, prediction)
    try:
        files = _control_files(case)
    except SafetyError as error:
        if error.code != "template-missing":
            raise
        write_set(
            out_dir, [ControlFile(name=REPORT, data=_refused(text, error), role="note")]
        )
        raise
    names = write_set(
        out_dir, [*files, ControlFile(name=REPORT, data=text.encode(), role="note")]
    )
    return ExportReport(
        controller=controller,
        out_dir=out_dir,
        files=names,
        findings=all_findings,
        tables=tuple(case.tables),
        prediction=prediction,
        text=text,
    )


def _may_refuse(finding: Finding, profile: Profile) -> bool:
    return finding.severity == "error" or not profile.assumed


def _require_something(plan: Plan, profile: Profile) -> None:
    if not plan.tables and not plan.listed:
        asked, why = profile.machine.functions, [each.words for each in plan.findings]
        raise SafetyError(
            f"{profile.source}: machine.functions",
            code="nothing-to-write",
            expected=message("has-table"),
            found=message("names-because", names=asked, why=why) if why else ", ".join(asked),
            remedy=message("ask-others"),
        )


def _settled(
    profile: Profile | None, control: Controller, result: Result, step_mm: float | None
) -> Profile:
    if profile is None:
        return _of_what_travelled(
            quick_profile(control, result.volume, _steps(step_mm, result)), result
        )
    if step_mm is None:
        return profile
    _require_step(step_mm)
    return replace(
        profile,
        axes={
            letter: msgspec.structs.replace(axis, step_mm=step_mm)
            for letter, axis in profile.axes.items()
        },
    )


def _of_what_travelled(profile: Profile, result: Result) -> Profile:
    """Return the assumed profile. If an axis did not travel, the profile requests only the
    functions that the result identifies.
    """
    if result.volume.solid:
        return profile
    functions = [name for name in profile.machine.functions if result.knows(name)]
    return replace(
        profile, machine=msgspec.structs.replace(profile.machine, functions=functions)
    )


def _steps(step_mm: float | None, result: Result) -> tuple[float, ...]:
    """Return the steps of an export without a profile.

    Table points between measured positions add no information. Table points that miss the measured
    positions cause errors of up to 1 um.
    """
    if step_mm is not None:
        _require_step(step_mm)
        return (step_mm,) * len(AXIS_LETTERS)
    return tuple(_measured_step(result, index) for index in range(len(AXIS_LETTERS)))


def _measured_step(result: Result, index: int) -> float:
    """Return the largest step that divides the survey's increment and keeps the measured values of
    an axis within `MET_UM`. If no step keeps the values within `MET_UM`, return the step with the
    smallest error.
    """
    letter, low_mm, step_mm = (
        AXIS_LETTERS[index],
        result.volume.origin_mm[index],
        float(result.volume.step_mm[index]),
    )
    known = [
        (each.position_mm, each.value)
        for name, each in result.errors.items()
        if name[-1] == letter and each.value is not None
    ]

    def left_um(parts: int) -> float:
        grid_mm: Vector = low_mm + step_mm / parts * np.arange(
            result.volume.increments * parts + 1, dtype=np.float64
        )
        return max(
            (missed_um(grid_mm, position_mm, value) for position_mm, value in known),
            default=0.0,
        )

    parts = range(1, FINEST_PART + 1)
    return step_mm / next(
        (each for each in parts if left_um(each) <= MET_UM), min(parts, key=left_um)
    )


def _require_step(step_mm: float) -> None:
    if not 0 < step_mm < float("inf"):
        raise UsageError("--step-mm", expected=message("step-positive"), found=f"{step_mm:g}")


def _control_files(case: Case) -> list[ControlFile]:
    """Return the files for the control and their restore files. The checks use the tables that a
    control reads from the bytes.
    """
    kinds = untested_kinds(case)
    notes = (
        [f"UNTESTED SIGN ({', '.join(kinds)}): make the sign test before this table is used"]
        if kinds
        else []
    )
    rendered = case.controller.render(case.tables, case.profile, notes)
    readable = [file for file in rendered if file.role == "data"]
    held = contents(case.controller, readable, case.profile)
    errors = [item for item in gate_findings(case, held) if item.severity == "error"]
    refuse(errors, (), message("files-as-written"))
    restore = restore_files(case.controller, case.tables, case.profile)
    require_clean([*rendered, *restore], case.profile.existing)
    suffix = UNTESTED if kinds else ""
    read_out = (
        case.controller.read_back(case.tables, case.profile)
        if isinstance(case.controller, Reporting)
        else ()
    )
    return [
        *(replace(file, name=suffixed(file.name, suffix)) for file in rendered),
        *restore,
        *read_out,
    ]


def _refused(text: str, error: SafetyError) -> bytes:
    head = (
        f"NO FILE FOR THE CONTROL WAS WRITTEN: {error}\nThe tables below can be entered by "
        "hand.\n\n"
    )
    return (head + text).encode()
