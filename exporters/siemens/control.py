"""SINUMERIK 840D, 840D sl, 828D and ONE: EEC tables for the positioning errors, CEC tables for
straightness with squareness.

A curve with a correction for each direction of travel needs two CEC tables with DIRECTION 1 and -1.
A positioning error with two directions also needs two CEC tables (K3 p. 264: the same axis as base
and compensated axis).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import msgspec
import numpy as np

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.findings import Finding, info
from stepdiag.base.messages import message
from stepdiag.base.result.result import POSITIONING
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.siemens import cec, eec, loader, read_back, restore
from stepdiag.exporters.siemens.ini import data_file, is_program, require_full_effect
from stepdiag.exporters.siemens.loader import Load
from stepdiag.exporters.siemens.products import (
    KIND,
    Budget,
    chosen,
    joined,
    numbered,
    product_table,
)
from stepdiag.exporters.tables.controller import Limits, Plan
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.fit import Product
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import absolute_tables, is_directional
from stepdiag.exporters.tables.tables import Sense, Table, plain_rows, zeroed

Size = Annotated[int, msgspec.Meta(ge=0, le=100_000)]
"""Type of a number of points or of a table number. Its bound is far above the limits of the machine
data.
"""


class SiemensOptions(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    measuring_system: Annotated[int, msgspec.Meta(ge=1, le=2)]
    eec_points: dict[str, Size] = {}
    cec_points: Size | None = None
    cec_tables_held: Size | None = None
    cec_max_velo: Annotated[float, msgspec.Meta(gt=0, le=1)] | None = None
    first_cec_table: Size = 0
    cec_tables: dict[str, list[Size]] = {}
    products: bool = False
    cec_sense: Sense = "as-error"
    old_enabled: bool | None = None
    old_weight: Annotated[float, msgspec.Meta(ge=-100, le=100)] | None = None
    decimals: Annotated[int, msgspec.Meta(ge=4, le=6)] = 4
    metric_line: bool = False


_WORTH_SAYING_UM = 0.3
"""Smallest effect in um for which the export offers products: about the uncertainty of a good
survey.
"""
_TEMPLATE = """\
[siemens]
# 1 or 2: which encoder the position control uses now (DB31.. DBX1.5 = 1, DBX1.6 = 2)
measuring_system = "?"
# MD38000 of each axis; then surplus points are written as 0
# eec_points = { X = 100, Y = 100, Z = 100 }
# cec_points = 100            # MD18342, the same for every table used here (828D: 200)
# number of CEC tables of the control (828D: 8; 840D sl: twice its axes); an export with more
# tables is refused
# cec_tables_held = 8
# MD32730 of the compensated axes: the slope of CEC tables is judged by it
# cec_max_velo = 0.1
# first_cec_table = 0         # index of the first free CEC table ($AN_CEC[t,..] counts from 0)
# index by function; two indices where each direction has its own table
# cec_tables = { EYX = [2] }
# true: products of two tables correct the effect of angles with their levers (make the sign test
# of cec-product)
# products = false
# were the tables in machine.existing switched on before this loading (MD32700; MD32710 with
# SD41300)? If only some tables were switched on, save the files with these switches: the switches
# in the files take precedence over this setting
# old_enabled = false
# the weight (SD41310) of the CEC tables in machine.existing, as old_enabled
# old_weight = 1.0
# sense of the CEC tables from the sign test; the manual does not state it
# cec_sense = "as-error"
# decimals = 4                # places in mm
# metric_line = false         # true: begin data files with METRIC, as backups of some controls do
"""


@dataclass(frozen=True, slots=True)
class Siemens:
    name: str = "siemens"
    title: str = "Siemens SINUMERIK 840D, 840D sl, 828D, ONE (EEC and CEC)"
    kinds: tuple[str, ...] = (eec.KIND, cec.KIND, KIND)
    options: type[msgspec.Struct] = SiemensOptions
    options_template: str = _TEMPLATE

    def quick_options(self) -> SiemensOptions:
        return SiemensOptions(measuring_system=1)

    def limits(self, table: Table, profile: Profile) -> Limits:
        """Return the limits of a table by the profile: points (MD38000, MD18342), number of CEC
        tables, and largest slope (MD32730).
        """
        options = profile.options_as(SiemensOptions)
        if table.kind == eec.KIND:
            return Limits(points=options.eec_points.get(table.input_axis))
        # MD32730 limits the speed of the correction to a share of the output axis' top speed; with
        # equal top speeds the slope over the base axis is limited to the same share.
        held = Limits(points=options.cec_points, tables=options.cec_tables_held)
        return (
            held
            if options.cec_max_velo is None
            else replace(held, slope_um_mm=1000.0 * options.cec_max_velo)
        )

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        return self._numbered_plan(curves, (), profile, ())

    def plan_products(
        self, curves: Sequence[Curve], products: Sequence[Product], profile: Profile
    ) -> Plan:
        """Return the tables of the curves, and then of the products with the largest effect for
        which the control has tables.
        """
        options = profile.options_as(SiemensOptions)
        if not options.products:
            plan = self.plan(curves, profile)
            return replace(plan, findings=(*plan.findings, *_possible(products)))
        held = (
            None
            if options.cec_tables_held is None
            else options.cec_tables_held - options.first_cec_table
        )
        budget = chosen(
            curves,
            {curve.name: _cec_tables(curve, profile) for curve in curves},
            products,
            held,
        )
        kept = [
            curve
            for curve in curves
            if curve.name in budget.curves or not _cec_tables(curve, profile)
        ]
        return self._numbered_plan(
            kept, budget.products, profile, tuple(_chosen_remarks(budget, options))
        )

    def _numbered_plan(
        self,
        curves: Sequence[Curve],
        products: Sequence[Product],
        profile: Profile,
        findings: tuple[Finding, ...],
    ) -> Plan:
        options = profile.options_as(SiemensOptions)
        numbers = _free_numbers(options)
        tables = [
            table
            for curve in curves
            for table in _curve_tables(curve, profile, options, numbers)
        ]
        levers: dict[tuple[str, str], int] = {}
        for product in products:
            number = next(numbers)
            key = (product.by_axis, product.output_axis)
            if key not in levers:
                levers[key] = next(numbers)
            place = {"table": number, cec.TIMES: levers[key]}
            tables.append(
                product_table(
                    product, profile, cec.law(options.cec_sense), options.decimals, place
                )
            )
        return Plan(tables=tuple(tables), findings=(*findings, *_remarks(tables, options)))

    def render(
        self, tables: Sequence[Table], profile: Profile, notes: Sequence[str] = ()
    ) -> tuple[ControlFile, ...]:
        options = profile.options_as(SiemensOptions)
        acted, held = profile.machine.measured_with == "on", restore.held_lines(profile)
        eec_loads = [
            Load(
                table=table,
                lines=eec.assignments(table, options.decimals, points),
                held=held(table),
                acted=acted and not restore.is_idle(table, profile),
            )
            for table in tables
            if table.kind == eec.KIND
            for points in [options.eec_points.get(table.input_axis, 0)]
        ]
        cec_loads = [
            Load(
                table=table,
                lines=cec.assignments(
                    table, profile, options.decimals, options.cec_points or 0
                ),
                held=held(table),
                acted=acted and not restore.is_idle(table, profile),
            )
            for table in numbered([table for table in tables if table.kind != eec.KIND])
        ]
        files: list[ControlFile] = []
        if eec_loads:
            data = data_file(
                "AX_EEC",
                [load.lines for load in eec_loads],
                notes,
                metric_line=options.metric_line,
            )
            files += [data, loader.eec_program(eec_loads, notes)]
        if cec_loads:
            data = data_file(
                "NC_CEC",
                [load.lines for load in cec_loads],
                notes,
                metric_line=options.metric_line,
            )
            files += [data, loader.cec_program(cec_loads, profile, notes)]
        return tuple(files)

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        """Return the tables in data files and part programs. A table that is in two files must have
        equal values in both files.
        """
        found: dict[tuple[str, str], tuple[Table, str]] = {}
        for file in files:
            tables = self._numbered_in(file, profile)
            if not tables:
                raise DataError(
                    file.name,
                    expected=message("eec-or-cec"),
                    found=message("none"),
                    remedy=message("data-files"),
                )
            for table in tables:
                _require_full_effect(file, table, profile)
                key = (table.kind, str(sorted(table.place.items())))
                if key in found and not _same(found[key][0], table):
                    raise DataError(
                        file.name,
                        expected=message("same-as-in", label=table.label, file=found[key][1]),
                        found=message("another-one"),
                    )
                found.setdefault(key, (table, file.name))
        return joined(
            [table for table, _ in found.values()], ", ".join(file.name for file in files)
        )

    def standing(
        self, own: Sequence[ControlFile], new: Sequence[ControlFile], profile: Profile
    ) -> tuple[Table, ...]:
        """Return the tables that are active after loading: the EEC table of each axis for the
        measuring system in use, and the CEC tables by number, with linked tables as products.

        If a multiplied table is overwritten, its multiplying table stays and acts by itself. If
        tables were active during the measurement, these are the tables whose switch is on in the
        own files. Loading switches on the tables that it writes, and the CEC of their output
        axes.
        """
        held: dict[tuple[str, str], Table] = {}
        written: set[tuple[str, str]] = set()
        for file in (*own, *new):
            tables = self._numbered_in(file, profile)
            held |= {_seat(table): table for table in tables}
            written |= {_seat(table) for table in tables if file in new}
        outputs = {table.output_axis for seat, table in held.items() if seat in written}
        idle = {
            seat
            for seat, table in held.items()
            if seat not in written and restore.is_idle(table, profile, outputs)
        }
        acting = [
            table
            for seat, table in held.items()
            if seat not in idle and _acts(table, profile)
        ]
        return joined(acting, ", ".join(file.name for file in (*own, *new)))

    def emptied(
        self, own: Sequence[ControlFile], tables: Sequence[Table], profile: Profile
    ) -> tuple[Table, ...]:
        """Return tables of zeros for old tables of the same functions under other numbers, and for
        tables that multiplied an overwritten table.
        """
        held = {
            _seat(table): table for file in own for table in self._numbered_in(file, profile)
        }
        taken = {_seat(table) for table in numbered(tables)}
        names = {table.name for table in tables}
        needed: set[tuple[str, str]] = set()
        for table in self.standing(own, (), profile):
            seats = {_seat(table)} | (
                {_numbered_seat(int(table.place[cec.TIMES]))}
                if table.multiplier is not None
                else set()
            )
            if table.name not in names and not seats & taken:
                needed |= seats
        gone = [
            table
            for seat, table in held.items()
            if seat not in needed | taken and table.value_um.any() and _acts(table, profile)
        ]
        return zeroed(
            [
                replace(
                    table,
                    place={
                        key: value for key, value in table.place.items() if key != cec.TIMES
                    },
                )
                for table in gone
            ]
        )

    def _numbered_in(self, file: ControlFile, profile: Profile) -> tuple[Table, ...]:
        return eec.read_tables(file, profile) + cec.read_tables(
            file, profile, profile.options_as(SiemensOptions).cec_sense
        )

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        """Return the machine's own files, zeros for tables that these files lack, and part programs
        that load both and switch off the tables that the machine did not have.
        """
        options = profile.options_as(SiemensOptions)
        of_screws = [table for table in tables if table.kind == eec.KIND]
        others = [table for table in tables if table.kind != eec.KIND]
        old = restore.Old(
            profile=profile, enabled=options.old_enabled, weight=options.old_weight
        )
        kinds = []
        if of_screws:
            kinds.append(restore.eec_kind(of_screws, profile, options.decimals, old))
        if others:
            kinds.append(
                restore.cec_kind(
                    others, profile, options.decimals, old, sense=options.cec_sense
                )
            )
        return restore.restore_files(kinds, profile, metric_line=options.metric_line)

    def read_back(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        return (read_back.program(tables, profile),)

    def switches(self, tables: Sequence[Table], profile: Profile) -> Mapping[str, str]:
        return read_back.switches(tables, profile)

    def held_switches(self, files: Sequence[ControlFile]) -> Mapping[str, str]:
        return read_back.held_switches(files)

    def recognises(self, file: ControlFile) -> bool:
        """Return whether the file assigns EEC or CEC variables. The part program ``READ_BACK.MPF``
        only reads these variables.
        """
        return file.name != read_back.NAME and (
            b"$AA_ENC_COMP" in file.data or b"$AN_CEC" in file.data
        )

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        if table.multiplier is None:
            return plain_rows(table)
        ends = zip(table.multiplier.position_mm, table.multiplier.value, strict=True)
        lever = ", ".join(f"{value:+.3f} at {at:g} mm" for at, value in ends)
        return (
            f"the movement is this value times {table.multiplier.axis}: {lever}, straight between",
            *plain_rows(table),
        )

    def instructions(self, profile: Profile) -> tuple[str, ...]:
        """Return the steps for the service engineer (K3 pp. 237-264; controllers.md 3)."""
        system = profile.options_as(SiemensOptions).measuring_system
        return (
            (
                "Back up NC data and machine data. Changing MD38000 or MD18342 reformats the "
                "static "
                "memory at the next start."
            ),
            (
                f"Check that measuring system {system} is the one in use, and that MD38000 and "
                "MD18342 hold at least the points of each table."
            ),
            (
                "Run LOAD_EEC.MPF and LOAD_CEC.MPF: they check the sizes and what the control "
                "holds, "
                "switch off, write, switch on."
            ),
            (
                "Or by hand: MD32700 = 0 (EEC), MD32710 = 0 and SD41300 = 0 (CEC), load AX_EEC.INI "
                "and NC_CEC.INI, switch on again."
            ),
            (
                "For CEC set SD41310 (weight) = 1, and see that MD32720 and MD32730 allow the "
                "sums. "
                "The CEC option must be set (alarm 8040)."
            ),
            (
                "NCK reset. EEC needs its axis referenced, CEC needs base and compensated axis "
                "referenced: reference all axes."
            ),
            f"Run {read_back.NAME} and compare what it wrote (READ BACK below).",
            (
                "The positions on the screen do not show the compensation. Measure again; if the "
                "residual has grown, load the restore files:"
            ),
            (
                "LOAD_EEC_RESTORE.MPF and LOAD_CEC_RESTORE.MPF write the old tables with their "
                "switches and weights as they were, and zeros,"
            ),
            (
                "switched off, where there were none. Restored by hand, MD32700, MD32710, SD41300 "
                "and SD41310 go back to what the backup says."
            ),
        )


def _seat(table: Table) -> tuple[str, str]:
    if table.kind == eec.KIND:
        return eec.KIND, f"{table.place['measuring system']},{table.place['axis']}"
    return _numbered_seat(int(table.place["table"]))


def _acts(table: Table, profile: Profile) -> bool:
    used = profile.options_as(SiemensOptions).measuring_system
    return profile.assumed or table.place.get("measuring system", used) == used


def _numbered_seat(number: int) -> tuple[str, str]:
    return cec.KIND, str(number)


def _curve_tables(
    curve: Curve, profile: Profile, options: SiemensOptions, numbers: Iterator[int]
) -> Sequence[Table]:
    quantum_um = 1000.0 * 10.0**-options.decimals
    if _cec_tables(curve, profile):
        planned = absolute_tables(
            curve,
            profile,
            kind=cec.KIND,
            law=cec.law(options.cec_sense),
            quantum_um=quantum_um,
            place={},
        )
        return _numbered(planned, options, numbers, profile)
    place: dict[str, int | str] = {
        "measuring system": options.measuring_system,
        "axis": profile.axis(curve.input_axis).name,
    }
    return absolute_tables(
        curve, profile, kind=eec.KIND, law=eec.LAW, quantum_um=quantum_um, place=place
    )


def _cec_tables(curve: Curve, profile: Profile) -> int:
    directional = is_directional(curve, profile)
    if directional:
        return 2
    return 0 if curve.name in POSITIONING else 1


def _possible(products: Sequence[Product]) -> Iterator[Finding]:
    worth = float(np.sqrt(sum(product.rms_um**2 for product in products)))
    if worth >= _WORTH_SAYING_UM:
        yield info("products-possible", worth_um=worth)


def _chosen_remarks(budget: Budget, options: SiemensOptions) -> Iterator[Finding]:
    if budget.products:
        held = [
            message("product-rms", name=product.name, rms_um=product.rms_um)
            for product in budget.products
        ]
        yield info("products-possible.written", held=held)
    if budget.left_out:
        yield info(
            "function-left-out.tables",
            held=str(options.cec_tables_held),
            left_out=budget.left_out,
        )


def _free_numbers(options: SiemensOptions) -> Iterator[int]:
    taken = {number for numbers in options.cec_tables.values() for number in numbers}
    number = options.first_cec_table
    while True:
        if number not in taken:
            yield number
        number += 1


def _numbered(
    planned: Sequence[Table], options: SiemensOptions, free: Iterator[int], profile: Profile
) -> list[Table]:
    given = options.cec_tables.get(planned[0].name)
    if given is not None and len(given) != len(planned):
        raise UsageError(
            f"{profile.source}: siemens.cec_tables.{planned[0].name}",
            expected=message("table-numbers", count=len(planned)),
            found=str(given),
        )
    return [
        replace(table, place={"table": given[index] if given is not None else next(free)})
        for index, table in enumerate(planned)
    ]


def _remarks(tables: Sequence[Table], options: SiemensOptions) -> Iterator[Finding]:
    sized = {
        eec.KIND: bool(options.eec_points),
        cec.KIND: options.cec_points is not None,
        KIND: options.cec_points is not None,
    }
    if any(not sized[table.kind] for table in tables):
        yield info("surplus-points-unknown")
    if any(table.kind == cec.KIND for table in tables):
        yield info("sign-untested.cec", cec_sense=options.cec_sense)


def _require_full_effect(file: ControlFile, table: Table, profile: Profile) -> None:
    if not is_program(file) or not table.value_um.any():
        return
    if table.kind == eec.KIND:
        system, axis = int(table.place["measuring system"]), table.place["axis"]
        switch = f"MA_ENC_COMP_ENABLE[{system - 1},{axis}]"
        require_full_effect(file, table.label, (switch,), "")
        return
    number, axis = table.place["table"], profile.axis(table.output_axis).name
    switches = (f"SN_CEC_TABLE_ENABLE[{number}]", f"MA_CEC_ENABLE[{axis}]")
    require_full_effect(file, table.label, switches, f"SN_CEC_TABLE_WEIGHT[{number}]")


def _same(one: Table, other: Table) -> bool:
    return (
        one.direction == other.direction
        and one.name == other.name
        and np.array_equal(one.position_mm, other.position_mm)
        and np.array_equal(one.value_um, other.value_um)
    )
