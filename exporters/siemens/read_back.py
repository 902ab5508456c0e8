"""The part program that writes the contents of a SINUMERIK into a file: every table of an export,
with its switches and weight, as assignments.

The file has the form of a data file, so the reader of the machine's own files can read it. WRITE
appends a line to a file of the passive file system; MD11420 limits the length of this file (NC
Programming, SINUMERIK ONE, p. 566). This manual does not state how many digits "<<" writes. The
form of DELETE, with a fault variable and a path, comes from a published program for the 810D
(industrialmonitordirect.com, article "deleting programs with an invalid name"). The program cannot
write a variable of type AXIS, which allows only == and <> (Job Planning, 828D, 6FC5398-2BP40-0BA0,
p. 66): it compares the variable with each axis and writes the matching name.
"""

from collections.abc import Iterator, Sequence

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import finite
from stepdiag.exporters.siemens import eec
from stepdiag.exporters.siemens.ini import switches_in
from stepdiag.exporters.siemens.products import numbered
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table

NAME = "READ_BACK.MPF"
HELD = "STEPDIAG_BACK"
_PATH = f"/_N_MPF_DIR/_N_{HELD}_MPF"
_CEC_GRID = ("STEP", "MIN", "MAX", "DIRECTION", "MULT_BY_TABLE", "IS_MODULO")
_EEC_GRID = ("STEP", "MIN", "MAX", "IS_MODULO")
_LOGICAL = {"TRUE": "1", "FALSE": "0"}


def program(tables: Sequence[Table], profile: Profile) -> ControlFile:
    """Return the part program for the tables of an export. In the control, the program changes only
    its output file.
    """
    body = [line for table in numbered(tables) for line in _of_table(table, profile)]
    head = [
        (
            f"; READ BACK: writes what the control holds into {HELD}.MPF; save that as {HELD}.INI "
            "for `stepdiag verify --read-back`"
        ),
        "DEF INT FAULT",
        "DEF INT POINT",
        "DEF STRING[80] BACK",
        f'BACK="{_PATH}"',
        "DELETE(FAULT,BACK)",
        "FAULT=0",
    ]
    end = [
        'WRITE(FAULT,BACK,"M17")',
        'MSG("WRITTEN")',
        "M30",
        "FULL:",
        'MSG("THE FILE IS FULL: RAISE MD11420, RUN AGAIN")',
        "M0",
        "M30",
        "",
    ]
    return ControlFile(
        name=NAME, data="\n".join([*head, *body, *end]).encode("ascii"), role="program"
    )


def _of_table(table: Table, profile: Profile) -> Iterator[str]:
    if table.kind == eec.KIND:
        system, axis = int(table.place["measuring system"]) - 1, table.place["axis"]
        yield from _points(f"$AA_ENC_COMP[{system},", f",{axis}]", table)
        names = [
            *(f"$AA_ENC_COMP_{name}[{system},{axis}]" for name in _EEC_GRID),
            f"$MA_ENC_COMP_ENABLE[{system},{axis}]",
        ]
    else:
        index, output = table.place["table"], profile.axis(table.output_axis).name
        yield from _points(f"$AN_CEC[{index},", "]", table)
        for name in ("INPUT_AXIS", "OUTPUT_AXIS"):
            for each in profile.axes.values():
                yield from _named(f"$AN_CEC_{name}[{index}]", each.name, f"{name}_{index}")
        names = [f"$AN_CEC_{name}[{index}]" for name in _CEC_GRID]
        names += [
            f"$SN_CEC_TABLE_ENABLE[{index}]",
            f"$SN_CEC_TABLE_WEIGHT[{index}]",
            f"$MA_CEC_ENABLE[{output}]",
        ]
    for name in names:
        yield _write_line(f'"{name}="<<{name}')
    yield "IF FAULT<>0 GOTOF FULL"


def _named(variable: str, axis: str, label: str) -> tuple[str, ...]:
    over = f"NOT_{axis}_{label}"
    return (
        f"IF {variable}<>{axis} GOTOF {over}",
        _write_line(f'"{variable}=({axis})"'),
        f"{over}:",
    )


def _points(before: str, after: str, table: Table) -> tuple[str, ...]:
    text = f'"{before}"<<POINT<<"{after}="<<{before}POINT{after}'
    return (
        f"FOR POINT=0 TO {len(table.position_mm) - 1}",
        _write_line(text),
        "IF FAULT<>0 GOTOF FULL",
        "ENDFOR",
    )


def _write_line(text: str) -> str:
    return f"WRITE(FAULT,BACK,{text})"


def switches(tables: Sequence[Table], profile: Profile) -> dict[str, str]:
    wanted = {}
    for table in numbered(tables):
        if table.kind == eec.KIND:
            wanted[
                f"MA_ENC_COMP_ENABLE[{int(table.place['measuring system']) - 1},"
                f"{table.place['axis']}]"
            ] = "1"
        else:
            index = table.place["table"]
            wanted |= {
                f"SN_CEC_TABLE_ENABLE[{index}]": "1",
                f"SN_CEC_TABLE_WEIGHT[{index}]": "1",
            }
            wanted[f"MA_CEC_ENABLE[{profile.axis(table.output_axis).name}]"] = "1"
    return wanted


def held_switches(files: Sequence[ControlFile]) -> dict[str, str]:
    """Return the switches and weights in files by variable with index, with 1 and 0 for TRUE and
    FALSE.

    Raises ``DataError``, with the name, for a switch or weight that is neither TRUE nor FALSE nor a
    number.
    """
    return {
        name: _LOGICAL.get(value) or f"{finite(value, name):g}"
        for name, value in switches_in(files).items()
    }
