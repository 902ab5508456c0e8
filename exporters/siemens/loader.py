"""Part programs that load SINUMERIK tables: guards first, then switch off, write, switch on (controllers.md 3.3).

The pattern of NEWCONF and STOPRE is that of a builder's production program. Nothing is switched off before every guard has passed, so a
refusal leaves the machine as it was.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.numbers import fixed
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table

_REFUSALS = {
    "NOT_METRIC": "THE CONTROL IS NOT SCALED METRIC: NOTHING WRITTEN",
    "TOO_SMALL": "MD38000 OR MD18342 IS TOO SMALL FOR THE TABLE: NOTHING WRITTEN",
    "SUM_TOO_LARGE": "MD32720 IS BELOW THE LARGEST CEC VALUE: NOTHING WRITTEN",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """A table to be loaded: its assignments, points first, whether it is to act afterwards, and its
    weight (CEC).
    """

    table: Table
    lines: Sequence[str]
    active: bool = True
    weight: float = 1.0


def eec_program(loads: Sequence[Load], notes: Sequence[str]) -> ControlFile:
    """Return ``LOAD_EEC.MPF`` for EEC tables; a table that is not to act stays switched off."""
    keys = [f"{int(load.table.place['measuring system']) - 1},{load.table.place['axis']}" for load in loads]
    body = ["IF $MN_SCALING_SYSTEM_IS_METRIC==0 GOTOF NOT_METRIC"]
    body += [
        f"IF $MA_MM_ENC_COMP_MAX_POINTS[{key}]<{len(load.table.position_mm)} GOTOF TOO_SMALL" for key, load in zip(keys, loads, strict=True)
    ]
    for key, load in zip(keys, loads, strict=True):
        system, axis = key.split(",")
        body += [f"$MA_ENC_COMP_ENABLE[{key}]=0", "NEWCONF", "STOPRE", *load.lines]
        body += _zero_surplus(f"$AA_ENC_COMP[{system},POINT,{axis}]", f"$MA_MM_ENC_COMP_MAX_POINTS[{key}]", _points(load.lines))
        body += ["STOPRE", "NEWCONF"]
        if load.active:
            body += [f"$MA_ENC_COMP_ENABLE[{key}]=1", "STOPRE", "NEWCONF"]
    return _program("LOAD_EEC", body, notes, ("NOT_METRIC", "TOO_SMALL"))


def cec_program(loads: Sequence[Load], profile: Profile, notes: Sequence[str]) -> ControlFile:
    """Return ``LOAD_CEC.MPF`` for CEC tables; a table that is not to act stays switched off, and so
    does an axis without active tables.
    """
    tables = [load.table for load in loads]
    outputs = {letter: profile.axis(letter).name for letter in dict.fromkeys(table.output_axis for table in tables)}
    indices = [table.place["table"] for table in tables]
    body = ["IF $MN_SCALING_SYSTEM_IS_METRIC==0 GOTOF NOT_METRIC"]
    body += [f"IF $MA_CEC_SCALING_SYSTEM_METRIC[{axis}]==0 GOTOF NOT_METRIC" for axis in outputs.values()]
    body += [
        f"IF $MN_MM_CEC_MAX_POINTS[{index}]<{len(table.position_mm)} GOTOF TOO_SMALL" for index, table in zip(indices, tables, strict=True)
    ]
    body += [f"IF $MA_CEC_MAX_SUM[{axis}]<{fixed(total, 4)} GOTOF SUM_TOO_LARGE" for axis, total in _largest_sums(tables, outputs).items()]
    for axis in outputs.values():
        body += [f"$MA_CEC_ENABLE[{axis}]=FALSE", "NEWCONF"]
    for index, load in zip(indices, loads, strict=True):
        body += [f"$SN_CEC_TABLE_ENABLE[{index}]=FALSE", "NEWCONF", *load.lines]
        body += _zero_surplus(f"$AN_CEC[{index},POINT]", f"$MN_MM_CEC_MAX_POINTS[{index}]", _points(load.lines))
        body += [f"$SN_CEC_TABLE_WEIGHT[{index}]={load.weight:g}"]
    for letter, axis in outputs.items():
        if any(load.active for load in loads if load.table.output_axis == letter):
            body += [f"$MA_CEC_ENABLE[{axis}]=TRUE", "NEWCONF"]
    body += [f"$SN_CEC_TABLE_ENABLE[{index}]=TRUE" for index, load in zip(indices, loads, strict=True) if load.active]
    return _program("LOAD_CEC", [*body, "NEWCONF", "STOPRE"], notes, tuple(_REFUSALS))


def _points(assignments: Sequence[str]) -> int:
    """Return how many point values the assignments write: they come first, the grid after them."""
    return sum(line.startswith(("$AA_ENC_COMP[", "$AN_CEC[")) for line in assignments)


def _zero_surplus(variable: str, size: str, written: int) -> list[str]:
    """Return the loop that zeroes the points above the table, which would keep old values (K3, CAUTION)."""
    return [f"FOR POINT={written} TO {size}-1", f"{variable}=0", "ENDFOR"]


def _largest_sums(tables: Sequence[Table], outputs: Mapping[str, str]) -> dict[str, float]:
    """Return, per output axis name, a bound in mm of the sum of all its tables."""
    return {
        name: sum(float(np.max(np.abs(table.value_um))) for table in tables if table.output_axis == letter) / 1000.0
        for letter, name in outputs.items()
    }


def _program(name: str, body: Sequence[str], notes: Sequence[str], refusals: Sequence[str]) -> ControlFile:
    lines = [*(f"; {note}" for note in notes), "DEF INT POINT", *body]
    lines += ['MSG("TABLES WRITTEN: NCK RESET, THEN REFERENCE ALL AXES")', "M0", "M30"]
    for label in refusals:
        lines += [f"{label}:", f'MSG("{_REFUSALS[label]}")', "M0", "M30"]
    return ControlFile(name=f"{name}.MPF", data="\n".join([*lines, ""]).encode("ascii"), role="program")
