"""Part programs that load SINUMERIK tables: guards first, then switch off, write, switch on (controllers.md 3.3).

The pattern of NEWCONF and STOPRE is that of a builder's production program. Nothing is switched off before every guard has passed, so a
refusal leaves the machine as it was.
"""

from collections.abc import Mapping, Sequence

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


def eec_program(tables: Sequence[Table], lines: Sequence[list[str]], notes: Sequence[str]) -> ControlFile:
    """Return ``LOAD_EEC.MPF`` for EEC tables and the assignments of each."""
    keys = [f"{int(table.place['measuring system']) - 1},{table.place['axis']}" for table in tables]
    body = ["IF $MN_SCALING_SYSTEM_IS_METRIC==0 GOTOF NOT_METRIC"]
    body += [
        f"IF $MA_MM_ENC_COMP_MAX_POINTS[{key}]<{len(table.position_mm)} GOTOF TOO_SMALL" for key, table in zip(keys, tables, strict=True)
    ]
    for key, assignments in zip(keys, lines, strict=True):
        system, axis = key.split(",")
        body += [f"$MA_ENC_COMP_ENABLE[{key}]=0", "NEWCONF", "STOPRE", *assignments]
        body += _zero_surplus(f"$AA_ENC_COMP[{system},POINT,{axis}]", f"$MA_MM_ENC_COMP_MAX_POINTS[{key}]", _points(assignments))
        body += ["STOPRE", "NEWCONF", f"$MA_ENC_COMP_ENABLE[{key}]=1", "STOPRE", "NEWCONF"]
    return _program("LOAD_EEC", body, notes, ("NOT_METRIC", "TOO_SMALL"))


def cec_program(tables: Sequence[Table], lines: Sequence[list[str]], profile: Profile, notes: Sequence[str]) -> ControlFile:
    """Return ``LOAD_CEC.MPF`` for CEC tables and the assignments of each."""
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
    for index, assignments in zip(indices, lines, strict=True):
        body += [f"$SN_CEC_TABLE_ENABLE[{index}]=FALSE", "NEWCONF", *assignments]
        body += _zero_surplus(f"$AN_CEC[{index},POINT]", f"$MN_MM_CEC_MAX_POINTS[{index}]", _points(assignments))
        body += [f"$SN_CEC_TABLE_WEIGHT[{index}]=1"]
    for axis in outputs.values():
        body += [f"$MA_CEC_ENABLE[{axis}]=TRUE", "NEWCONF"]
    for index in indices:
        body += [f"$SN_CEC_TABLE_ENABLE[{index}]=TRUE"]
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
