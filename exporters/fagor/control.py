"""Fagor 8055: the leadscrew compensation table of each axis, as a list to be keyed in.

Manual of the 8055i, p. 328: with LSCRWCOM (P15) on and NPOINTS (P16) points, each row holds a position from machine zero, the amount of
error in the + direction and in the - direction, in mm; a - column of zeros means that the + column counts for both. "Amount of error":
as error, by the wording. No transfer format is public, and no cross table is described.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import msgspec
import numpy as np

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines, finite, read_lines
from stepdiag.exporters.files.numbers import fixed
from stepdiag.exporters.tables.averaging import straightness_remark
from stepdiag.exporters.tables.controller import Limits, Plan
from stepdiag.exporters.tables.curves import POSITIONING, Curve
from stepdiag.exporters.tables.own_files import own_and_zeros
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import absolute_tables
from stepdiag.exporters.tables.tables import Law, Table
from stepdiag.solver.errors import DataError, SafetyError
from stepdiag.solver.findings import Finding

KIND = "leadscrew"
LAW = Law(sense="as-error")
_DECIMALS = 4
_QUANTUM_UM = 0.1
_MOST_POINTS = 1000
_MOST_UM = 99999.9999e3
_HEADING = "POSITION;ERROR +;ERROR -"


class FagorOptions(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """``[fagor]``: nothing to ask beyond the axes."""


@dataclass(frozen=True, slots=True)
class Fagor:
    """Fagor 8055 as `exporters.tables.controller.Controller`."""

    name: str = "fagor"
    title: str = "Fagor 8055 (leadscrew compensation tables as lists)"
    kinds: tuple[str, ...] = (KIND,)
    options: type[msgspec.Struct] = FagorOptions
    options_template: str = "[fagor]\n"

    def quick_options(self) -> FagorOptions:
        """Return the options of a quick look: there are none."""
        return FagorOptions()

    def limits(self, table: Table, profile: Profile) -> Limits:  # noqa: ARG002 - part of the protocol
        """Return the size of the table and of a value."""
        return Limits(points=_MOST_POINTS, value_um=_MOST_UM)

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        """Return the tables of the positioning errors."""
        tables: list[Table] = []
        for curve in curves:
            if curve.name in POSITIONING:
                place: dict[str, int | str] = {"axis": profile.axis(curve.input_axis).name}
                tables += absolute_tables(curve, profile, kind=KIND, law=LAW, quantum_um=_QUANTUM_UM, place=place)
        return Plan(tables=tuple(tables), findings=tuple(_remarks(curves)))

    def render(self, tables: Sequence[Table], profile: Profile, notes: Sequence[str] = ()) -> tuple[ControlFile, ...]:
        """Return one list for each axis."""
        by_axis = {letter: [table for table in tables if table.input_axis == letter] for letter in profile.axes}
        return tuple(_list(of_axis, notes) for of_axis in by_axis.values() if of_axis)

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        """Return the tables of such lists."""
        return tuple(table for file in files for table in _read(file, profile))

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        """Return the machine's own lists, and a list of zeros for every axis that has none."""
        return own_and_zeros(self, tables, profile, lambda table: table.input_axis)

    def recognises(self, file: ControlFile) -> bool:
        """Return whether the file is such a list, by its heading."""
        return _HEADING.encode("ascii") in file.data

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        """Return the column of the table as it is keyed in."""
        way = {0: "both directions", 1: "+ direction", -1: "- direction"}[table.direction]
        points = zip(table.position_mm, table.value_um, strict=True)
        return (
            f"position mm   error mm, {way}",
            *(f"{fixed(at, _DECIMALS):>12} {fixed(value / 1000, _DECIMALS):>12}" for at, value in points),
        )

    def instructions(self, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        """Return the steps for the service engineer."""
        return (
            "Back up the machine parameters and the leadscrew tables.",
            "Set LSCRWCOM (P15) to ON and NPOINTS (P16) to the number of rows of each axis; key in the rows in rising order.",
            "A column ERROR - of zeros means that ERROR + counts for both directions. Set BACKLASH to 0 where both columns differ.",
            "Positions count from machine zero; the error at the reference is 0. Restart, reference the axes.",
            "The sense is taken from the wording: sign test first. Measure again; if the residual has grown, key in the restore list.",
        )


def _remarks(curves: Sequence[Curve]) -> Iterator[Finding]:
    yield from straightness_remark(curves, "this list")
    yield Finding(
        code="sense-derived", severity="info", text="Fagor's amount of error is taken as error by its wording; make the sign test"
    )


def _list(tables: Sequence[Table], notes: Sequence[str]) -> ControlFile:
    axis = tables[0].place["axis"]
    forward = next(table for table in tables if table.direction >= 0)
    reverse = next((table.value_um for table in tables if table.direction < 0), np.zeros(forward.value_um.shape))
    if len(tables) > 1 and forward.value_um.any() and not reverse.any():
        raise SafetyError(
            f"fagor_{axis}.csv", code="reverse-column-zero", expected="an error in the - direction that is not 0 throughout",
            found="zeros, which the control reads as: use the + column", remedy='export this axis with machine.direction = "mean"',
        )  # fmt: skip
    rows = zip(forward.position_mm, forward.value_um / 1000, reverse / 1000, strict=True)
    lines = [
        *(f"; {note}" for note in notes),
        f"AXIS {axis}",
        _HEADING,
        *(";".join(fixed(number, _DECIMALS) for number in row) for row in rows),
    ]
    return ControlFile(name=f"fagor_{axis}.csv", data=ascii_lines(lines, "\r\n"))


def _read(file: ControlFile, profile: Profile) -> Iterator[Table]:
    lines = [(where, line) for where, line in read_lines(file) if line and not line.startswith(";")]
    if len(lines) < 4 or not lines[0][1].startswith("AXIS ") or lines[1][1] != _HEADING or not file.data.endswith(b"\n"):
        raise DataError(file.name, expected=f"AXIS, {_HEADING!r}, two or more rows and a line end", found=f"{len(lines)} lines")
    letter = profile.letter_of(lines[0][1].removeprefix("AXIS "), lines[0][0])
    rows = [[finite(cell, where) for cell in line.split(";")] for where, line in lines[2:]]
    if any(len(row) != 3 for row in rows) or any(later[0] <= row[0] for row, later in pairwise(rows)):
        raise DataError(file.name, expected="rows of three numbers with rising positions", found="others")
    position, forward, reverse = np.array(rows).T
    for direction, error in ((1, forward), (-1, reverse)) if reverse.any() else ((0, forward),):
        yield Table(
            kind=KIND,
            input_axis=letter,
            output_axis=letter,
            position_mm=position,
            value_um=error * 1000.0,
            quantum_um=_QUANTUM_UM,
            law=LAW,
            reference_mm=profile.axis(letter).reference_mm,
            direction=direction,
            place={"axis": profile.axis(letter).name},
        )
