"""Exports of the whole error field as a lattice: a neutral CSV, and a kinematics component of
LinuxCNC that reads this CSV.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from stepdiag.base.compensation import stated_in
from stepdiag.base.findings import Finding, error, info, warning
from stepdiag.base.messages import message
from stepdiag.base.result.result import DISPLACEMENTS, Result
from stepdiag.base.volume import Vector
from stepdiag.exporters.export.written import REPORT, ExportReport
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import RESTORE, suffixed
from stepdiag.exporters.files.sets import write_set
from stepdiag.exporters.linuxcnc import kinematics
from stepdiag.exporters.linuxcnc.control import LinuxCnc, LinuxCncOptions
from stepdiag.exporters.neutral import etalon
from stepdiag.exporters.safety.checks import refuse
from stepdiag.exporters.safety.gate import require_clean
from stepdiag.exporters.safety.remarks import backlash_offered, coarse, missed_um
from stepdiag.exporters.safety.standing import Standing
from stepdiag.exporters.safety.verdicts.case import COVERED
from stepdiag.exporters.safety.verdicts.lattice import lost_in_field
from stepdiag.exporters.safety.verify import (
    Prediction,
    harm_findings,
    predict_moved,
    worse_findings,
)
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.controller import plausible_slope_um_mm
from stepdiag.exporters.tables.lattice import Lattice
from stepdiag.exporters.tables.profile import LimitsSection, Profile
from stepdiag.exporters.tables.tables import mean_correction_um


def export_lattice(result: Result, steps_mm: Sequence[float], out_dir: Path) -> ExportReport:
    """Write the correction vectors of the whole error field. The file belongs to no control, so it
    needs no sign test.
    """
    held = lattice.lattice_of(result, steps_mm)
    steps = (
        " x ".join(f"{each:g}" for each in steps_mm)
        if len(set(steps_mm)) > 1
        else f"{steps_mm[0]:g}"
    )
    file, remarks = lattice.render(held), tuple(_beside(result, held))
    text = f"{file.name}: what has to be added to the command at each vertex, in µm; "
    text += f"step {steps} mm\n"
    text += (
        f"compensation while measuring: {stated_in(result).words()}; where it was on, the "
        "vectors come on top of what was active\n"
    )
    text += "".join(f"{item.code}: {item.words}\n" for item in remarks)
    require_clean([file])
    names = write_set(
        out_dir, [file, ControlFile(name=REPORT, data=text.encode(), role="note")]
    )
    return ExportReport(
        controller=lattice.NAME,
        out_dir=out_dir,
        files=names,
        findings=remarks,
        tables=(),
        prediction=None,
        text=text,
    )


def export_etalon(result: Result, out_dir: Path) -> ExportReport:
    file = etalon.render(result)
    text = (
        f"{file.name}: functions and squareness, chain {result.chain}; levers of angles count "
        "from the zero of the axes\n"
    )
    text += f"compensation while measuring: {stated_in(result).words()}\n"
    require_clean([file])
    names = write_set(
        out_dir, [file, ControlFile(name=REPORT, data=text.encode(), role="note")]
    )
    return ExportReport(
        controller=etalon.NAME,
        out_dir=out_dir,
        files=names,
        findings=(),
        tables=(),
        prediction=None,
        text=text,
    )


def export_kinematics(
    result: Result, profile: Profile, accept: Collection[str], out_dir: Path
) -> ExportReport:
    """Write the lattice, the kinematics component, the configuration lines for LinuxCNC, and the
    restore files.

    Raises ``SafetyError`` for a lattice beyond the limits of the profile, and if the profile lacks
    the lattice that was active during the measurement.
    """
    axes = (profile.grid_mm("X"), profile.grid_mm("Y"), profile.grid_mm("Z"))
    kinematics.require_room(axes, profile)
    active = _active(profile)
    held = lattice.lattice_on(result, axes, active)
    findings = (
        *_findings(result, held, profile.limits),
        *_elsewhere(result, held),
        *kinematics.room_findings(held, profile),
        *lost_in_field(result, _replaced(profile)),
        *_stated(result, profile),
        *_beside(result, held),
    )
    refuse(findings, accept, message("export-of", control="linuxcnc"))
    points_moved = (held.correction_um, active.correction_um if active is not None else None)
    prediction = predict_moved(result, *points_moved)
    refuse(
        tuple(worse_findings(prediction, Standing(), result, profile)),
        accept,
        message("export-of", control="linuxcnc"),
    )
    findings = (*findings, *harm_findings(prediction, result))
    joints = profile.options_as(LinuxCncOptions).joints
    files = kinematics.control_files(held, profile, joints)
    restore = [
        replace(file, name=suffixed(file.name, RESTORE))
        for file in kinematics.restore_files(held, profile, joints)
    ]
    require_clean(
        [file for file in (*files, *restore) if lattice.recognises(file)], profile.existing
    )
    text = _report(result, profile, findings, prediction)
    names = write_set(
        out_dir, [*files, *restore, ControlFile(name=REPORT, data=text.encode(), role="note")]
    )
    return ExportReport(
        controller="linuxcnc",
        out_dir=out_dir,
        files=names,
        findings=findings,
        tables=(),
        prediction=prediction,
        text=text,
    )


def _active(profile: Profile) -> Lattice | None:
    if profile.machine.measured_with == "off":
        return None
    return lattice.parse(lattice.the_one_in(profile.existing, profile.source))


def _replaced(profile: Profile) -> Callable[[Vector], Vector]:
    if profile.machine.measured_with == "on" or not profile.existing:
        return np.zeros_like
    lattices = [file for file in profile.existing if lattice.recognises(file)]
    if lattices:
        return lattice.parse(lattices[0]).correction_um
    tables = LinuxCnc().standing(profile.existing, (), profile)
    return partial(mean_correction_um, tables)


def _findings(result: Result, held: Lattice, limits: LimitsSection) -> Iterator[Finding]:
    largest = float(np.max(np.abs(held.vectors_um)))
    most = limits.at(max(float(np.ptp(at)) for at in held.axes_mm))
    if largest > most.value_um:
        yield error("value-large.lattice-limit", largest_um=largest, value_um=most.value_um)
    elif largest > most.warn_value_um:
        yield warning(
            "value-large.lattice", largest_um=largest, warn_value_um=most.warn_value_um
        )
    slopes = [
        float(
            np.max(
                np.abs(np.diff(held.vectors_um, axis=axis))
                / np.diff(at).reshape([-1 if n == axis else 1 for n in range(4)])
            )
        )
        for axis, at in enumerate(held.axes_mm)
    ]
    allowed = [
        limits.slope_um_mm or plausible_slope_um_mm(size_mm / result.volume.increments)
        for size_mm in result.volume.size_mm
    ]
    steepest, steep = max(
        zip(slopes, allowed, strict=True), key=lambda pair: pair[0] / pair[1]
    )
    if steepest > steep:
        yield warning("slope-steep.lattice", steepest_um_mm=steepest, steep_um_mm=steep)
    for each in result.findings:
        if each.severity == "error":
            yield error("data-quality", code=each.code, what=each.words)


def _elsewhere(result: Result, held: Lattice) -> Iterator[Finding]:
    """Yield an error for each axis on which the lattice covers too little of the measured volume.
    Outside the lattice, the control uses the values of its faces.
    """
    for letter, at, low, size in zip(
        "XYZ", held.axes_mm, result.volume.origin_mm, result.volume.size_mm, strict=True
    ):
        first, last, high = float(at[0]), float(at[-1]), low + size
        if min(last, high) - max(first, low) < COVERED * size:
            yield error(
                "beyond-travel.lattice",
                letter=letter,
                first_mm=first,
                last_mm=last,
                low_mm=low,
                high_mm=high,
            )


def _stated(result: Result, profile: Profile) -> Iterator[Finding]:
    for name, function in sorted(result.reversal.items()):
        if (
            function.value is not None
            and name[1] == name[2]
            and np.max(np.abs(function.value)) > 0
        ):
            yield info("direction-averaged", name=name)
            yield from backlash_offered(result, name[2], ends_backlash=False)
    for letter in "XYZ":
        working = profile.axis(letter).working_mm
        if working is not None:
            yield info("working-zone-unused", letter=letter)


def _beside(result: Result, held: Lattice) -> Iterator[Finding]:
    missed = {
        name: missed_um(held.axes_mm["XYZ".index(name[2])], known.position_mm, known.value)
        for name in DISPLACEMENTS
        if (known := result.errors.get(name)) is not None and known.value is not None
    }
    yield from coarse(message("the-lattice"), missed)


def _report(
    result: Result, profile: Profile, findings: Collection[Finding], prediction: Prediction
) -> str:
    unknown = [name for name, function in result.errors.items() if function.value is None]
    lines = [
        f"Compensation for {kinematics.TITLE}",
        f"machine: {profile.machine.name}; profile: {profile.source}",
        *(f"axis {letter}: {profile.grid_words(letter)}" for letter in profile.axes),
        "",
        "REMARKS",
        *(f"  {item.severity:<8} {item.code}: {item.words}" for item in findings),
        *(
            [
                (
                    "  not in the lattice, because the result does not identify it: "
                    f"{', '.join(unknown)}"
                )
            ]
            if unknown
            else []
        ),
        "",
        "PREDICTED VOLUMETRIC ERROR without rigid motion, in µm (k = 2)",
        *(f"  {line}" for line in _effect(prediction)),
        "",
        (
            "LAW: joint = command + lattice(command), trilinear, faces held; stated by the "
            "source of "
            "the component"
        ),
        "",
        "LOADING",
        *(
            f"  {number}. {step}"
            for number, step in enumerate(kinematics.instructions(profile), start=1)
        ),
    ]
    return "\n".join([*lines, ""])


def _effect(prediction: Prediction) -> Iterator[str]:
    for when, found in prediction.predicted.without_rigid_motion.items():
        yield f"{when}: rms {found.rms_um.words()}, largest {found.largest_um.bound()}"
