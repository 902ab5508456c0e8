"""Axis lists ``achskw<n>.lis``: leadscrew error (``kw.ssfk``) and cross compensation
(``kw.crosscomp``) of one axis, in 0.1 um."""

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines, read_lines, whole
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Law, Sense, Table

_UNITS_PER_MM = 10000.0
QUANTUM_UM = 0.1
"""Smallest step of a value in a list, in um."""
_LINE = re.compile(
    r"^(?P<key>[a-z_]+(?:\.[a-z_0-9]+)*(?:\.table\[(?P<index>\d+)\]\.(?P<column>[a-z]+))?)"
    r"\s+(?P<value>\S+)\Z"
)
SWITCH = "lr_param.ssfk"
_MASTER_WORDS = ("slave_ax_nr", "master_ax_nr")
Values = Mapping[str, tuple[str, str]]


def render(
    tables: Sequence[Table],
    profile: Profile,
    numbers: Mapping[str, int],
    master_word: str,
    notes: Sequence[str],
) -> ControlFile:
    letter = tables[0].output_axis
    number = numbers[letter]
    lines = [
        *(f"# {note}" for note in notes),
        f"kopf.achs_nr {number}",
        f"kopf.log_achs_name {profile.axis(letter).name}",
    ]
    screws = [table for table in tables if table.input_axis == letter]
    if screws:
        lines += _ssfk_lines(screws)
    for table in tables:
        if table.input_axis != letter:
            lines += _cross_lines(table, numbers[table.input_axis], master_word)
    return ControlFile(name=f"achskw{number}.lis", data=ascii_lines(lines, "\r\n"))


def read(
    file: ControlFile,
    profile: Profile,
    numbers: Mapping[str, int],
    senses: Mapping[str, Sense | None],
) -> list[Table]:
    """Return the ssfk and crosscomp tables of a list. Raises ``DataError`` with file and line."""
    values = _values(file)
    letters = {str(number): letter for letter, number in numbers.items()}
    where, axis = values.get("kopf.achs_nr", (file.name, "nothing"))
    if axis not in letters:
        raise DataError(where, expected=message("logical-axis-number"), found=axis)
    tables: list[Table] = []
    if any(key.startswith("kw.ssfk.") for key in values):
        tables += _ssfk(file, values, letters[axis], profile, senses)
    if any(key.startswith("kw.crosscomp.") for key in values):
        tables.append(_cross(file, values, letters, letters[axis], profile, senses))
    return tables


def switches_in(file: ControlFile) -> dict[str, str]:
    """Return the switch ``lr_param.ssfk`` (P-AXIS-00175) in an axis list, under a name that
    contains the axis; {} if the list has no switch.
    """
    values = _values(file)
    axis, switch = values.get("kopf.achs_nr"), values.get(SWITCH)
    return {} if axis is None or switch is None else {switch_name(axis[1]): switch[1]}


def switch_name(number: int | str) -> str:
    return f"{SWITCH} of axis {number}"


def _ssfk_lines(tables: Sequence[Table]) -> Iterator[str]:
    position = _units(tables[0].position_mm, _UNITS_PER_MM)
    yield from (
        "kw.ssfk.interval 0",
        f"kw.ssfk.kw_startpos {position[0]}",
        f"kw.ssfk.kw_nr_max {len(position)}",
        "kw.ssfk.unit 1",
    )
    yield from (f"kw.ssfk.bilateral {int(len(tables) > 1)}", "kw.ssfk.modulo 0")
    yield from (f"kw.ssfk.table[{index}].setpoint {at}" for index, at in enumerate(position))
    for table in tables:
        column = "neg" if table.direction < 0 else "pos"
        yield from (
            f"kw.ssfk.table[{index}].{column} {value}"
            for index, value in enumerate(_units(table.value_um, 1 / QUANTUM_UM))
        )


def _cross_lines(table: Table, master: int, master_word: str) -> Iterator[str]:
    position = _units(table.position_mm, _UNITS_PER_MM)
    yield from (
        f"kw.crosscomp.last_index {len(position) - 1}",
        f"kw.crosscomp.{master_word} {master}",
        "kw.crosscomp.unit 1",
    )
    for index, (at, value) in enumerate(
        zip(position, _units(table.value_um, 1 / QUANTUM_UM), strict=True)
    ):
        yield from (
            f"kw.crosscomp.table[{index}].setpoint {at}",
            f"kw.crosscomp.table[{index}].correction {value}",
        )


def _units(values: Vector, per_unit: float) -> list[int]:
    return [round(float(value) * per_unit) for value in values]


def _values(file: ControlFile) -> dict[str, tuple[str, str]]:
    values: dict[str, tuple[str, str]] = {}
    for where, raw in read_lines(file):
        line = _without_remarks(raw.partition("#")[0]).strip()
        if not line:
            continue
        match = _LINE.match(line)
        if match is None or match["key"] in values:
            raise DataError(where, expected=message("new-key"), found=repr(line))
        values[match["key"]] = (where, match["value"])
    return values


def _without_remarks(line: str) -> str:
    """Return a line without remarks, which extend from ``/*`` to the next ``*/``. A remark without
    an end stays in the line.
    """
    kept, at = [], 0
    while (begin := line.find("/*", at)) >= 0 and (end := line.find("*/", begin + 2)) >= 0:
        kept.append(line[at:begin])
        at = end + 2
    return "".join([*kept, line[at:]])


def _ssfk(
    file: ControlFile,
    values: Values,
    letter: str,
    profile: Profile,
    senses: Mapping[str, Sense | None],
) -> Iterator[Table]:
    count = _count(file, values, "kw.ssfk.kw_nr_max")
    _metric(file, values, "kw.ssfk")
    if _whole(file, values, "kw.ssfk.modulo", 0) != 0:
        raise DataError(
            values["kw.ssfk.modulo"][0],
            expected=message("linear-axis"),
            found=message("modulo-axis"),
        )
    interval = _whole(file, values, "kw.ssfk.interval")
    if interval:
        position = (
            _whole(file, values, "kw.ssfk.kw_startpos") + interval * np.arange(count)
        ) / _UNITS_PER_MM
    else:
        position = _column(file, values, "kw.ssfk", "setpoint", count) / _UNITS_PER_MM
    bilateral = _whole(file, values, "kw.ssfk.bilateral", 0)
    for direction, column in ((1, "pos"), (-1, "neg")) if bilateral else ((0, "pos"),):
        value_um = _column(file, values, "kw.ssfk", column, count) * QUANTUM_UM
        yield _axis_table(
            file, "ssfk", (letter, letter), (position, value_um), profile, senses, direction
        )


def _cross(
    file: ControlFile,
    values: Values,
    letters: Mapping[str, str],
    letter: str,
    profile: Profile,
    senses: Mapping[str, Sense | None],
) -> Table:
    _metric(file, values, "kw.crosscomp")
    where, master = next(
        (
            values[f"kw.crosscomp.{word}"]
            for word in _MASTER_WORDS
            if f"kw.crosscomp.{word}" in values
        ),
        (file.name, "nothing"),
    )
    if master not in letters or letters[master] == letter:
        raise DataError(where, expected=message("other-logical"), found=master)
    count = _count(file, values, "kw.crosscomp.last_index") + 1
    position = _column(file, values, "kw.crosscomp", "setpoint", count) / _UNITS_PER_MM
    value_um = _column(file, values, "kw.crosscomp", "correction", count) * QUANTUM_UM
    return _axis_table(
        file, "crosscomp", (letters[master], letter), (position, value_um), profile, senses, 0
    )


def _axis_table(
    file: ControlFile,
    kind: str,
    axes: tuple[str, str],
    columns: tuple[Vector, Vector],
    profile: Profile,
    senses: Mapping[str, Sense | None],
    direction: int,
) -> Table:
    sense = senses[kind]
    if sense is None:
        raise UsageError(
            f"{profile.source}: beckhoff.cross_sense",
            expected=message("cross-sense"),
            found=message("nothing"),
        )
    position, value_um = columns
    if len(position) < 2 or np.any(np.diff(position) <= 0):
        raise DataError(
            f"{file.name}: kw.{kind}",
            expected=message("two-setpoints"),
            found=message("count-points", count=len(position)),
        )
    return Table(
        kind=kind,
        input_axis=axes[0],
        output_axis=axes[1],
        position_mm=position,
        value_um=value_um,
        quantum_um=QUANTUM_UM,
        law=Law(sense=sense),
        reference_mm=profile.axis(axes[0]).reference_mm,
        direction=direction,
        place={"list": file.name},
    )


def _metric(file: ControlFile, values: Values, group: str) -> None:
    if _whole(file, values, f"{group}.unit") != 1:
        raise DataError(
            values[f"{group}.unit"][0],
            expected=message("unit-of-tenths"),
            found=message("encoder-increments"),
        )


def _whole(file: ControlFile, values: Values, key: str, default: int | None = None) -> int:
    if key not in values:
        if default is not None:
            return default
        raise DataError(
            file.name, expected=key, found=message("nothing"), remedy=message("list-foreign")
        )
    return whole(values[key][1], values[key][0])


def _count(file: ControlFile, values: Values, key: str) -> int:
    count = _whole(file, values, key)
    if not 0 <= count <= len(values):
        raise DataError(
            values[key][0],
            expected=message("as-many"),
            found=str(count),
            remedy=message("list-cut"),
        )
    return count


def _column(file: ControlFile, values: Values, group: str, column: str, count: int) -> Vector:
    return np.array(
        [_whole(file, values, f"{group}.table[{index}].{column}") for index in range(count)],
        dtype=np.float64,
    )
