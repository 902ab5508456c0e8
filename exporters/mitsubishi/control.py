"""Mitsubishi Meldas/M series: memory-type relative position error compensation, as a list of
parameters to type in at the control.

C64 and E68 manuals (pp. 280, 379): each pair of base and compensated axis (#4001, #4002; numbers of
the next pair are higher by 10) has the division numbers of the reference, the lowest and the
highest point (#4003 to #4005), a scale (#4006), the interval (#4007), and data #4101 to #5124 of
-128 to 127. The data are increments of the correction in the + direction. Above the reference,
number n contains the increment of the section n-1 to n; below the reference, the increment of the
section n to n+1. The unit of the data is the output unit times the scale. No transfer format is
public.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np

from stepdiag.base.errors import DataError, SafetyError
from stepdiag.base.findings import Finding, info
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import (
    ascii_lines,
    finite,
    read_lines,
    require_end,
    whole,
)
from stepdiag.exporters.files.numbers import shortest
from stepdiag.exporters.tables.averaging import averaged_remarks, averaging
from stepdiag.exporters.tables.controller import Limits, Plan
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.own_files import own_and_zeros
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import quantised, sampled_um
from stepdiag.exporters.tables.tables import Law, Table, require_rising

KIND = "relative"
_MARK, _END = b"lowest point at", b"; end"
"""First comment of each pair of axes, and last line, in lists from stepdiag: a list of parameters
has no end mark of its own.
"""
_NAME = "mitsubishi_parameters.txt"
_FIRST_DATA, _LAST_DATA = 4101, 5124
_LEAST, _MOST = -128, 127
_MOST_SCALE = 99
_HEAD = ("pinc", "cmpax", "drcax", "rdvno", "mdvno", "pdvno", "sc", "spcdv")


class MitsubishiOptions(
    msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True
):
    output_unit_um: Annotated[float, msgspec.Meta(ge=0.001, le=1000)]
    data: Literal["incremental", "absolute"]
    first_data: Annotated[int, msgspec.Meta(ge=_FIRST_DATA, le=_LAST_DATA)] = _FIRST_DATA


_TEMPLATE = """\
[mitsubishi]
# unit of the compensation data in um: half the machine error compensation setting unit, such as
# 0.5
output_unit_um = "?"
# "incremental" (#4000 = 1) or "absolute" (#4000 = 0), as the control is set
data = "?"
# first_data = 4101           # first free data number
"""


@dataclass(frozen=True, slots=True)
class Mitsubishi:
    name: str = "mitsubishi"
    title: str = "Mitsubishi Meldas / M series (parameters #4000 to #5124 as a list)"
    kinds: tuple[str, ...] = (KIND,)
    options: type[msgspec.Struct] = MitsubishiOptions
    options_template: str = _TEMPLATE

    def quick_options(self) -> MitsubishiOptions:
        return MitsubishiOptions(output_unit_um=0.5, data="incremental")

    def limits(self, table: Table, profile: Profile) -> Limits:  # noqa: ARG002 - part of the protocol
        most = _MOST * table.quantum_um
        return (
            Limits(neighbour_um=most, slope_um_mm=None)
            if table.law.data == "incremental"
            else Limits(value_um=most)
        )

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        options = profile.options_as(MitsubishiOptions)
        tables: list[Table] = []
        number = options.first_data
        for pair, curve in enumerate(curves):
            tables.append(_planned(curve, profile, options, number, pair))
            number += len(tables[-1].position_mm)
        if number - 1 > _LAST_DATA:
            raise SafetyError(
                f"{profile.source}: axes",
                code="control-full.numbers",
                expected=message("data-up-to", number=_LAST_DATA),
                found=f"#{number - 1}",
                remedy=message("step-or-fewer"),
            )
        return Plan(tables=tuple(tables), findings=tuple(_remarks(curves, profile)))

    def render(
        self, tables: Sequence[Table], profile: Profile, notes: Sequence[str] = ()
    ) -> tuple[ControlFile, ...]:
        counting = int(profile.options_as(MitsubishiOptions).data == "incremental")
        lines = [*(f"; {note}" for note in notes), f"#4000 {counting}"]
        for table in tables:
            lines += _data_lines(table, profile)
        return (
            ControlFile(name=_NAME, data=ascii_lines([*lines, _END.decode("ascii")], "\r\n")),
        )

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        return tuple(table for file in files for table in _data_tables(file, profile))

    def standing(
        self, own: Sequence[ControlFile], new: Sequence[ControlFile], profile: Profile
    ) -> tuple[Table, ...]:
        """Return the tables of the control after typing in: every parameter has its last typed
        value.
        """
        values = {
            number: value for file in (*own, *new) for number, value in _values(file).items()
        }
        return (
            tuple(_pairs(", ".join(file.name for file in (*own, *new)), values, profile))
            if values
            else ()
        )

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        """Return the machine's own list, and zeros for every pair of axes that this list does not
        contain.

        Raises ``SafetyError`` (``points-overlap.restore``) if such a pair would use data numbers of
        the own list.
        """
        if profile.existing:
            _refuse_overlap(tables, self.parse(profile.existing, profile), profile)
        return own_and_zeros(self, tables, profile, lambda table: table.place["pair"])

    def recognises(self, file: ControlFile) -> bool:
        return b"#4000 " in file.data and b"#4001 " in file.data

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:
        return tuple(_data_lines(table, profile))

    def instructions(self, profile: Profile) -> tuple[str, ...]:
        unit = profile.options_as(MitsubishiOptions).output_unit_um
        return (
            "Back up all parameters.",
            (
                f"See that the output unit is {unit:g} µm: the factor 2 of the manual's formulas "
                "is "
                "taken to mean half a setting unit."
            ),
            "Key in the list. #4007 is given in mm: enter it in the control's setting unit.",
            "Switch off and on, return to the reference point.",
            "Sign test first. Measure again; if the residual has grown, key in the restore list.",
        )


def _planned(
    curve: Curve, profile: Profile, options: MitsubishiOptions, first: int, pair: int
) -> Table:
    grid, error, _ = sampled_um(curve, averaging(profile))
    reference_mm = profile.axis(curve.input_axis).reference_mm
    origin = int(np.argmin(np.abs(grid - reference_mm)))
    if abs(grid[origin] - reference_mm) > 1e-6:
        raise SafetyError(
            f"{profile.source}: axes.{curve.input_axis}.reference_mm",
            code="reference-unfit.between",
            expected=message("reference-on"),
            found=f"{reference_mm:g} mm",
            remedy=message("nearest-is", place_mm=grid[origin]),
        )
    scale = _scale(-error, options, curve.name)
    unit_um = options.output_unit_um * scale
    absolute = quantised(-error, unit_um)
    return Table(
        kind=KIND,
        input_axis=curve.input_axis,
        output_axis=curve.output_axis,
        position_mm=grid,
        value_um=np.diff(absolute, prepend=absolute[0])
        if options.data == "incremental"
        else absolute,
        quantum_um=unit_um,
        law=_law(options),
        reference_mm=reference_mm,
        place={"pair": pair + 1, "first data": first, "scale": scale},
    )


def _data_numbers(table: Table) -> range:
    first = int(table.place["first data"])
    return range(first, first + len(table.position_mm))


def _refuse_overlap(new: Sequence[Table], own: Sequence[Table], profile: Profile) -> None:
    """Raise SafetyError if a new pair of axes uses data numbers of a different, old pair. After the
    old data are typed in again, both pairs would use these numbers.
    """
    pairs = {table.place["pair"] for table in own}
    for table in new:
        if table.place["pair"] in pairs:
            continue
        for other in own:
            if set(_data_numbers(table)) & set(_data_numbers(other)):
                raise SafetyError(
                    f"{profile.source}: mitsubishi.first_data",
                    code="points-overlap.restore",
                    expected=message("free-numbers"),
                    found=message("one-in-place-of", one=table.label, other=other.label),
                    remedy=f"first_data = {1 + max(_data_numbers(each)[-1] for each in own)}",
                )


def _law(options: MitsubishiOptions) -> Law:
    return Law(sense="as-compensation", data=options.data)


def _scale(absolute_um: Vector, options: MitsubishiOptions, name: str) -> int:
    """Return the smallest scale (#4006) with which all data are within the limits. The absolute
    curve is rounded to whole units before its increments are formed.
    """
    for scale in range(1, _MOST_SCALE + 1):
        units = np.round(absolute_um / (options.output_unit_um * scale))
        data = np.diff(units) if options.data == "incremental" else units
        if data.min() >= _LEAST and data.max() <= _MOST:
            return scale
    raise SafetyError(
        name,
        code="field-too-narrow.value",
        expected=message("data-scale", least=_LEAST, most=_MOST, scale=_MOST_SCALE),
        found=message("curve-that-reaches", um=np.max(np.abs(absolute_um))),
        remedy=message("smaller-step"),
    )


def _remarks(curves: Sequence[Curve], profile: Profile) -> Iterator[Finding]:
    yield from averaged_remarks(curves, profile)
    yield info("sign-untested.component-data")


def _data_lines(table: Table, profile: Profile) -> list[str]:
    base = 4000 + 10 * (int(table.place["pair"]) - 1)
    first, count = int(table.place["first data"]), len(table.position_mm)
    origin = int(np.argmin(np.abs(table.position_mm - table.reference_mm)))
    data = _shifted(
        [round(float(value) / table.quantum_um) for value in table.value_um], origin, table
    )
    head = (
        ("cmpax", profile.axis(table.input_axis).name),
        ("drcax", profile.axis(table.output_axis).name),
        ("rdvno", str(first + origin)),
        ("mdvno", str(first)),
        ("pdvno", str(first + count - 1)),
        ("sc", str(table.place["scale"])),
        ("spcdv", shortest(float(table.position_mm[1] - table.position_mm[0]))),
    )
    return [
        f"; {table.label}, {_MARK.decode('ascii')} {shortest(float(table.position_mm[0]))} mm",
        *(f"#{base + 1 + index} {value}" for index, (_, value) in enumerate(head)),
        *(f"#{first + index} {value}" for index, value in enumerate(data)),
    ]


def _shifted(units: Sequence[int], origin: int, table: Table) -> list[int]:
    """Return the data in the order of the control's numbers: below the reference, a number contains
    the increment of the section above it.
    """
    if table.law.data == "absolute":
        return list(units)
    return [*units[1 : origin + 1], 0, *units[origin + 1 :]]


def _data_tables(file: ControlFile, profile: Profile) -> Iterator[Table]:
    return _pairs(file.name, _values(file), profile)


class _Value(NamedTuple):
    text: str
    where: str

    def whole(self) -> int:
        return whole(self.text, self.where)


def _values(file: ControlFile) -> dict[int, _Value]:
    require_end(file, _MARK, _END)
    values: dict[int, _Value] = {}
    for where, line in read_lines(file):
        words = line.partition(";")[0].split()
        if not words:
            continue
        if len(words) != 2 or not words[0].startswith("#"):
            raise DataError(where, expected=message("number-value"), found=repr(line))
        values[whole(words[0][1:], where)] = _Value(words[1], where)
    if 4000 not in values or 4001 not in values or not file.data.endswith(b"\n"):
        raise DataError(
            file.name, expected=message("head-of-data-list"), found=message("nothing-like")
        )
    return values


def _pairs(source: str, values: dict[int, _Value], profile: Profile) -> Iterator[Table]:
    for pair, base in enumerate(range(4000, _FIRST_DATA - 1, 10)):
        if base + 1 in values:
            yield _read_pair(source, values, base, pair + 1, profile)


def _read_pair(
    source: str, values: dict[int, _Value], base: int, pair: int, profile: Profile
) -> Table:
    options = profile.options_as(MitsubishiOptions)
    missing = [
        f"#{base + index} {word}"
        for index, word in enumerate(_HEAD)
        if index and base + index not in values
    ]
    if missing:
        raise DataError(
            source,
            expected=", ".join(missing),
            found=message("nothing"),
            remedy=message("list-cut"),
        )
    data_form = values[4000]
    if data_form.whole() != int(options.data == "incremental"):
        raise DataError(
            data_form.where,
            expected=message("4000-for", count=options.data),
            found=data_form.text,
        )
    base_axis, moved_axis = (profile.letter_of(*values[base + index]) for index in (1, 2))
    origin, first, last, scale = (values[base + index].whole() for index in (3, 4, 5, 6))
    interval = values[base + 7]
    step = finite(*interval)
    if not (
        _FIRST_DATA <= first <= origin <= last <= _LAST_DATA
        and first < last
        and step > 0
        and 0 < scale <= _MOST_SCALE
    ):
        expected = message(
            "mitsubishi-order", first=_FIRST_DATA, last=_LAST_DATA, scale=_MOST_SCALE
        )
        raise DataError(
            values[base + 3].where,
            expected=expected,
            found=message(
                "scale-interval",
                first=first,
                origin=origin,
                last=last,
                scale=scale,
                step=step,
            ),
        )
    absent = [number for number in range(first, last + 1) if number not in values]
    if absent:
        raise DataError(
            source,
            expected=message("from-to", first=first, last=last),
            found=message("no-hash", number=absent[0]),
            remedy=message("list-cut"),
        )
    reference_mm = profile.axis(base_axis).reference_mm
    position = reference_mm + step * np.arange(
        first - origin, last + 1 - origin, dtype=np.float64
    )
    require_rising(position, interval.where)
    unit_um = options.output_unit_um * scale
    data = [values[number].whole() for number in range(first, last + 1)]
    return Table(
        kind=KIND,
        input_axis=base_axis,
        output_axis=moved_axis,
        position_mm=position,
        value_um=np.array(_unshifted(data, origin - first, options.data)) * unit_um,
        quantum_um=unit_um,
        law=_law(options),
        reference_mm=reference_mm,
        place={"pair": pair, "first data": first, "scale": scale},
    )


def _unshifted(data: Sequence[int], origin: int, counting: str) -> list[int]:
    return list(data) if counting == "absolute" else [0, *data[:origin], *data[origin + 1 :]]
