"""The text of SINUMERIK data files: assignments of system variables.

A data file contains ``%_N_<name>_INI``, an optional ``METRIC``, ``CHANDATA(1)``, assignments and
``M17`` (controllers.md 3.1, 3.2: samples in manuals, and a production archive, which has no ``%``
line and starts with ``METRIC``). Comments begin with ``;``. A part program contains the same
assignments among statements. The reader skips the loops of a part program, which set surplus points
to zero.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from stepdiag.base.errors import DataError
from stepdiag.base.messages import Message, message
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import finite, read_lines

_ASSIGNMENT = re.compile(
    r"^(?:N\d+\s*)?\$(?P<name>A[AN]_[A-Z_]+)\[(?P<index>[^\]]*)\]\s*=\s*(?P<value>\S+)\Z"
)
_SWITCH = re.compile(
    r"^(?:N\d+\s*)?\$(?P<name>"
    r"MA_ENC_COMP_ENABLE|MA_CEC_ENABLE|SN_CEC_TABLE_ENABLE|SN_CEC_TABLE_WEIGHT)\[(?P<index>"
    r"[^\]]*)\]"
    r"\s*=\s*(?P<value>\S+)\Z"
)
_FRAME = re.compile(r"^(%_N_\w+_INI|METRIC|CHANDATA\(\d+\))\Z")
_END = re.compile(r"^(M17|M30|M02|M2)\Z")
_COMPENSATION = ("AA_ENC_COMP", "AN_CEC")


@dataclass(frozen=True, slots=True, kw_only=True)
class Assignment:
    """An assignment ``$name[index] = value``, with its place in the file for messages."""

    name: str
    index: tuple[str, ...]
    value: str
    where: str

    def number(self) -> float:
        return finite(self.value, self.where)

    def text(self) -> str:
        return f"${self.name}[{','.join(self.index)}]={self.value}"

    def axis(self) -> str:
        return self.value.removeprefix("(").removesuffix(")")


def data_file(
    name: str, groups: Sequence[Sequence[str]], notes: Sequence[str], *, metric_line: bool
) -> ControlFile:
    head = [
        f"%_N_{name}_INI",
        *(f"; {note}" for note in notes),
        *(["METRIC"] if metric_line else []),
        "CHANDATA(1)",
    ]
    lines = [*head, *(line for group in groups for line in group), "M17", ""]
    return ControlFile(name=f"{name}.INI", data="\n".join(lines).encode("ascii"))


def is_program(file: ControlFile) -> bool:
    """Return whether the file is a part program, by its purpose in the export or by the ending of
    its name.
    """
    return file.role == "program" or file.name.upper().endswith((".MPF", ".SPF"))


def read_assignments(file: ControlFile) -> list[Assignment]:
    """Return the EEC and CEC assignments of a data file or part program, in order.

    Raises ``DataError``, with the line, for a line that a data file cannot contain, for inches, and
    for a file without its last line.
    """
    program = is_program(file)
    found: list[Assignment] = []
    ended = False
    for where, line in _assignment_lines(file):
        if ended and not program:
            raise DataError(where, expected=message("after-end"), found=line)
        if match := _ASSIGNMENT.match(line):
            if match["name"].startswith(_COMPENSATION):
                index = tuple(part.strip() for part in match["index"].split(","))
                found.append(
                    Assignment(
                        name=match["name"], index=index, value=match["value"], where=where
                    )
                )
        elif _SWITCH.match(line):
            continue
        elif line == "INCH":
            raise DataError(
                where,
                expected=message("metric-file"),
                found="INCH",
                remedy=message("metric-back"),
            )
        elif _END.match(line):
            ended = True
        elif not program and not _FRAME.match(line):
            raise DataError(where, expected=message("sinumerik-assignment"), found=line)
    if not ended:
        raise DataError(
            file.name,
            expected=message("ends-with-m17"),
            found=message("no-eof"),
            remedy=message("file-truncated"),
        )
    return found


def switches_in(files: Iterable[ControlFile]) -> dict[str, str]:
    """Return the switches and weights after loading some files, by variable with index, such as
    ``SN_CEC_TABLE_ENABLE[0]``.
    """
    last: dict[str, str] = {}
    for file in files:
        for _, line in _assignment_lines(file):
            if match := _SWITCH.match(line):
                index = ",".join(part.strip() for part in match["index"].split(","))
                last[f"{match['name']}[{index}]"] = match["value"].upper()
    return last


def require_full_effect(
    file: ControlFile, table: Message, switches: Iterable[str], weight: str
) -> None:
    """Raise ``DataError`` if a part program leaves a table switched off, or with a weight other
    than 1.

    ``switches`` and ``weight`` are variables with their index, such as ``SN_CEC_TABLE_ENABLE[0]``.
    The last assignment of a variable is valid.
    """
    last: dict[str, tuple[str, str]] = {}
    for where, line in _assignment_lines(file):
        if match := _SWITCH.match(line):
            index = ",".join(part.strip() for part in match["index"].split(","))
            last[f"{match['name']}[{index}]"] = (where, match["value"].upper())
    for name in switches:
        where, value = last.get(name, ("", "1"))
        if value in ("0", "FALSE"):
            raise DataError(
                where,
                expected=message("switched-on", table=table),
                found=f"${name}={value}",
                remedy=message("tables-act"),
            )
    where, value = last.get(weight, ("", "1"))
    if finite(value, where) != 1.0:
        raise DataError(
            where,
            expected=message("weight-one", table=table),
            found=f"${weight}={value}",
            remedy=message("bring-weight"),
        )


def _assignment_lines(file: ControlFile) -> Iterator[tuple[str, str]]:
    in_loop = False
    for where, raw in read_lines(file):
        line = raw.partition(";")[0].strip()
        in_loop = in_loop or line.startswith("FOR ")
        if line and not in_loop:
            yield where, line
        in_loop = in_loop and line != "ENDFOR"


def grid_mm(start: float, step: float, end: float, written: int, where: str) -> list[float]:
    """Return the positions of a table in the control, from ``start`` to ``end``.

    A table from another program may end between two points (controllers.md 3.2, MAX 950 with STEP
    100). For such a table, ``end`` is the last position. Raises ``DataError`` for an impossible
    grid, and for a grid with more points than ``written``.
    """
    if step <= 0 or end <= start:
        raise DataError(
            where,
            expected=message("step-above"),
            found=f"MIN {start:g}, MAX {end:g}, STEP {step:g}",
        )
    if (end - start) / step > written:
        raise DataError(
            where,
            expected=message("points-min-max", count=(end - start) / step + 1),
            found=f"{written}",
        )
    count = int((end - start) / step + 1e-9)
    grid = [start + step * index for index in range(count + 1)]
    return grid if abs(grid[-1] - end) <= 1e-6 else [*grid, end]
