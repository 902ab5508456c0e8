"""A virtual LinuxCNC: screw compensation files and the matrix kinematics (src/emc/ini/inijoint.cc,
usrmotintf.cc, control.c)."""

import re

from stepdiag.virtual.control.axis_table import AxisTable

_MAXIMUM_ENTRIES = 256
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_MATRIX = re.compile(
    r"^\s*setp\s+matrixkins\.C_(?P<row>[xyz])(?P<column>[xyz])\s+(?P<value>\S+)", re.MULTILINE
)
_FAR_MM = 1e6


def load_screw_file(text: str, axis: int, *, kind: int = 0) -> list[AxisTable]:
    """Return the forward and the reverse table of a COMP_FILE of ``axis`` (0, 1, 2).

    With ``kind`` 0 the file contains actual positions (trim = nominal - actual), with ``kind`` 1
    trims; a positive trim moves the motor in +. As in the control, the first line that does not
    begin with three numbers ends the file without an error. Raises ValueError for a file that the
    control refuses: nominal positions that do not rise, more than 256 entries, an empty file.
    """
    rows: list[tuple[float, float, float]] = []
    for line in text.splitlines():
        numbers = _three_numbers(line)
        if numbers is None:
            break
        rows.append(numbers)
    if len(rows) > _MAXIMUM_ENTRIES:
        raise ValueError(
            f"compensation: expected at most {_MAXIMUM_ENTRIES} entries, found {len(rows)}"
        )
    nominal = tuple(row[0] for row in rows)
    return [
        AxisTable(
            input_axis=axis,
            output_axis=axis,
            position_mm=nominal,
            value_mm=tuple(row[column] if kind else row[0] - row[column] for row in rows),
            travel=travel,
        )
        for column, travel in ((1, 1), (2, -1))
    ]


def _three_numbers(line: str) -> tuple[float, float, float] | None:
    numbers: list[float] = []
    rest = line
    while len(numbers) < 3:
        found = _NUMBER.match(rest)
        if found is None:
            return None
        numbers.append(float(found[1]))
        rest = rest[found.end() :]
    return numbers[0], numbers[1], numbers[2]


def load_matrix(text: str) -> list[AxisTable]:
    """Return the correction by ``setp matrixkins.C_rc`` lines: joint r = sum of C_rc * axis c; a
    missing value is that of the identity."""
    tables = []
    for found in _MATRIX.finditer(text):
        row, column = "xyz".index(found["row"]), "xyz".index(found["column"])
        gain = float(found["value"]) - (1.0 if row == column else 0.0)
        tables.append(
            AxisTable(
                input_axis=column,
                output_axis=row,
                position_mm=(-_FAR_MM, _FAR_MM),
                value_mm=(-gain * _FAR_MM, gain * _FAR_MM),
            )
        )
    return tables
