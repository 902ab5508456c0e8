"""Compares the numbers read out of a control with an export, or before loading with the machine's
own files.

An interrupted loading, an old file that was loaded again and a forgotten switch are visible only in
the control's own numbers. Tables are compared as the control applies them, within half a unit of
the last digit.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath

import numpy as np

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.findings import Finding, error
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables.controller import Controller, Switching
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, same_lever

BEFORE: Mapping[str, str] = {
    "fanuc": "Punch pitch data and parameters out (SYSTEM > PITCH > PUNCH, SYSTEM > PARAM > PUNCH)",
    "heidenhain": "Copy the .COM tables and the .CMA file out of the control",
    "beckhoff": "Copy the files of the folder that the configuration names, axis lists with their "
    "lr_param.ssfk (an NC program shows by V.A.LEAD_COMP_ACTIVE.X and V.A.CROSS_COMP_ACTIVE.X "
    "whether they act)",
    "mitsubishi": "Write the parameters out, or key the list in from the screen",
    "fagor": "Copy the leadscrew tables out of the control",
}
"""The step that reads out the contents of the control before loading, for controls without a
loading program that compares them. Source of the V.A. variables: Beckhoff infosys,
tf5200_axis_compensation, 308731019.
"""
STEPS: Mapping[str, str] = {
    "siemens": "Run READ_BACK.MPF; save STEPDIAG_BACK.MPF, which it writes, as STEPDIAG_BACK.INI.",
    "fanuc": "Punch pitch data and parameters out again (SYSTEM > PITCH > PUNCH, SYSTEM > PARAM "
    "> PUNCH).",
    "heidenhain": "Copy the .COM tables and the .CMA file out of the control again.",
    "beckhoff": "Copy the loaded files out of the folder that the configuration names, axis "
    "lists with their lr_param.ssfk.",
    "linuxcnc": "Start `/usr/bin/python3 stepdiag_back.py 0 screw_x.comp 1 screw_y.comp 2 "
    "screw_z.comp` (joint, file), run READ_BACK.ngc.",
    "mitsubishi": "Write the parameters out again, or key the list back in from the screen.",
    "fagor": "Copy the leadscrew tables out of the control again.",
}
"""The step after loading that reads the numbers out of a control, by the name of the control."""
_UNIT_SHARE = 0.51
"""Largest difference of two equal numbers, in units of the last digit: half a unit and the rounding
of a float.
"""
_LEAST_UM = 2e-3
"""The unit of the last digit of numbers read from a running control."""
_PLACE_MM = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadBack:
    """Result of a comparison: the numbers of compared values and switches, and a finding for each
    table and each switch that differs.
    """

    numbers: int
    switches: int
    findings: tuple[Finding, ...]


def compare(
    controller: Controller,
    written: Sequence[ControlFile],
    held: Sequence[ControlFile],
    profile: Profile,
) -> ReadBack:
    """Return the comparison of the files of an export with the files read out of the control.

    Raises ``DataError`` for a file of another control.
    """
    wanted = controller.parse([file for file in written if file.role == "data"], profile)
    return _compared(controller, wanted, held, profile, switched=True)


def compare_before(
    controller: Controller, held: Sequence[ControlFile], profile: Profile
) -> ReadBack:
    """Return the comparison of the control before loading with the machine's own files in the
    profile. If the profile names no files, the control must contain no tables. Switches are
    compared if tables were active during the measurement.

    Raises ``DataError`` for a file of another control.
    """
    acted = profile.machine.measured_with == "on"
    wanted = controller.standing(profile.existing, (), profile) if profile.existing else ()
    return _compared(controller, wanted, held, profile, switched=acted)


def _compared(
    controller: Controller,
    wanted: Sequence[Table],
    held: Sequence[ControlFile],
    profile: Profile,
    *,
    switched: bool,
) -> ReadBack:
    plain = [as_data(file) for file in held]
    try:
        findings = [*differences(wanted, controller.parse(plain, profile))]
    except (
        DataError,
        UsageError,
    ) as broken:  # a loading that ended half way leaves a table without its grid
        if not all(controller.recognises(file) for file in plain):
            raise
        findings = [error("read-back-differs.unfit", why=broken.message)]
    stated: Mapping[str, str] = {}
    if switched and isinstance(controller, Switching):
        stated, now = controller.switches(wanted, profile), controller.held_switches(plain)
        findings += [
            error("read-back-differs.switch", name=name, held=now[name], written=value)
            if name in now
            else error("read-back-differs.unread", name=name)
            for name, value in stated.items()
            if now.get(name) != value
        ]
    return ReadBack(
        numbers=sum(len(table.value_um) for table in wanted),
        switches=len(stated),
        findings=tuple(findings),
    )


def differences(wanted: Sequence[Table], held: Sequence[Table]) -> Iterator[Finding]:
    """Yield the differences between the wanted tables and the tables read from files, and every
    surplus table that is not zero.
    """
    found, known = (
        {table.identity: table for table in held},
        {table.identity for table in wanted},
    )
    for table in wanted:
        yield from _of_table(table, found.get(table.identity))
    for identity, table in found.items():
        if identity not in known and table.value_um.any():
            yield error("read-back-differs.beside", label=table.label)


def as_data(file: ControlFile) -> ControlFile:
    """Return a part program from a control as a data file: its switches are values and not
    instructions.
    """
    path = PurePath(file.name)
    return (
        replace(file, name=f"{path.stem}.INI", role="data")
        if path.suffix.upper() in (".MPF", ".SPF")
        else file
    )


def _of_table(wanted: Table, held: Table | None) -> Iterator[Finding]:
    label = wanted.label
    if held is None:
        if wanted.value_um.any():
            yield error("read-back-differs.absent", label=label)
        return
    alike = (wanted.law, wanted.direction, len(wanted.position_mm)) == (
        held.law,
        held.direction,
        len(held.position_mm),
    )
    if (
        not alike
        or not np.all(np.abs(wanted.position_mm - held.position_mm) <= _PLACE_MM)
        or not same_lever(wanted, held)
    ):
        yield error("read-back-differs.grid", label=label)
        return
    unit_um = max(wanted.quantum_um, _LEAST_UM)
    off = ~(np.abs(wanted.absolute_um - held.absolute_um) <= _UNIT_SHARE * unit_um)
    if off.any():  # an invalid number (NaN) differs from every number
        at = int(np.argmax(off))
        where = f"{wanted.input_axis} {wanted.position_mm[at]:g} mm"
        pair = {
            "held_um": float(held.absolute_um[at]),
            "written_um": float(wanted.absolute_um[at]),
        }
        yield error(
            "read-back-differs", label=label, count=int(off.sum()), where=where, **pair
        )
