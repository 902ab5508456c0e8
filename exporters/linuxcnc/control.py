"""LinuxCNC: one COMP_FILE of type 0 for each axis, and coefficients of ``matrixkins`` for the
squarenesses.

Source read at commit 5c41560: inijoint.cc, usrmotintf.cc, command.c, control.c, matrixkins.comp. A
row of type 0 is ``nominal forward-actual reverse-actual``. The two actual values are positions and
not corrections, so no sign can be wrong. The first line without three numbers ends the file without
an alarm, so the file contains no comments. A file has at most 256 rows with rising nominal
positions. The control interpolates linearly between rows, uses the end values outside, and adds the
correction in joint space after the kinematics. LinuxCNC has no table for straightness; a finding
names the straightness that remains.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import msgspec
import numpy as np

from stepdiag.base.csv_table import LARGEST
from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.findings import Finding, info
from stepdiag.base.messages import message
from stepdiag.base.result.result import POSITIONING
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile, without_notes
from stepdiag.exporters.files.listing import ascii_lines, finite, read_lines
from stepdiag.exporters.files.naming import plain_name
from stepdiag.exporters.files.numbers import fixed, shortest
from stepdiag.exporters.linuxcnc.ini import (
    Naming,
    axis_in,
    back,
    change,
    named_by,
    unless_named,
)
from stepdiag.exporters.linuxcnc.read_back import read_back_files
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.averaging import straightness_remark
from stepdiag.exporters.tables.controller import Limits, Plan
from stepdiag.exporters.tables.curves import FUNCTIONS, KEPT, SQUARENESS_SLOPE, Curve
from stepdiag.exporters.tables.fit import straight_line_um_mm
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import absolute_tables, quantised
from stepdiag.exporters.tables.seats import overwritten
from stepdiag.exporters.tables.tables import Law, Table, correction_um, plain_rows

SCREW = "comp"
MATRIX = "matrixkins"
SCREW_LAW = Law(sense="as-error")
MATRIX_LAW = Law(sense="as-compensation", ends="extended")
MOST_ROWS = 256
"""Largest number of rows of a COMP_FILE (EMCMOT_COMP_SIZE)."""
_COEFFICIENT_DECIMALS = 9
_HAL_NAME = "squareness.hal"
_SETP = re.compile(
    r"^setp\s+matrixkins\.C_(?P<row>[xyz])(?P<column>[xyz])\s+(?P<value>\S+)\Z"
)


class LinuxCncOptions(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    joints: dict[str, list[int]]
    way: Literal["screw", "kinematics"] = "screw"
    matrixkins: bool = True
    decimals: Annotated[int, msgspec.Meta(ge=4, le=8)] = 6


_TEMPLATE = """\
[linuxcnc]
# the joints of each axis, as in [KINS] and [JOINT_n]: { X = [0], Y = [1], Z = [2] }
joints = "?"
# true: this LinuxCNC contains matrixkins (Debian's 2.9.0~pre1 does not contain it); false:
# squareness is left out
matrixkins = "?"
# "screw": COMP_FILEs and matrixkins; "kinematics": all errors, angles included, by the
# kinematics component of stepdiag
# way = "screw"
# decimals = 6                # places of a correction, in the machine's unit
"""


@dataclass(frozen=True, slots=True)
class LinuxCnc:
    name: str = "linuxcnc"
    title: str = "LinuxCNC (COMP_FILE type 0 and matrixkins)"
    kinds: tuple[str, ...] = (SCREW, MATRIX)
    options: type[msgspec.Struct] = LinuxCncOptions
    options_template: str = _TEMPLATE

    def quick_options(self) -> LinuxCncOptions:
        return LinuxCncOptions(joints={"X": [0], "Y": [1], "Z": [2]})

    def limits(self, table: Table, profile: Profile) -> Limits:
        """Return the largest size of a table, and the part of its values that replaces BACKLASH.
        The control checks neither value nor slope.
        """
        if table.kind != SCREW:
            return Limits()
        return Limits(
            points=MOST_ROWS,
            reference_um=_taken_over(table.input_axis, self._active(profile), profile)[0],
            ends_backlash=True,
        )

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        """Return screw tables for positioning errors and a coefficient for each squareness.

        Raises ``UsageError`` if the machine has the kinematics component, which uses a lattice and
        no tables. Raises ``SafetyError`` (code ``profile-incomplete.backlash``) if the profile
        lacks BACKLASH, which a COMP_FILE switches off.
        """
        if profile.options_as(LinuxCncOptions).way == "kinematics":
            remedy = message("sense-component-stands-its")
            raise UsageError(
                f"{profile.source}: linuxcnc.way",
                expected=message("screw-for-tables"),
                found='"kinematics"',
                remedy=remedy,
            )
        active, matrix = self._active(profile), profile.options_as(LinuxCncOptions).matrixkins
        quantum_um = (
            1000.0 * unit_mm(profile) * 10.0 ** -profile.options_as(LinuxCncOptions).decimals
        )
        tables: list[Table] = []
        for curve in curves:
            if curve.name in POSITIONING:
                place: dict[str, int | str] = {"file": _screw_name(curve.input_axis)}
                own = absolute_tables(
                    curve,
                    profile,
                    kind=SCREW,
                    law=SCREW_LAW,
                    quantum_um=quantum_um,
                    place=place,
                )
                tables += _with_backlash(own, *_taken_over(curve.input_axis, active, profile))
            elif matrix and any(part in SQUARENESS_SLOPE for part in curve.parts):
                tables.append(_matrix_table(curve, _partner(curve, curves)))
        left = () if matrix else tuple(_squareness_remark(curves))
        return Plan(
            tables=tuple(tables), findings=(*straightness_remark(curves, "LinuxCNC"), *left)
        )

    def paired(self, names: Sequence[str], fold: Mapping[str, str]) -> tuple[str, ...]:
        """Return the functions to write. If a function contains a squareness, the second function
        of its pair of axes is written as well, because the straight lines of both functions
        determine the coefficient.
        """
        partners = {f"E{name[2]}{name[1]}" for name in names if name in fold.values()}
        return tuple(name for name in FUNCTIONS if name in partners or name in names)

    def render(
        self, tables: Sequence[Table], profile: Profile, notes: Sequence[str] = ()
    ) -> tuple[ControlFile, ...]:
        screws = {
            letter: [t for t in tables if t.kind == SCREW and t.input_axis == letter]
            for letter in "XYZ"
        }
        files = [
            ControlFile(name=_screw_name(letter), data=_screw_file(of_axis, profile))
            for letter, of_axis in screws.items()
            if of_axis
        ]
        matrix = [table for table in tables if table.kind == MATRIX]
        if matrix:
            lines = [*(f"# {note}" for note in notes), *map(_coefficient_line, matrix)]
            files.append(ControlFile(name=_HAL_NAME, data=ascii_lines(lines)))
        before = self._naming(profile)
        notes = (*notes, *unless_named(before, profile.machine.measured_with))
        return (*files, change(before, self._naming(profile, files, before), notes))

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        """Return the tables of screw files, whose names contain the axis, and of HAL files with
        matrixkins coefficients.
        """
        tables: list[Table] = []
        for file in without_notes(files):
            if lattice.recognises(file):
                raise _lattice_in_control(file, profile)
            found = (
                _read_matrix(file, profile)
                if b"matrixkins" in file.data
                else _read_screw(file, profile)
            )
            tables += found
        return tuple(tables)

    def standing(
        self, own: Sequence[ControlFile], new: Sequence[ControlFile], profile: Profile
    ) -> tuple[Table, ...]:
        return overwritten(
            self.parse(own, profile),
            self.parse(new, profile),
            lambda table: (table.kind, table.kind == SCREW and table.name),
        )

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        """Return the machine's own files, and the lines to remove from the INI file: a COMP_FILE of
        zeros would still disable BACKLASH.
        """
        before = self._naming(profile)
        written = [file for file in self.render(tables, profile) if file.role == "data"]
        notes = unless_named(before, profile.machine.measured_with)
        return (
            *profile.existing,
            back(before, self._naming(profile, written, before), notes),
        )

    def _naming(
        self,
        profile: Profile,
        files: Sequence[ControlFile] | None = None,
        over: Naming | None = None,
    ) -> Naming:
        joints, inch = (
            profile.options_as(LinuxCncOptions).joints,
            profile.machine.units == "inch",
        )
        return named_by(
            profile.existing if files is None else files,
            joints,
            inch=inch,
            source=profile.source,
            over=over,
        )

    def _active(self, profile: Profile) -> tuple[Table, ...]:
        if profile.machine.measured_with == "off" or not profile.existing:
            return ()
        return tuple(
            table for table in self.parse(profile.existing, profile) if table.kind == SCREW
        )

    def read_back(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        return read_back_files(
            [table for table in tables if table.kind == SCREW], unit_mm(profile)
        )

    def recognises(self, file: ControlFile) -> bool:
        first = file.data.split(b"\n", 1)[0].decode("ascii", errors="replace")
        return b"setp matrixkins." in file.data or (
            _three_numbers(first) is not None and axis_in(file.name) is not None
        )

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        return plain_rows(table)

    def instructions(self, profile: Profile) -> tuple[str, ...]:
        return (
            (
                f"Back up the configuration folder. The files are in {profile.machine.units}, the "
                "unit of [TRAJ]LINEAR_UNITS."
            ),
            (
                "Copy this folder to the control and run `/usr/bin/python3 load_comp.py "
                "MACHINE.ini` in it: it compares the COMP_FILEs that the INI file names with "
                "machine.existing, and only then copies the new ones and changes the INI file."
            ),
            (
                "By hand: copy the .comp files beside the INI file and change it as "
                "ini_lines.txt says; what that does not name stays."
            ),
            (
                "COMP_FILE switches [JOINT_n]BACKLASH off: half of it is in each of the two "
                "columns "
                "instead. Leave BACKLASH as it is."
            ),
            (
                "The correction acts on joints whether homed or not: home all axes before "
                "measuring "
                "or machining."
            ),
            (
                "squareness.hal needs KINEMATICS = matrixkins: see whether this LinuxCNC has it "
                "(2.9.0~pre1 has not), otherwise leave it out."
            ),
            (
                "squareness.hal takes the place of the coefficients that matrixkins holds off the "
                "diagonal: nothing is added up by hand."
            ),
            (
                "Restart LinuxCNC: the files are read at its start. The positions on the screen do "
                "not show the correction."
            ),
            (
                "If the residual has grown: `load_comp.py MACHINE.ini --restore`, or copy the "
                "_RESTORE files under their plain names, change the INI file by "
                "ini_lines_RESTORE.txt."
            ),
        )


def _squareness_remark(curves: Sequence[Curve]) -> Iterator[Finding]:
    if names := [
        part for curve in curves for part in curve.parts if part in SQUARENESS_SLOPE
    ]:
        yield info("function-left-out.matrixkins", names=names)


def unit_mm(profile: Profile) -> float:
    return 25.4 if profile.machine.units == "inch" else 1.0


def _lattice_in_control(file: ControlFile, profile: Profile) -> SafetyError:
    return SafetyError(
        f"{profile.source}: machine.existing",
        code="active-table-unfit.lattice",
        expected=message("comp-or"),
        found=message("a-lattice", name=file.name),
        remedy=message("old-kinematics"),
    )


def _taken_over(
    letter: str, active: Sequence[Table], profile: Profile
) -> tuple[float, float]:
    """Return the offsets in um, as errors, of the forward and the reverse column of an axis.

    control.c adds half of BACKLASH in + and subtracts half in -, but does neither with a COMP_FILE.
    So the columns must contain the BACKLASH that was active during the measurement. If a COMP_FILE
    was active, its offset at the reference is kept.
    """
    old = [table for table in active if table.input_axis == letter and table.direction >= 0]
    if old:
        kept = -float(correction_um(old[0], np.array([old[0].reference_mm]), 1)[0])
        return kept, kept
    backlash_um = profile.axis(letter).backlash_um
    if backlash_um is None and not profile.assumed:
        raise SafetyError(
            f"{profile.source}: axes.{letter}.backlash_um",
            code="profile-incomplete.backlash",
            expected=message("joint-backlash", letter=letter),
            found=message("nothing"),
            remedy=message("state-was-while-measuring"),
        )
    half = (backlash_um or 0.0) / 2.0
    return -half, half


def _with_backlash(
    tables: Sequence[Table], forward_um: float, reverse_um: float
) -> tuple[Table, ...]:
    """Return the tables of an axis with an offset per direction. If both columns have the same
    values, the axis has a single table.
    """
    ways = ((tables[0], 1, forward_um), (tables[-1], -1, reverse_um))
    forward, reverse = (
        replace(
            table,
            direction=direction,
            value_um=quantised(table.value_um + offset, table.quantum_um),
        )
        for table, direction, offset in ways
    )
    if np.array_equal(forward.value_um, reverse.value_um):
        return (replace(forward, direction=0),)
    return forward, reverse


def _screw_name(letter: str) -> str:
    return f"screw_{letter.lower()}.comp"


def _matrix_table(curve: Curve, partner: Sequence[Curve]) -> Table:
    """Return the squareness of two axes as a table of one coefficient. Its correction is zero at
    the machine zero, not at the reference.

    A coefficient only rotates one axis against the other. The best rotation over the volume is the
    sum of the slopes of the straight lines that fit both curves of the pair. The end-point line of
    the curve with the squareness is not used.
    """
    slope = (
        straight_line_um_mm(curve) + sum(straight_line_um_mm(other) for other in partner)
    ) * 1e-3
    ends = curve.position_mm[[0, -1]]
    return _coefficient_table(
        curve.output_axis, curve.input_axis, round(-slope, _COEFFICIENT_DECIMALS), ends
    )


def _partner(curve: Curve, curves: Sequence[Curve]) -> list[Curve]:
    """Return the second curve of the pair of axes, for a new squareness coefficient. A coefficient
    from an old table already contains both curves, so no curve is returned.
    """
    pair = [
        each
        for each in curves
        if {each.input_axis, each.output_axis} == {curve.input_axis, curve.output_axis}
    ]
    return (
        []
        if any(KEPT in each.parts for each in pair)
        else [each for each in pair if each is not curve]
    )


def _coefficient_table(
    output_axis: str, input_axis: str, coefficient: float, ends: Vector
) -> Table:
    return Table(
        kind=MATRIX,
        input_axis=input_axis,
        output_axis=output_axis,
        position_mm=ends,
        value_um=coefficient * ends * 1000.0,
        quantum_um=1000.0 * 10.0**-_COEFFICIENT_DECIMALS * float(np.max(np.abs(ends))),
        law=MATRIX_LAW,
        reference_mm=0.0,
        place={"coefficient": f"C_{output_axis.lower()}{input_axis.lower()}"},
    )


def _coefficient_line(table: Table) -> str:
    coefficient = (
        float(np.diff(table.value_um[[0, -1]])[0] / np.diff(table.position_mm[[0, -1]])[0])
        / 1000.0
    )
    number = fixed(coefficient, _COEFFICIENT_DECIMALS)
    return f"setp matrixkins.{table.place['coefficient']} {number}"


def _screw_file(tables: Sequence[Table], profile: Profile) -> bytes:
    """Return the bytes of a COMP_FILE. Nominal and actual positions have the same number of
    decimals, so their difference is the exact value.
    """
    unit = unit_mm(profile)
    forward = next(table for table in tables if table.direction >= 0)
    reverse = next(table for table in tables if table.direction <= 0)
    rows = zip(forward.position_mm, forward.value_um, reverse.value_um, strict=True)
    return ascii_lines(
        " ".join(
            shortest(actual / unit) for actual in (at, at + there / 1000, at + back / 1000)
        )
        for at, there, back in rows
    )


def _read_screw(file: ControlFile, profile: Profile) -> list[Table]:
    letter = axis_in(file.name)
    if letter is None:
        raise DataError(file.name, expected=message("screw-name"), found=file.name)
    if not file.data.endswith(b"\n"):
        raise DataError(
            file.name,
            expected=message("line-end"),
            found=message("none"),
            remedy=message("maybe-cut"),
        )
    rows = np.array(list(_comp_rows(file)))
    if not 2 <= len(rows) <= MOST_ROWS:
        raise DataError(
            file.name, expected=message("2-rows", most_rows=MOST_ROWS), found=str(len(rows))
        )
    unit = unit_mm(profile)
    nominal, forward, reverse = rows.T * unit
    columns = (
        ((0, forward),) if np.array_equal(forward, reverse) else ((1, forward), (-1, reverse))
    )
    return [
        Table(
            kind=SCREW,
            input_axis=letter,
            output_axis=letter,
            position_mm=nominal,
            value_um=(actual - nominal) * 1000.0,
            quantum_um=1000.0 * unit * 10.0 ** -profile.options_as(LinuxCncOptions).decimals,
            law=SCREW_LAW,
            reference_mm=profile.axis(letter).reference_mm,
            direction=direction,
            place={"file": plain_name(file.name)},
        )
        for direction, actual in columns
    ]


def _comp_rows(file: ControlFile) -> Iterator[tuple[float, float, float]]:
    last = -np.inf
    for where, line in read_lines(file):
        row = _three_numbers(line)
        if row is None:
            raise DataError(
                where,
                expected=message("three-numbers"),
                found=repr(line),
                remedy=message("stops-reading"),
            )
        if row[0] <= last:
            raise DataError(
                where, expected=message("nominal-above", place=last), found=f"{row[0]:g}"
            )
        last = row[0]
        yield row


def _three_numbers(line: str) -> tuple[float, float, float] | None:
    try:
        nominal, forward, reverse = (float(word) for word in line.split())
    except ValueError:
        return None
    return (
        (nominal, forward, reverse)
        if all(abs(number) <= LARGEST for number in (nominal, forward, reverse))
        else None
    )


def _read_matrix(file: ControlFile, profile: Profile) -> list[Table]:
    """Return the coefficients of a HAL file as tables over the travel of the multiplied axis, so
    that limits apply to the size of the correction.
    """
    tables = []
    for where, raw in read_lines(file):
        line = raw.partition("#")[0].strip()
        if not line:
            continue
        match = _SETP.match(line)
        if match is None:
            raise DataError(where, expected=message("setp-of-matrixkins"), found=repr(line))
        gain = finite(match["value"], where) - (
            1.0 if match["row"] == match["column"] else 0.0
        )
        column = match["column"].upper()
        tables.append(
            _coefficient_table(
                match["row"].upper(), column, gain, _travel_mm(column, profile)
            )
        )
    return tables


def _travel_mm(letter: str, profile: Profile) -> Vector:
    """Return the ends of an axis in mm by the profile, or a metre to each side if the profile
    states no ends.
    """
    axis = profile.axes.get(letter)
    stated = (
        axis is not None
        and axis.start_mm is not None
        and axis.end_mm is not None
        and axis.end_mm > axis.start_mm
    )
    return (
        np.array([axis.start_mm, axis.end_mm])
        if axis is not None and stated
        else np.array([-1000.0, 1000.0])
    )
