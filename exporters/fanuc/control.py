"""FANUC: stored pitch error compensation, inclination and four-point straightness, written into the
machine's own punch files.

Without the machine's own punch files, no file for the control is written: the prefix of a pitch
line differs between series of controls, and a wrong prefix changes parameters (controllers.md 2.6).
In this case the readable report contains the values to type in.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.findings import Finding, error, info
from stepdiag.base.messages import message
from stepdiag.base.result.result import POSITIONING
from stepdiag.exporters.fanuc import lines, pitch
from stepdiag.exporters.fanuc.identity import identity_findings
from stepdiag.exporters.fanuc.options import TEMPLATE, AxisPoints, FanucOptions
from stepdiag.exporters.fanuc.parameters import (
    BIDIRECTIONAL,
    DISABLED,
    INTERVAL,
    SET_BY_HAND,
    Key,
    fitted,
    parameter_rows,
    parameters_of,
    stored_in,
    switch_name,
    switches_in,
)
from stepdiag.exporters.fanuc.punch import FIRST_PITCH_LINE, PunchFile, read_punch
from stepdiag.exporters.fanuc.reading import read_tables
from stepdiag.exporters.fanuc.straightness import given_to
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import finite
from stepdiag.exporters.tables.controller import Limits, Plan
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import is_directional
from stepdiag.exporters.tables.seats import copied
from stepdiag.exporters.tables.tables import Table, correction_um

__all__ = ["Fanuc", "FanucOptions"]


@dataclass(frozen=True, slots=True)
class Fanuc:
    name: str = "fanuc"
    title: str = (
        "FANUC 0i-D/F, 16i/18i, 30i/31i/32i/35i "
        "(stored pitch error, inclination, straightness)"
    )
    kinds: tuple[str, ...] = (pitch.KIND, lines.INCLINATION, lines.STRAIGHTNESS)
    options: type[msgspec.Struct] = FanucOptions
    options_template: str = TEMPLATE

    def quick_options(self) -> FanucOptions:
        axes = {
            letter: AxisPoints(number=n, reference_point=200 * n - 100)
            for n, letter in enumerate("XYZ", start=1)
        }
        return FanucOptions(detection_unit_um=1.0, axes=axes)

    def limits(self, table: Table, profile: Profile) -> Limits:
        options = profile.options_as(FanucOptions)
        if table.kind != pitch.KIND:
            return Limits(points=4)
        return Limits(
            points=options.points_per_axis,
            neighbour_um=options.increment_limit * table.quantum_um,
            slope_um_mm=None,
        )

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        masters = [read_punch(file) for file in profile.existing]
        wide = [
            curve
            for curve in curves
            if curve.name not in POSITIONING and len(profile.grid_mm(curve.input_axis)) >= 4
        ]
        asked = profile.options_as(FanucOptions)
        fitted = {
            curve.name: lines.line_table(lines.STRAIGHTNESS, curve, profile, asked)
            for curve in wide
        }
        options = given_to(
            {name: table for name, (table, _) in fitted.items()},
            asked,
            masters,
            profile.source,
        )
        tables: list[Table] = []
        listed: list[Table] = []
        findings: list[Finding] = []
        for curve in curves:
            if curve.name in POSITIONING:
                tables += _positioning(curve, profile, options)
            elif curve.name not in fitted:
                findings.append(info("function-left-out.points", name=curve.name))
            else:
                table, left_um = fitted[curve.name]
                if (numbers := options.straightness.get(curve.name)) is None:
                    listed.append(table)
                else:
                    tables.append(
                        replace(table, place={**table.place, "set": numbers.moving})
                    )
                findings.append(_straightness_remark(curve, left_um, options))
        _require_pitch_points(tables, masters, profile)
        if asked.straightness_option and options.straightness != asked.straightness:
            findings.append(info("sign-untested.recalled"))
        return Plan(
            tables=tuple(tables),
            findings=(
                *findings,
                *_overlaps(tables),
                *identity_findings(masters, profile, options),
            ),
            listed=tuple(listed),
            options=_with_magnifications(options, tables),
        )

    def render(
        self,
        tables: Sequence[Table],
        profile: Profile,
        notes: Sequence[str] = (),  # noqa: ARG002
    ) -> tuple[ControlFile, ...]:
        """Return the machine's own punch files with new numbers after each P; every other byte is
        unchanged.

        Raises ``SafetyError`` (code ``template-missing``) if the machine's punched pitch data are
        missing.
        """
        options = profile.options_as(FanucOptions)
        pitch = {
            point: value for table in tables for point, value in stored_in(table).items()
        }
        parameters = parameters_of(tables, profile, options)
        masters = [read_punch(file) for file in profile.existing]
        with_pitch = [master for master in masters if master.pitch]
        if not with_pitch:
            raise SafetyError(
                f"{profile.source}: machine.existing",
                code="template-missing",
                expected=message("own-pitch"),
                found=", ".join(file.name for file in profile.existing)
                or message("no-table-file"),
                remedy=message("punch-pitch-data-out"),
            )
        _refuse_lacking(parameters, masters, profile)
        written = [
            ControlFile(
                name=master.name,
                data=master.changed(
                    pitch if master.pitch else {}, fitted(parameters, master, options)
                ),
            )
            for master in masters
        ]
        return tuple(written)

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        """Return the tables in the punch files, for the axes of the profile.

        Point numbers, interval and magnification are read from the parameters in the files, or else
        from the profile. Raises ``UsageError`` without a profile, because punch files do not
        contain the reference position.
        """
        if profile.assumed:
            expected = message("profile-punch")
            raise UsageError("--profile", expected=expected, found=message("none"))
        options = profile.options_as(FanucOptions)
        punched = [read_punch(file) for file in files]
        if not any(master.pitch for master in punched):
            where = ", ".join(file.name for file in files) or message("no-table-file")
            raise DataError(
                where,
                expected=message("pitch-data", number=FIRST_PITCH_LINE),
                found=message("none"),
            )
        return read_tables(punched, profile, options)

    def standing(
        self, own: Sequence[ControlFile], new: Sequence[ControlFile], profile: Profile
    ) -> tuple[Table, ...]:
        """Return the tables of the control after loading. A new punch file replaces the machine's
        file from which it was made.
        """
        files = copied(own, new)
        if not new:
            _require_interval([read_punch(file) for file in own], profile)
        return self.parse(files, profile) if files else ()

    def switches(self, tables: Sequence[Table], profile: Profile) -> Mapping[str, str]:
        """Return the switches 8135#0 and 3605#0 of the axes with pitch data, if the machine's own
        files contain these parameters. Not every series of controls has these parameters.
        """
        needed = parameters_of(tables, profile, profile.options_as(FanucOptions))
        both = {
            axis: text for (number, axis), text in needed.items() if number == BIDIRECTIONAL
        }
        wanted = {switch_name(DISABLED, None): "0"}
        wanted |= {
            switch_name(BIDIRECTIONAL, axis): both.get(axis, "0")
            for number, axis in needed
            if number == INTERVAL
        }
        own = switches_in([read_punch(file) for file in profile.existing])
        return {name: value for name, value in wanted.items() if name in own}

    def held_switches(self, files: Sequence[ControlFile]) -> Mapping[str, str]:
        return switches_in([read_punch(file) for file in files])

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:  # noqa: ARG002 - the files hold all that changes
        """Return the machine's own punch files: an export changes only numbers in them."""
        return profile.existing

    def recognises(self, file: ControlFile) -> bool:
        return (
            file.data.lstrip().startswith(b"%")
            and b"\nN" in file.data.replace(b"\r", b"")
            and b"_N_" not in file.data[:40]
        )

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:
        return parameter_rows(table, profile, profile.options_as(FanucOptions))

    def instructions(self, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        return (
            (
                "Punch out parameters and pitch data first (SYSTEM > PARAM > PUNCH, SYSTEM > "
                "PITCH > "
                "PUNCH) and keep them."
            ),
            (
                "Copy the files in binary; on the memory card only the new file should lie, many "
                "files can hide it."
            ),
            (
                "EDIT or emergency stop, parameter write enable 1 (alarm 100 comes), I/O channel "
                "4, "
                "SYSTEM > PITCH > (OPRT) > READ;"
            ),
            "a file of parameters the same way under SYSTEM > PARAM.",
            (
                "See that 3620-3624 are as in the report and that the ranges of the axes do not "
                "overlap; 8135#0 (NPE) must be 0 on 0i-D."
            ),
            (
                "Parameter write enable 0, power off and on, reference return of every axis: only "
                "then the table acts."
            ),
            "1851 (backlash) stays as it is unless the report says otherwise.",
            "Measure again; if the residual has grown, read the restore files in.",
        )


def _positioning(curve: Curve, profile: Profile, options: FanucOptions) -> list[Table]:
    if is_directional(curve, profile) and not options.experimental_bidirectional:
        raise SafetyError(
            f"{profile.source}: machine.direction",
            code="direction-unfit.unproven",
            expected=message("mean-or-both"),
            found='"both"',
            remedy=message("mean-curve-with-reversal"),
        )
    if not options.axis(curve.input_axis, profile.source).inclination:
        nothing = np.zeros(len(profile.grid_mm(curve.input_axis)))
        return list(pitch.pitch_tables(curve, profile, options, nothing))
    inclined, _ = lines.line_table(lines.INCLINATION, curve, profile, options)
    already = correction_um(inclined, profile.grid_mm(curve.input_axis))
    return [inclined, *pitch.pitch_tables(curve, profile, options, already)]


def _with_magnifications(options: FanucOptions, tables: Sequence[Table]) -> FanucOptions:
    axes = dict(options.axes)
    for table in tables:
        if table.kind == pitch.KIND:
            magnification = round(table.quantum_um / options.detection_unit_um)
            axes[table.input_axis] = msgspec.structs.replace(
                axes[table.input_axis], magnification=magnification
            )
    return msgspec.structs.replace(options, axes=axes)


def _refuse_lacking(
    parameters: Mapping[Key, str], masters: Sequence[PunchFile], profile: Profile
) -> None:
    needed = [
        key
        for key, text in parameters.items()
        if key[0] not in SET_BY_HAND and (key[0], text) != (BIDIRECTIONAL, "0")
    ]
    missing = [
        key for key in needed if all(master.parameter(*key) is None for master in masters)
    ]
    if missing:
        raise SafetyError(
            f"{profile.source}: machine.existing",
            code="template-missing.parameters",
            expected=message("own-parameters"),
            found=message(
                "none-number",
                numbers=[
                    f"{number}{'' if axis is None else f' A{axis}'}"
                    for number, axis in missing[:6]
                ],
            ),
            remedy=message("punch-too"),
        )


def _require_interval(own: Sequence[PunchFile], profile: Profile) -> None:
    """Raise SafetyError if the machine's own files contain pitch data without the interval of these
    data. The profile contains only the interval of the new table.
    """
    if not any(any(file.pitch.values()) for file in own):
        return
    axes = [axis.number for axis in profile.options_as(FanucOptions).axes.values()]
    missing = [
        number
        for number in axes
        if all(file.parameter(INTERVAL, number) is None for file in own)
    ]
    if missing:
        raise SafetyError(
            f"{profile.source}: machine.existing",
            code="template-missing.parameters",
            expected=message("interval-parameter-pitch-data", interval=INTERVAL),
            found=message("none-for-axes", names=[f"A{number}" for number in missing]),
            remedy=message("punch-too"),
        )


def _require_pitch_points(
    tables: Sequence[Table], masters: Sequence[PunchFile], profile: Profile
) -> None:
    """Raise SafetyError for a four-point table that refers to old pitch points, if the interval of
    these points in the machine's own file differs from the profile.
    """
    options = profile.options_as(FanucOptions)
    own = {table.input_axis for table in tables if table.kind == pitch.KIND}
    for letter in sorted({table.input_axis for table in tables} - own):
        number, step_mm = options.axes[letter].number, profile.axis(letter).step_mm
        for text in (
            text
            for master in masters
            if (text := master.parameter(INTERVAL, number)) is not None
        ):
            interval_mm = finite(text, f"parameter {INTERVAL} A{number}") * (
                1.0 if "." in text else options.least_input_um / 1000.0
            )
            if abs(interval_mm - step_mm) > 1e-6:
                name = next(table.name for table in tables if table.input_axis == letter)
                raise SafetyError(
                    f"{profile.source}: machine.functions",
                    code="profile-incomplete.pitch-points",
                    expected=message(
                        "e-beside-whose-points", letter=letter, name=name, step_mm=step_mm
                    ),
                    found=message("interval-own", number=INTERVAL, step_mm=interval_mm),
                    remedy=message("export-too"),
                )


def _straightness_remark(curve: Curve, left_um: float, options: FanucOptions) -> Finding:
    if curve.name in options.straightness:
        return info("step-coarse.four-points", name=curve.name, um=left_um)
    why = (
        message("sets-hold-others")
        if options.straightness
        else message("straightness-by-option", name=curve.name)
    )
    return info("function-left-out.report", name=curve.name, left_um=left_um, why=why)


def _overlaps(tables: Sequence[Table]) -> Iterator[Finding]:
    ranges = [(table, set(stored_in(table))) for table in tables if table.kind == pitch.KIND]
    for index, (one, its_points) in enumerate(ranges):
        for other, other_points in ranges[index + 1 :]:
            if shared := sorted(its_points & other_points):
                yield error(
                    "points-overlap",
                    one=one.label,
                    other=other.label,
                    first=shared[0],
                    last=shared[-1],
                )
