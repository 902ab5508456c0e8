"""Part programs that load SINUMERIK tables: they check the control, then switch the tables off,
write them and switch them on (controllers.md 3.3).

NEWCONF and STOPRE are used as in a production program of a machine builder. No table is switched
off before all checks have passed, so a refusal does not change the machine.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.numbers import fixed
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table

_POINTS = ("$AA_ENC_COMP[", "$AN_CEC[")
_REFUSALS = {
    "NOT_METRIC": "THE CONTROL IS NOT SCALED METRIC: NOTHING WRITTEN",
    "TOO_SMALL": "MD38000 OR MD18342 IS TOO SMALL FOR THE TABLE: NOTHING WRITTEN",
    "SUM_TOO_LARGE": "MD32720 IS BELOW THE LARGEST CEC VALUE: NOTHING WRITTEN",
    "OTHER_TABLES": "THE CONTROL DOES NOT HOLD WHAT machine.existing STATES: NOTHING WRITTEN, "
    "READ IT OUT",
}
_DIGIT_MM = 1e-5
"""Largest difference in mm between a value and its text in an archive, because an archive has fewer
digits.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """One table to load: its assignments with the points first, whether the table becomes active,
    and its weight (CEC).

    ``held`` contains the assignments of this table in the machine's own files: the program writes
    only if the control contains these values or already the new values. If ``held`` is None, the
    program overwrites any values. ``acted`` is true if the old table was active during the
    measurement, so that its switch must be on and its weight 1.
    """

    table: Table
    lines: Sequence[str]
    held: Sequence[str] | None = None
    acted: bool = False
    active: bool = True
    weight: float = 1.0


def eec_program(loads: Sequence[Load], notes: Sequence[str]) -> ControlFile:
    """Return the part program ``LOAD_EEC.MPF`` for EEC tables. A table that must not be active
    stays switched off.
    """
    keys = [
        f"{int(load.table.place['measuring system']) - 1},{load.table.place['axis']}"
        for load in loads
    ]
    body = ["IF $MN_SCALING_SYSTEM_IS_METRIC==0 GOTOF NOT_METRIC"]
    body += [
        f"IF $MA_MM_ENC_COMP_MAX_POINTS[{key}]<{len(load.table.position_mm)} GOTOF TOO_SMALL"
        for key, load in zip(keys, loads, strict=True)
    ]
    for key, load in zip(keys, loads, strict=True):
        body += _known(
            "$AA_ENC_COMP[{},POINT,{}]".format(*key.split(",")),
            f"$MA_MM_ENC_COMP_MAX_POINTS[{key}]",
            load,
        )
        body += _acted(load, f"$MA_ENC_COMP_ENABLE[{key}]==0")
    for key, load in zip(keys, loads, strict=True):
        system, axis = key.split(",")
        body += [f"$MA_ENC_COMP_ENABLE[{key}]=0", "NEWCONF", "STOPRE", *load.lines]
        body += _zero_surplus(
            f"$AA_ENC_COMP[{system},POINT,{axis}]",
            f"$MA_MM_ENC_COMP_MAX_POINTS[{key}]",
            _points(load.lines),
        )
        body += ["STOPRE", "NEWCONF"]
        if load.active:
            body += [f"$MA_ENC_COMP_ENABLE[{key}]=1", "STOPRE", "NEWCONF"]
    return _program("LOAD_EEC", body, notes)


def cec_program(loads: Sequence[Load], profile: Profile, notes: Sequence[str]) -> ControlFile:
    """Return the part program ``LOAD_CEC.MPF`` for CEC tables. A table that must not be active
    stays switched off, and so does the CEC of an axis without active tables.
    """
    tables = [load.table for load in loads]
    outputs = {
        letter: profile.axis(letter).name
        for letter in dict.fromkeys(table.output_axis for table in tables)
    }
    indices = [table.place["table"] for table in tables]
    body = ["IF $MN_SCALING_SYSTEM_IS_METRIC==0 GOTOF NOT_METRIC"]
    body += [
        f"IF $MA_CEC_SCALING_SYSTEM_METRIC[{axis}]==0 GOTOF NOT_METRIC"
        for axis in outputs.values()
    ]
    body += [
        f"IF $MN_MM_CEC_MAX_POINTS[{index}]<{len(table.position_mm)} GOTOF TOO_SMALL"
        for index, table in zip(indices, tables, strict=True)
    ]
    body += [
        f"IF $MA_CEC_MAX_SUM[{axis}]<{fixed(total, 4)} GOTOF SUM_TOO_LARGE"
        for axis, total in _largest_sums(tables, outputs).items()
    ]
    for index, load in zip(indices, loads, strict=True):
        body += _known(f"$AN_CEC[{index},POINT]", f"$MN_MM_CEC_MAX_POINTS[{index}]", load)
        body += _acted(
            load, f"$SN_CEC_TABLE_ENABLE[{index}]==0", f"$SN_CEC_TABLE_WEIGHT[{index}]<>1"
        )
    for axis in outputs.values():
        body += [f"$MA_CEC_ENABLE[{axis}]=FALSE", "NEWCONF"]
    for index, load in zip(indices, loads, strict=True):
        body += [f"$SN_CEC_TABLE_ENABLE[{index}]=FALSE", "NEWCONF", *load.lines]
        body += _zero_surplus(
            f"$AN_CEC[{index},POINT]", f"$MN_MM_CEC_MAX_POINTS[{index}]", _points(load.lines)
        )
        body += [f"$SN_CEC_TABLE_WEIGHT[{index}]={load.weight:g}"]
    for letter, axis in outputs.items():
        if any(load.active for load in loads if load.table.output_axis == letter):
            body += [f"$MA_CEC_ENABLE[{axis}]=TRUE", "NEWCONF"]
    body += [
        f"$SN_CEC_TABLE_ENABLE[{index}]=TRUE"
        for index, load in zip(indices, loads, strict=True)
        if load.active
    ]
    return _program("LOAD_CEC", [*body, "NEWCONF", "STOPRE"], notes)


def _known(variable: str, size: str, load: Load) -> list[str]:
    """Return the lines that end a program if the control contains neither the old nor the new
    values. The lines compare the sum of each value times its point number. This sum also changes if
    two values are exchanged.
    """
    if load.held is None:
        return []
    least = _DIGIT_MM * len(load.table.position_mm) ** 2
    off = [
        f"(ABS(HELD-({fixed(_weighed_mm(lines), 6)}))>{fixed(least, 6)})"
        for lines in (load.held, load.lines)
    ]
    loop = [f"FOR POINT=0 TO {size}-1", f"HELD=HELD+(POINT+1)*{variable}", "ENDFOR"]
    return ["HELD=0", *loop, f"IF {' AND '.join(off)} GOTOF OTHER_TABLES"]


def _acted(load: Load, *unlike: str) -> list[str]:
    return [f"IF {state} GOTOF OTHER_TABLES" for state in unlike if load.acted and load.held]


def _weighed_mm(assignments: Sequence[str]) -> float:
    points = (
        line.partition("[")[2].partition("]=")
        for line in assignments
        if line.startswith(_POINTS)
    )
    return sum((int(index.split(",")[1]) + 1) * float(value) for index, _, value in points)


def _points(assignments: Sequence[str]) -> int:
    return sum(line.startswith(_POINTS) for line in assignments)


def _zero_surplus(variable: str, size: str, written: int) -> list[str]:
    """Return the loop that sets the points after the end of the table to zero. Without this loop,
    these points would keep their old values (K3, CAUTION).
    """
    return [f"FOR POINT={written} TO {size}-1", f"{variable}=0", "ENDFOR"]


def _largest_sums(tables: Sequence[Table], outputs: Mapping[str, str]) -> dict[str, float]:
    """Return an upper bound in mm of the sum of all tables on an output axis, by the name of the
    axis.
    """
    return {
        name: sum(
            float(np.max(np.abs(table.value_um)))
            for table in tables
            if table.output_axis == letter
        )
        / 1000.0
        for letter, name in outputs.items()
    }


def _program(name: str, body: Sequence[str], notes: Sequence[str]) -> ControlFile:
    sums = ["DEF REAL HELD"] if "HELD=0" in body else []
    lines = [*(f"; {note}" for note in notes), "DEF INT POINT", *sums, *body]
    lines += ['MSG("TABLES WRITTEN: NCK RESET, THEN REFERENCE ALL AXES")', "M0", "M30"]
    for label in (
        each for each in _REFUSALS if any(line.endswith(f" GOTOF {each}") for line in body)
    ):
        lines += [f"{label}:", f'MSG("{_REFUSALS[label]}")', "M0", "M30"]
    return ControlFile(
        name=f"{name}.MPF", data="\n".join([*lines, ""]).encode("ascii"), role="program"
    )
