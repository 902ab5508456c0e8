"""Beckhoff TwinCAT CNC and the ISG kernel: volumetric error file (ISG_CSV), or axis lists with
``kw.ssfk`` and ``kw.crosscomp``.

Sources at infosys.beckhoff.com: TF5200 axis compensation (leadscrew: pages 308687883, 308695435,
15327297547; cross: 308709003, P-COMP-00004 to 00007) and TF5280 volumetric compensation (296429067,
296390283, 296423819, 296426379). A worked example shows that a leadscrew value is actual minus
setpoint. The volumetric file contains the ISO 230-1 errors; ``negate`` reverses the sense in which
the control applies them. No public page states the sense of a cross value, so the profile must
state it. With ``chain`` in the profile, the volumetric file contains position errors, angles and
squarenesses, and the control computes the effect of the levers of the angles.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.findings import Finding, info
from stepdiag.base.kinematics import parse_chain
from stepdiag.base.messages import message
from stepdiag.base.result.result import POSITIONING
from stepdiag.exporters.beckhoff import csv, parameter_list
from stepdiag.exporters.files.control_file import ControlFile, without_notes
from stepdiag.exporters.files.listing import ascii_lines
from stepdiag.exporters.tables.angular import angle_tables, columns_of, levers_of
from stepdiag.exporters.tables.averaging import averaged_remarks, averaging
from stepdiag.exporters.tables.controller import Limits, Plan
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.fit import Product
from stepdiag.exporters.tables.own_files import own_and_zeros
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import absolute_tables
from stepdiag.exporters.tables.seats import overwritten
from stepdiag.exporters.tables.tables import Law, Sense, Table, plain_rows

VOLCOMP, ANGLE, SSFK, CROSS = "volcomp", "volcomp-angle", "ssfk", "crosscomp"
_SSFK_LAW = Law(sense="as-error")
_CSV_NAME = "volumetric_errors.csv"


class BeckhoffOptions(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    way: Literal["volumetric", "lists"]
    axis_numbers: dict[str, int]
    chain: str | None = None
    turned: bool | None = None
    negate: Annotated[
        str, msgspec.Meta(pattern=r"^[XYZ]{0,3}\Z", description="axes-such-as")
    ] = ""
    cross_sense: Sense | None = None
    master_word: Literal["slave_ax_nr", "master_ax_nr"] = "slave_ax_nr"
    decimals: Annotated[int, msgspec.Meta(ge=4, le=7)] = 5
    max_records: int | None = None
    ssfk_points: int = 1500
    cross_points: int = 1001


_TEMPLATE = """\
[beckhoff]
# "volumetric" (TF5280, ISG_CSV) or "lists" (kw.ssfk and kw.crosscomp in the axis lists)
way = "?"
axis_numbers = "?"            # logical axis numbers, such as { X = 1, Y = 2, Z = 3 }
# volumetric, to write angles and squareness too: the chain of the axes, as in the survey file
# chain = "FXYZ"
# Only with axes on the workpiece side. true: vz_istw or vz_stellgr reverses all of these axes, so
# they count as axes of the tool (workpiece_axes 0). false: no axis is reversed. If only some of
# these axes are reversed, leave chain out.
# turned = false
# negate = ""                 # axes in P-VOLC-00009 of the volumetric configuration, such as "XY"
# cross_sense = "as-error"    # lists: sense of kw.crosscomp from the sign test; no manual states it
# master_word = "slave_ax_nr" # the name of P-COMP-00005 in this version (TwinCAT 2: "master_ax_nr")
# decimals = 5                # volumetric: places in mm
# max_records = 2000          # vol_comp[..].max_records in hochlauf.lis
# ssfk_points = 1500          # kw.ssfk.max_points
# cross_points = 1001         # kw.crosscomp.max_points
"""


@dataclass(frozen=True, slots=True)
class Beckhoff:
    name: str = "beckhoff"
    title: str = "Beckhoff TwinCAT CNC / ISG kernel (ISG_CSV, ssfk and crosscomp lists)"
    kinds: tuple[str, ...] = (VOLCOMP, ANGLE, SSFK, CROSS)
    options: type[msgspec.Struct] = BeckhoffOptions
    options_template: str = _TEMPLATE

    def quick_options(self) -> BeckhoffOptions:
        return BeckhoffOptions(way="volumetric", axis_numbers={"X": 1, "Y": 2, "Z": 3})

    def limits(self, table: Table, profile: Profile) -> Limits:
        options = profile.options_as(BeckhoffOptions)
        # kw_nr_max and last_index must stay below max_points (P-COMP-00059, P-COMP-00060).
        points = {
            VOLCOMP: options.max_records,
            ANGLE: options.max_records,
            SSFK: options.ssfk_points - 1,
            CROSS: options.cross_points,
        }
        return Limits(points=points[table.kind])

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        options = profile.options_as(BeckhoffOptions)
        tables = (
            _volumetric(curves, profile, options)
            if options.way == "volumetric"
            else _lists(curves, profile, options)
        )
        return Plan(tables=tuple(tables), findings=tuple(_remarks(curves, profile, options)))

    def plan_products(
        self, curves: Sequence[Curve], products: Sequence[Product], profile: Profile
    ) -> Plan:
        options = profile.options_as(BeckhoffOptions)
        if options.chain is None or options.way != "volumetric":
            return self.plan(curves, profile)
        levers = levers_of(_chain_held(options, profile.source), own=True)
        found = columns_of(curves, products, levers, profile)
        tables = [*_volumetric(found.curves, profile, options)]
        for angle in found.angles:
            laws, quantum_urad = (
                _volcomp_laws(profile, options),
                1e6 * 10.0**-csv.RAD_DECIMALS,
            )
            tables += angle_tables(
                angle,
                levers,
                profile,
                kind=ANGLE,
                laws=laws,
                quantum_urad=quantum_urad,
                place={},
            )
        return Plan(tables=tuple(tables), findings=tuple(_remarks(curves, profile, options)))

    def render(
        self, tables: Sequence[Table], profile: Profile, notes: Sequence[str] = ()
    ) -> tuple[ControlFile, ...]:
        options = profile.options_as(BeckhoffOptions)
        if options.way == "lists":
            return tuple(
                parameter_list.render(
                    [t for t in tables if t.output_axis == letter],
                    profile,
                    options.axis_numbers,
                    options.master_word,
                    notes,
                )
                for letter in _numbered(profile, options)
                if any(table.output_axis == letter for table in tables)
            )
        configuration = [*(f"# {note}" for note in notes), *_configuration(profile, options)]
        return (
            ControlFile(
                name=_CSV_NAME,
                data=csv.render(tables, options.decimals, notes, _squareness(options)),
            ),
            ControlFile(
                name="volcomp_lines.txt", data=ascii_lines(configuration), role="note"
            ),
        )

    def switches(self, tables: Sequence[Table], profile: Profile) -> Mapping[str, str]:
        """Return ``lr_param.ssfk`` of each axis with a leadscrew list. A volumetric file has no
        switch, because the NC program activates it.
        """
        numbers = profile.options_as(BeckhoffOptions).axis_numbers
        return {
            parameter_list.switch_name(numbers[table.output_axis]): "1"
            for table in tables
            if table.kind == SSFK
        }

    def held_switches(self, files: Sequence[ControlFile]) -> Mapping[str, str]:
        lists = [file for file in without_notes(files) if b"kw." in file.data]
        return {
            name: value
            for file in lists
            for name, value in parameter_list.switches_in(file).items()
        }

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        options = profile.options_as(BeckhoffOptions)
        tables: list[Table] = []
        for file in without_notes(files):
            if b"kw." in file.data:
                senses = {SSFK: _SSFK_LAW.sense, CROSS: options.cross_sense}
                tables += parameter_list.read(file, profile, options.axis_numbers, senses)
            else:
                levers = (
                    None
                    if options.chain is None
                    else levers_of(_chain_held(options, profile.source), own=True)
                )
                laws = _volcomp_laws(profile, options)
                tables += csv.read(
                    file,
                    profile,
                    csv.Reading(kind=VOLCOMP, angle_kind=ANGLE, laws=laws, levers=levers),
                )
        if not tables:
            raise DataError(
                "files",
                expected=message("csv-or-list"),
                found=", ".join(file.name for file in files) or message("nothing"),
            )
        return tuple(tables)

    def standing(
        self, own: Sequence[ControlFile], new: Sequence[ControlFile], profile: Profile
    ) -> tuple[Table, ...]:
        """Return the tables that are active after loading. A new volumetric file or axis list
        replaces the old file or list completely.
        """
        held, loaded = (self.parse(files, profile) if files else () for files in (own, new))
        return overwritten(held, loaded, _seat)

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        """Return the machine's own volumetric file and axis lists. A file that the machine did not
        have is restored as zeros.
        """
        return own_and_zeros(self, tables, profile, _seat)

    def recognises(self, file: ControlFile) -> bool:
        return any(
            word in file.data for word in (b"kw.ssfk.", b"kw.crosscomp.")
        ) or csv.recognises(file)

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        return plain_rows(table)

    def instructions(self, profile: Profile) -> tuple[str, ...]:
        if profile.options_as(BeckhoffOptions).way == "volumetric":
            return (
                "Back up the volumetric configuration and the error files in use.",
                (
                    "Add the lines of volcomp_lines.txt to the configuration; chain and "
                    "workpiece_axes have to be as the machine is built."
                ),
                (
                    f"The axes must be called as they were measured. Copy {_CSV_NAME} where "
                    "file[0] "
                    "says."
                ),
                "Load with #VOLCOMP [ID0 UPDATE] while the compensation is off, then switch it on.",
                (
                    "Sign test first: P-VOLC-00009 negate exists because senses differ. Measure "
                    "again; if the residual has grown, restore."
                ),
            )
        return (
            (
                "Back up the axis lists (achskw*.lis). What they hold beside ssfk and crosscomp "
                "must "
                "be kept: merge by hand."
            ),
            (
                "Set lr_param.ssfk 1 and lr_param.crosscomp 1 in the axis lists of the machine "
                "data "
                "(P-AXIS-00175, P-AXIS-00047)."
            ),
            (
                "Both act on homed axes only. Switch off with X[COMP OFF LEAD] and X[COMP OFF "
                "CROSS] "
                "for a comparison."
            ),
            "A list with two columns holds the reversal: set the backlash of that axis to 0.",
            (
                "Sign test first for crosscomp: no page states its sense. Measure again; if the "
                "residual has grown, restore."
            ),
        )


def _seat(table: Table) -> str:
    return VOLCOMP if table.kind in (VOLCOMP, ANGLE) else table.output_axis


def _volcomp_law(letter: str, options: BeckhoffOptions) -> Law:
    return Law(sense="as-compensation" if letter in options.negate else "as-error")


def _volcomp_laws(profile: Profile, options: BeckhoffOptions) -> dict[str, Law]:
    if options.chain is not None and set(options.negate) not in (set(), set("XYZ")):
        raise UsageError(
            f"{profile.source}: beckhoff.negate",
            expected=message("negate-of-axes"),
            found=options.negate,
        )
    return {letter: _volcomp_law(letter, options) for letter in "XYZ"}


def _chain_held(options: BeckhoffOptions, source: str) -> str:
    """Return the kinematic chain in the notation of the control (ISG 296411019, P-VOLC-00008).

    If the axis parameters vz_istw and vz_stellgr reverse an axis on the workpiece side, survey and
    control must both treat this axis as a tool axis. The angles of such an axis also displace the
    axis itself. The curves of the axis contain this displacement, because a tool axis has no such
    displacement in the control. Raises ``UsageError`` if the chain has axes on the workpiece side
    and the profile does not state ``turned``.
    """
    chain = options.chain or ""
    work, tool = parse_chain(chain)
    if work and options.turned is None:
        axes = ["XYZ"[axis] for axis in work]
        raise UsageError(
            f"{source}: beckhoff.turned",
            expected=message("turned-or-not", axes=axes),
            found=message("nothing"),
            remedy=message("see-vz-istw"),
        )
    return "F" + "".join("XYZ"[axis] for axis in (*work, *tool)) if options.turned else chain


def _squareness(options: BeckhoffOptions) -> tuple[str, ...]:
    order = (
        ""
        if options.chain is None
        else "".join("XYZ"[axis] for side in parse_chain(options.chain) for axis in side)
    )
    return tuple(
        name
        for name, target in csv.SHIFTS.items()
        if order and order.index(target[1]) < order.index(target[2])
    )


def _volumetric(
    curves: Sequence[Curve], profile: Profile, options: BeckhoffOptions
) -> Iterator[Table]:
    """Yield the tables of the ISO 230-1 components.

    The values are the mean of both directions, because the file has no direction. ``negate``
    reverses the sense in the control; the numbers in the file stay the errors of the machine.
    """
    quantum_um = 1000.0 * 10.0**-options.decimals
    for curve in curves:
        law = _volcomp_law(curve.output_axis, options)
        yield from absolute_tables(
            curve,
            averaging(profile),
            kind=VOLCOMP,
            law=law,
            quantum_um=quantum_um,
            place={"column": curve.name},
        )


def _lists(
    curves: Sequence[Curve], profile: Profile, options: BeckhoffOptions
) -> Iterator[Table]:
    masters: dict[str, str] = {}
    for curve in curves:
        place: dict[str, int | str] = {
            "list": f"achskw{options.axis_numbers.get(curve.output_axis, 0)}.lis"
        }
        if curve.name in POSITIONING:
            yield from absolute_tables(
                curve,
                profile,
                kind=SSFK,
                law=_SSFK_LAW,
                quantum_um=parameter_list.QUANTUM_UM,
                place=place,
            )
            continue
        other = masters.setdefault(curve.output_axis, curve.input_axis)
        if other != curve.input_axis:
            raise SafetyError(
                f"{profile.source}: machine.functions",
                code="control-full.cross-table",
                expected=message("cross-one", axis=curve.output_axis),
                found=message(
                    "table-and-other",
                    output_axis=curve.output_axis,
                    other=other,
                    name=curve.name,
                ),
                remedy=message("leave-one"),
            )
        yield from _cross(curve, profile, options, place)


def _cross(
    curve: Curve, profile: Profile, options: BeckhoffOptions, place: dict[str, int | str]
) -> Iterator[Table]:
    if options.cross_sense is None:
        raise UsageError(
            f"{profile.source}: beckhoff.cross_sense",
            expected=message("as-sign-test"),
            found=message("nothing"),
            remedy=message("no-page"),
        )
    law = Law(sense=options.cross_sense)
    yield from absolute_tables(
        curve,
        averaging(profile),
        kind=CROSS,
        law=law,
        quantum_um=parameter_list.QUANTUM_UM,
        place=place,
    )


def _remarks(
    curves: Sequence[Curve], profile: Profile, options: BeckhoffOptions
) -> Iterator[Finding]:
    bilateral = POSITIONING if options.way == "lists" else ()
    yield from averaged_remarks(
        [curve for curve in curves if curve.name not in bilateral], profile
    )
    if options.way == "volumetric":
        if options.chain is not None:
            yield info("sign-untested.chain")
        yield info("sign-untested.volumetric-file")


def _numbered(profile: Profile, options: BeckhoffOptions) -> list[str]:
    for letter in profile.axes:
        if letter not in options.axis_numbers:
            raise UsageError(
                f"{profile.source}: beckhoff.axis_numbers",
                expected=message("number-of", letter=letter),
                found=str(options.axis_numbers),
            )
    return list(profile.axes)


def _configuration(profile: Profile, options: BeckhoffOptions) -> Iterator[str]:
    for letter in _numbered(profile, options):
        yield f"{letter} {options.axis_numbers[letter]}"
    if options.chain is not None:
        work, tool = parse_chain(_chain_held(options, profile.source))
        yield "# chain: a string (P-VOLC-00007), its order from workpiece to tool DERIVED, not READ"
        yield "# workpiece_axes: how many of them carry the workpiece (P-VOLC-00008)"
        if options.turned:
            yield (
                "# vz_istw or vz_stellgr turns the axes on the workpiece side: they count as "
                "axes of the tool"
            )
        yield f"chain {''.join('XYZ'[axis] for axis in (*work, *tool))}"
        yield f"workpiece_axes {len(work)}"
    yield from ("interpolation GRID", f"file[0] {_CSV_NAME}", "file_format[0] ISG_CSV")
    if options.negate:
        yield f"negate {options.negate}"
