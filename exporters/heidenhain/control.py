"""Heidenhain: a ``.COM`` table for each input axis, and the ``.CMA`` file that assigns the tables
to the axes, for two generations of controls.

MANUALplus 620 technical manual pp. 716, 718 (TNC 640 alike), TNC 407 technical manual pp. 153, 622:
in the table that the .CMA file assigns to Y, the column Z contains Z = F(Y). So the columns of the
other axes contain straightness and squareness. Newer controls have the position in each row
(``AXISPOS``), older controls a ``DATUM`` and a ``DISTANCE`` in the first line. The values are
errors in mm: MP720 calls an error positive if the table travels too far (TNC 407 p. 151). No page
states the sense of .COM values, so a sign test is necessary. If the profile contains a .COM file of
the control, the new files use its column widths.

KinematicsComp of the iTNC 530 (HSCI technical manual pp. 666-686): with ``chain`` in the profile,
columns C1 to C6 of an axis contain all its errors except the positioning error. Five rows before
``MachAxis`` of the axis in the kinematics table activate these columns, and apply the rotations
with their levers.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec
import numpy as np

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.findings import Finding, info, warning
from stepdiag.base.kinematics import parse_chain
from stepdiag.base.messages import message
from stepdiag.base.result.result import POSITIONING
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines
from stepdiag.exporters.files.naming import plain_name
from stepdiag.exporters.heidenhain import com
from stepdiag.exporters.tables.angular import COLUMN, angle_tables, columns_of, levers_of
from stepdiag.exporters.tables.averaging import averaged_remarks, averaging
from stepdiag.exporters.tables.controller import Limits, Plan
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.fit import Product
from stepdiag.exporters.tables.own_files import lacking
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import absolute_tables
from stepdiag.exporters.tables.seats import copied
from stepdiag.exporters.tables.tables import Law, Table, plain_rows

KIND = "com"
KINEMATICS = "kinematicscomp"
LINES = "kinematics_comp_lines.txt"
LAW = Law(sense="as-error")
Generation = Literal["tnc640", "itnc530", "tnc4xx"]
_MOST_POINTS = 256
_NEIGHBOUR_UM_MM = 1000.0 / 64.0
"""Largest difference of neighbouring values in um per mm of spacing: a 64th of the spacing (TNC 306
technical manual p. 119).
"""
_TENTH_UM_PER_MM = 10000.0
_QUANTUM_URAD = 1e6 * np.pi / 180.0 * 10.0**-com.DEGREE_DECIMALS


class HeidenhainOptions(
    msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True
):
    generation: Generation
    chain: str | None = None
    decimals: Annotated[int, msgspec.Meta(ge=4, le=6)] = 4
    assignment: Annotated[
        str,
        msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}\.CMA\Z", description="name-such-as-cma"),
    ] = "CONFIG.CMA"


_TEMPLATE = """\
[heidenhain]
# "tnc640" (TNC 620/640, MANUALplus 620), "itnc530", or "tnc4xx" (TNC 407 to 430: spacing 2^n x
# 0.1 um)
generation = "?"
# iTNC 530 with KinematicsComp, to write angles too: the chain of the axes, as in the survey file
# chain = "FXYZ"
# decimals = 4                # places in mm
# assignment = "CONFIG.CMA"   # name of the assignment file in the control
"""


@dataclass(frozen=True, slots=True)
class Heidenhain:
    name: str = "heidenhain"
    title: str = "Heidenhain TNC 640/620, iTNC 530, TNC 4xx (.COM and .CMA)"
    kinds: tuple[str, ...] = (KIND, KINEMATICS)
    options: type[msgspec.Struct] = HeidenhainOptions
    options_template: str = _TEMPLATE

    def quick_options(self) -> HeidenhainOptions:
        return HeidenhainOptions(generation="tnc640")

    def limits(self, table: Table, profile: Profile) -> Limits:  # noqa: ARG002 - the same for every table
        """Return the limits of the older controls. The limits of newer controls are not public."""
        if profile.options_as(HeidenhainOptions).generation == "tnc640":
            return Limits()
        return Limits(points=_MOST_POINTS, neighbour_um_mm=_NEIGHBOUR_UM_MM, slope_um_mm=None)

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        """Return one table for each curve. The values are the mean of both directions, because the
        sense of the BACKLASH column is not public.
        """
        tables = [table for curve in curves for table in _curve_tables(curve, profile)]
        if profile.options_as(HeidenhainOptions).generation == "tnc4xx":
            _check_spacing(tables, profile)
        return Plan(tables=tuple(tables), findings=tuple(_remarks(curves, profile)))

    def plan_products(
        self, curves: Sequence[Curve], products: Sequence[Product], profile: Profile
    ) -> Plan:
        levers = _levers(profile)
        if levers is None:
            return self.plan(curves, profile)
        found = columns_of(curves, products, levers, profile)
        plan = self.plan(found.curves, profile)
        tables = [*plan.tables]
        for angle in found.angles:
            tables += angle_tables(
                angle,
                levers,
                profile,
                kind=KINEMATICS,
                laws=dict.fromkeys("XYZ", LAW),
                quantum_urad=_QUANTUM_URAD,
                place=_place(angle.name[2], profile),
            )
        recalled = info("sign-untested.component", file=LINES)
        return Plan(tables=tuple(tables), findings=(*plan.findings, recalled))

    def render(
        self, tables: Sequence[Table], profile: Profile, notes: Sequence[str] = ()
    ) -> tuple[ControlFile, ...]:
        """Return the .COM files and the .CMA file. These files cannot contain comments, so the
        ``notes`` are a separate file.
        """
        named = _called(profile) | {
            profile.axis(table.input_axis).name: str(table.place["file"]) for table in tables
        }
        beside = (
            [ControlFile(name="heidenhain_notes.txt", data=ascii_lines(notes), role="note")]
            if notes
            else []
        )
        if any(table.kind == KINEMATICS for table in tables):
            beside.append(
                ControlFile(
                    name=LINES,
                    data=ascii_lines(_kinematics_lines(tables, profile)),
                    role="note",
                )
            )
        return (*self._com_files(tables, profile), self._assignment(named, profile), *beside)

    def _com_files(self, tables: Sequence[Table], profile: Profile) -> list[ControlFile]:
        options = profile.options_as(HeidenhainOptions)
        by_input = [
            [table for table in tables if table.input_axis == letter] for letter in "XYZ"
        ]
        positions = options.generation == "tnc640"
        return [
            com.render(of_axis, profile, positions=positions, decimals=options.decimals)
            for of_axis in by_input
            if of_axis
        ]

    def _assignment(self, named: Mapping[str, str], profile: Profile) -> ControlFile:
        name = profile.options_as(HeidenhainOptions).assignment
        return com.render_assignment(
            name, named, [axis.name for axis in profile.axes.values()], profile
        )

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        """Return the tables that the active line of the .CMA file calls. Without a .CMA file, each
        .COM file belongs to the axis in its name.
        """
        coms = [file for file in files if file.name.upper().endswith(".COM")]
        tables_of = {plain_name(file.name).upper(): file for file in coms}
        if len(tables_of) < len(coms):
            raise DataError(
                "files",
                expected=message("table-once"),
                found=", ".join(file.name for file in coms),
            )
        assignments = [file for file in files if file.name.upper().endswith(".CMA")]
        if not tables_of:
            raise DataError(
                "files",
                expected=message("com-table"),
                found=", ".join(file.name for file in files) or message("nothing"),
            )
        if len(assignments) > 1:
            raise DataError(
                "files",
                expected=message("one-cma"),
                found=", ".join(file.name for file in assignments),
            )
        if assignments:
            called = com.read_assignment(assignments[0])
        else:
            called = {
                com.axis_in(name, [axis.name for axis in profile.axes.values()]): name
                for name in tables_of
            }
        tables: list[Table] = []
        beside = {
            plain_name(file.name).upper(): file
            for file in profile.existing
            if file.name.upper().endswith(".COM")
        }
        tables_of = {**beside, **tables_of} if assignments else tables_of
        for axis, name in called.items():
            if name.upper() not in tables_of:
                raise DataError(
                    assignments[0].name,
                    expected=message("calls-for", name=name, axis=axis),
                    found=", ".join(tables_of),
                )
            how = com.Reading(
                kind=KIND, kinematics_kind=KINEMATICS, law=LAW, levers=_levers(profile)
            )
            tables += com.read(
                tables_of[name.upper()], profile.letter_of(axis, name), profile, how
            )
        return tuple(tables)

    def standing(
        self, own: Sequence[ControlFile], new: Sequence[ControlFile], profile: Profile
    ) -> tuple[Table, ...]:
        """Return the tables that the last .CMA file calls, each from the last .COM file with its
        name. The control itself decides which .CMA file is active.
        """
        called = [
            file
            for files in (own, new)
            for file in files
            if file.name.upper().endswith(".CMA")
        ][-1:]
        tables = [file for file in copied(own, new) if not file.name.upper().endswith(".CMA")]
        return self.parse([*tables, *called], profile) if tables else ()

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        """Return the machine's own tables and .CMA file. If the machine has no .CMA file, a
        generated one calls its tables, and zeros replace the new tables.
        """
        if any(file.name.upper().endswith(".CMA") for file in profile.existing):
            return profile.existing
        zeros = lacking(self, tables, profile, _file_of)
        named = {
            profile.axis(table.input_axis).name: str(table.place["file"]) for table in zeros
        } | _called(profile)
        assignment = self._assignment(named, profile)
        return (*profile.existing, *self._com_files(zeros, profile), assignment)

    def recognises(self, file: ControlFile) -> bool:
        return file.name.upper().endswith((".COM", ".CMA")) and file.data.startswith(
            b"BEGIN "
        )

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        return plain_rows(table)

    def instructions(self, profile: Profile) -> tuple[str, ...]:
        """Return the steps for the service engineer (MANUALplus 620 pp. 716-718; TNC 407 pp.
        151-156, 622).
        """
        older = profile.options_as(HeidenhainOptions).generation != "tnc640"
        return (
            "Back up the machine parameters and every .COM and .CMA file of the control.",
            (
                "Positions count from the machine datum: see that the reference of each axis in "
                "the "
                "profile does too."
            ),
            *(
                [
                    (
                        "MP730: set the bit of each axis to nonlinear compensation. Linear (MP720) "
                        "and nonlinear exclude each other."
                    )
                ]
                if older
                else []
            ),
            *(
                [
                    (
                        "Transfer under the extensions .S for .CMA and .V for .COM where the "
                        "control "
                        "is older than the TNC 426."
                    )
                ]
                if older
                else []
            ),
            (
                "Copy the .COM tables and the .CMA file beside each other; its line with * in "
                "ACTIVE "
                "acts (older: soft key, PLC module 9095)."
            ),
            *(
                [
                    (
                        f"KinematicsComp: put the rows of {LINES} into the column COMPTAB of the "
                        "kinematics table; MP4070 limits the rate."
                    ),
                    (
                        "To restore, take these rows out again and copy the _RESTORE files under "
                        "their plain names."
                    ),
                ]
                if _levers(profile) is not None
                else []
            ),
            (
                "The sense of .COM is inferred from MP720: make the sign test before the first "
                "real "
                "table."
            ),
            "Measure again; if the residual has grown, load the restore files.",
        )


def _levers(profile: Profile) -> Vector | None:
    """Return the levers of the angles in KinematicsComp. The rows before an axis rotate only the
    parts that the axis carries, so the travel of the axis itself is no lever.

    Raises ``UsageError`` for a chain on a control without a public form of KinematicsComp.
    """
    options = profile.options_as(HeidenhainOptions)
    if options.chain is None:
        return None
    if options.generation != "itnc530":
        raise UsageError(
            f"{profile.source}: heidenhain.chain",
            expected=message("nothing-or-itnc530"),
            found=f'"{options.generation}"',
            remedy=message("kinematicscomp-not-public"),
        )
    return levers_of(options.chain, own=False)


def _called(profile: Profile) -> dict[str, str]:
    """Return the name of the machine's own table of each axis, from the own .CMA file or from the
    names of the tables. With these names, the new .CMA file still calls the tables that the export
    does not change.
    """
    assignments = [file for file in profile.existing if file.name.upper().endswith(".CMA")]
    if assignments:
        return com.read_assignment(assignments[0])
    names = [
        plain_name(file.name)
        for file in profile.existing
        if file.name.upper().endswith(".COM")
    ]
    axes = [axis.name for axis in profile.axes.values()]
    return {com.axis_in(name, axes): name for name in names}


def _place(input_axis: str, profile: Profile) -> dict[str, int | str]:
    positions = profile.options_as(HeidenhainOptions).generation == "tnc640"
    return {"file": com.file_name(profile.axis(input_axis).name, positions)}


def _curve_tables(curve: Curve, profile: Profile) -> tuple[Table, ...]:
    """Return the tables of a curve. With KinematicsComp, a straightness is written into the column
    C1 to C3 of its direction.
    """
    options = profile.options_as(HeidenhainOptions)
    quantum_um, place, kind = (
        1000.0 * 10.0**-options.decimals,
        _place(curve.input_axis, profile),
        KIND,
    )
    if _levers(profile) is not None and curve.name not in POSITIONING:
        kind, place = KINEMATICS, {**place, COLUMN: curve.name}
    return absolute_tables(
        curve, averaging(profile), kind=kind, law=LAW, quantum_um=quantum_um, place=place
    )


def _kinematics_lines(tables: Sequence[Table], profile: Profile) -> Iterator[str]:
    chain = parse_chain(str(profile.options_as(HeidenhainOptions).chain))
    yield (
        "# KinematicsComp, iTNC 530: rows for the kinematics table, columns NR DOC KEY AXIS "
        "COORD COMPTAB."
    )
    yield (
        "# READ (HSCI technical manual pp. 671, 680, 684, 686): C1 to C6 are the errors of the "
        "axis in X Y Z A B C; the rows stand"
    )
    yield (
        "# before the MachAxis of the axis, seen from the tool; the example for X is 'Trans Y "
        "A..C2'; COMPTAB and MachAxis have at most"
    )
    yield "# 100 entries together."
    yield (
        "# RECALLED, compare with a kinematics table of this control: the words A..C2 for other "
        "axes, degrees for C4 to C6, their sense."
    )
    yield (
        "# No rows after MachAxis are needed: every column is 0 at the reference position of its "
        "axis."
    )
    for axis in reversed((*chain.work, *chain.tool)):
        letter = "XYZ"[axis]
        written = {
            str(table.place[COLUMN])
            for table in tables
            if table.input_axis == letter and COLUMN in table.place
        }
        for component, column in zip("XYZABC", (*com.COMPONENTS, *com.TURNS), strict=True):
            name = f"E{component}{letter}"
            if name in written:
                yield f"{name:<6}Trans    {component}            A..{column}"
        yield f"      MachAxis {profile.axis(letter).name}"


def _file_of(table: Table) -> str:
    return str(table.place["file"]).upper()


def _check_spacing(tables: Sequence[Table], profile: Profile) -> None:
    for table in tables:
        step = float(table.position_mm[1] - table.position_mm[0])
        power = np.log2(step * _TENTH_UM_PER_MM)
        if abs(power - round(power)) > 1e-9:
            lower, upper = (
                2.0 ** np.floor(power) / _TENTH_UM_PER_MM,
                2.0 ** np.ceil(power) / _TENTH_UM_PER_MM,
            )
            raise SafetyError(
                f"{profile.source}: axes.{table.input_axis}.step_mm",
                code="grid-unfit.spacing",
                expected=message("power-two"),
                found=f"{step:g} mm",
                remedy=message("nearest-two", low=lower, high_mm=upper),
            )


def _remarks(curves: Sequence[Curve], profile: Profile) -> Iterator[Finding]:
    yield from averaged_remarks(curves, profile)
    if not any(file.name.upper().endswith((".COM", ".CMA")) for file in profile.existing):
        yield warning("profile-assumed.columns")
    yield info("sign-untested.com")
