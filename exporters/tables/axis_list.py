"""Controls whose tables are typed in by hand: a list for each axis with the error in + and in -
direction.

Such controls differ only in the fields of `AxisList`: name, heading, law and sizes. Such controls
have no cross table, so the straightness errors stay in the machine.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import msgspec
import numpy as np

from stepdiag.base.errors import DataError, SafetyError
from stepdiag.base.findings import Finding
from stepdiag.base.messages import message
from stepdiag.base.result.result import POSITIONING
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines, finite, read_lines, require_end
from stepdiag.exporters.files.numbers import fixed
from stepdiag.exporters.tables.averaging import straightness_remark
from stepdiag.exporters.tables.controller import Limits, Plan
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.own_files import own_and_zeros
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import absolute_tables
from stepdiag.exporters.tables.seats import overwritten
from stepdiag.exporters.tables.tables import Law, Table


class NoOptions(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The section of a control whose profile asks only about the axes."""


_MARK, _END = b"; rows to key in, up to the line that says end", b"; end"


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisList:
    """A control with typed lists, in the form of `exporters.tables.controller.Controller`.

    ``heading`` contains the control's names of the three columns, with semicolons between them.
    ``decimals`` contains the decimal places of a position and an error in mm. ``points`` and
    ``value_um`` are the largest number of points and the largest value of a table. ``steps``
    contains the actions of the person who types the lists in, ``remarks`` the remarks of every
    export for this control.
    """

    name: str
    title: str
    kind: str
    heading: str
    law: Law
    decimals: int
    points: int
    value_um: float
    steps: tuple[str, ...]
    remarks: tuple[Finding, ...] = ()
    options: type[msgspec.Struct] = NoOptions

    @property
    def kinds(self) -> tuple[str, ...]:
        return (self.kind,)

    @property
    def options_template(self) -> str:
        return f"[{self.name}]\n"

    @property
    def quantum_um(self) -> float:
        return float(10.0 ** (3 - self.decimals))

    def quick_options(self) -> NoOptions:
        return NoOptions()

    def limits(self, table: Table, profile: Profile) -> Limits:  # noqa: ARG002 - part of the protocol
        return Limits(points=self.points, value_um=self.value_um)

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        tables: list[Table] = []
        for curve in curves:
            if curve.name in POSITIONING:
                place: dict[str, int | str] = {"axis": profile.axis(curve.input_axis).name}
                tables += absolute_tables(
                    curve,
                    profile,
                    kind=self.kind,
                    law=self.law,
                    quantum_um=self.quantum_um,
                    place=place,
                )
        return Plan(
            tables=tuple(tables),
            findings=(*straightness_remark(curves, "this list"), *self.remarks),
        )

    def render(
        self, tables: Sequence[Table], profile: Profile, notes: Sequence[str] = ()
    ) -> tuple[ControlFile, ...]:
        """Return a list for each axis. Raises ``SafetyError`` (``direction-unfit.column``) for a
        column of zeros, which the control would read as a missing column.
        """
        by_axis = {
            letter: [table for table in tables if table.input_axis == letter]
            for letter in profile.axes
        }
        return tuple(self._list(of_axis, notes) for of_axis in by_axis.values() if of_axis)

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        return tuple(table for file in files for table in self._read(file, profile))

    def standing(
        self, own: Sequence[ControlFile], new: Sequence[ControlFile], profile: Profile
    ) -> tuple[Table, ...]:
        return overwritten(
            self.parse(own, profile), self.parse(new, profile), lambda table: table.input_axis
        )

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        return own_and_zeros(self, tables, profile, lambda table: table.input_axis)

    def recognises(self, file: ControlFile) -> bool:
        return self.heading.encode("ascii") in file.data

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        way = {0: "both directions", 1: "+ direction", -1: "- direction"}[table.direction]
        points = zip(table.position_mm, table.value_um, strict=True)
        rows = (
            f"{fixed(at, self.decimals):>12} {fixed(value / 1000, self.decimals):>12}"
            for at, value in points
        )
        return (f"position mm   error mm, {way}", *rows)

    def instructions(self, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        return self.steps

    def _list(self, tables: Sequence[Table], notes: Sequence[str]) -> ControlFile:
        axis = tables[0].place["axis"]
        file = f"{self.name}_{axis}.csv"
        forward = next(table for table in tables if table.direction >= 0)
        reverse = next(
            (table.value_um for table in tables if table.direction < 0),
            np.zeros(forward.value_um.shape),
        )
        if len(tables) > 1 and forward.value_um.any() and not reverse.any():
            raise SafetyError(
                file,
                code="direction-unfit.column",
                expected=message("reverse-not-zero"),
                found=message("zeros-read-as-none"),
                remedy=message("export-mean"),
            )
        rows = zip(forward.position_mm, forward.value_um / 1000, reverse / 1000, strict=True)
        written = (";".join(fixed(number, self.decimals) for number in row) for row in rows)
        lines = [
            *(f"; {note}" for note in notes),
            _MARK.decode("ascii"),
            f"AXIS {axis}",
            self.heading,
            *written,
            _END.decode("ascii"),
        ]
        return ControlFile(name=file, data=ascii_lines(lines, "\r\n"))

    def _read(self, file: ControlFile, profile: Profile) -> Iterator[Table]:
        require_end(file, _MARK, _END)
        lines = [
            (where, line)
            for where, line in read_lines(file)
            if line and not line.startswith(";")
        ]
        if (
            len(lines) < 4
            or not lines[0][1].startswith("AXIS ")
            or lines[1][1] != self.heading
            or not file.data.endswith(b"\n")
        ):
            raise DataError(
                file.name,
                expected=message("axis-rows", heading=repr(self.heading)),
                found=message("count-lines", count=len(lines)),
            )
        letter = profile.letter_of(lines[0][1].removeprefix("AXIS "), lines[0][0])
        rows = [
            [finite(cell, where) for cell in line.split(";")] for where, line in lines[2:]
        ]
        if any(len(row) != 3 for row in rows) or any(
            later[0] <= row[0] for row, later in pairwise(rows)
        ):
            raise DataError(
                file.name, expected=message("rows-three"), found=message("other-ones")
            )
        position, forward, reverse = np.array(rows).T
        for direction, error in (
            ((1, forward), (-1, reverse)) if reverse.any() else ((0, forward),)
        ):
            yield Table(
                kind=self.kind,
                input_axis=letter,
                output_axis=letter,
                position_mm=position,
                value_um=error * 1000.0,
                quantum_um=self.quantum_um,
                law=self.law,
                reference_mm=profile.axis(letter).reference_mm,
                direction=direction,
                place={"axis": profile.axis(letter).name},
            )
