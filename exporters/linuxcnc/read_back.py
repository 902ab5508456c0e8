"""Files for LinuxCNC: a part program that stops at every row of the tables from both sides, a
script that reads the table values from HAL meanwhile, and a script that loads COMP_FILEs.
"""

from collections.abc import Sequence
from importlib.resources import files as resources

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables.tables import Table

NAMES = ("READ_BACK.ngc", "stepdiag_back.py", "load_comp.py")
_BEYOND = 1.0
"""Distance, in units of the machine, by which the program drives beyond the first and the last row,
so that the axis also reaches these rows from both sides.
"""
_DWELL_S = 0.5
"""Dwell of the program at a row, in seconds: the reading script accepts a stop after 0.25 s, and
the control applies an offset with half of the joint's acceleration.
"""
_FEED_MM_MIN = 6000


def read_back_files(screws: Sequence[Table], unit_mm: float) -> tuple[ControlFile, ...]:
    """Return, for screw tables, the part program and the script that read them back, and the
    loading script, which compares the control with the machine's own files. Without tables, return
    no files.
    """
    if not screws:
        return ()
    lines = [
        (
            "(READ BACK: stops at every row of the COMP_FILEs from both sides; stepdiag_back.py "
            "reads what the control adds there)"
        )
    ]
    lines += [
        "G21" if unit_mm == 1.0 else "G20",
        "G17 G40 G49 G61 G90 G94",
        f"F{_FEED_MM_MIN / unit_mm:g}",
    ]
    for letter in dict.fromkeys(table.input_axis for table in screws):
        rows = (
            next(table.position_mm for table in screws if table.input_axis == letter)
            / unit_mm
        )
        stops = [rows[0] - _BEYOND, *rows, rows[-1] + _BEYOND, *rows[::-1]]
        lines += [
            line for at in stops for line in (f"G1 {letter}{at:.6f}", f"G4 P{_DWELL_S}")
        ]
    scripts = resources("stepdiag.exporters.linuxcnc")
    program = ControlFile(
        name=NAMES[0], data="\n".join([*lines, "M2", ""]).encode("ascii"), role="note"
    )
    return program, *(
        ControlFile(name=name, data=scripts.joinpath(name).read_bytes(), role="note")
        for name in NAMES[1:]
    )
