"""SINUMERIK CEC: sag, angularity and cross-error compensation, with one numbered table for each
pair of input and output axis.

Function manual K3 pp. 243-264: a table has absolute values over the SETPOINT of the base axis,
linear between points, with the end values outside, optionally for one direction of travel of the
base axis. Several tables on one output axis add up. The manual does not state the sense. A
production program of a machine builder shows that a positive value moves the output axis in -
(controllers.md 3.2), so the sense is ``as-error`` and a sign test must confirm it.
"""

from collections.abc import Mapping

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import whole
from stepdiag.exporters.siemens.ini import Assignment, read_assignments
from stepdiag.exporters.siemens.points import grid_lines, point_lines, read_points
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Law, Sense, Table

KIND = "cec"
TIMES = "times table"
"""Key in ``Table.place`` of a multiplied table, with the index of the multiplying table as
value.
"""
_AXES = ("AN_CEC_INPUT_AXIS", "AN_CEC_OUTPUT_AXIS")
_GRID = ("AN_CEC_STEP", "AN_CEC_MIN", "AN_CEC_MAX")
_MODES = ("AN_CEC_DIRECTION", "AN_CEC_MULT_BY_TABLE", "AN_CEC_IS_MODULO")
_TOLERATED = ("AN_CEC_INPUT_NCU", "AN_CEC_OUTPUT_NCU", "AN_CEC_TYPE")


def law(sense: Sense) -> Law:
    return Law(sense=sense)


def assignments(table: Table, profile: Profile, decimals: int, points: int) -> list[str]:
    """Return the assignments of one table: the points, zeros up to ``points`` (MD18342), then axes,
    grid and modes.
    """
    index = table.place["table"]
    return [
        *point_lines(table, f"AN_CEC[{index},{{}}]", decimals, points),
        f"$AN_CEC_INPUT_AXIS[{index}]=({profile.axis(table.input_axis).name})",
        f"$AN_CEC_OUTPUT_AXIS[{index}]=({profile.axis(table.output_axis).name})",
        *grid_lines(table, "AN_CEC", str(index)),
        f"$AN_CEC_DIRECTION[{index}]={table.direction}",
        f"$AN_CEC_MULT_BY_TABLE[{index}]={int(table.place.get(TIMES, -1)) + 1}",
        f"$AN_CEC_IS_MODULO[{index}]=0",
    ]


def read_tables(file: ControlFile, profile: Profile, sense: Sense) -> tuple[Table, ...]:
    """Return the CEC tables of a file as the control numbers them. A product is returned as its two
    tables, the multiplied table and the multiplying table.

    Raises ``DataError`` with file and line, ``UsageError`` for an unknown axis.
    """
    values: dict[str, dict[int, Assignment]] = {}
    heads: dict[str, dict[str, Assignment]] = {}
    for item in read_assignments(file):
        if item.name == "AN_CEC" and len(item.index) == 2:
            values.setdefault(item.index[0], {})[whole(item.index[1], item.where)] = item
        elif item.name in _AXES + _GRID + _MODES + _TOLERATED and len(item.index) == 1:
            heads.setdefault(item.index[0], {})[item.name] = item
        elif item.name.startswith("AN_CEC"):
            raise DataError(
                item.where,
                expected=message("cec-variable"),
                found=f"${item.name}[{','.join(item.index)}]",
            )
    return tuple(
        _cec_table(key, values.get(key, {}), heads.get(key, {}), profile, sense, file.name)
        for key in sorted(values | heads)
    )


def _cec_table(
    key: str,
    points: dict[int, Assignment],
    head: Mapping[str, Assignment],
    profile: Profile,
    sense: Sense,
    source: str,
) -> Table:
    where = f"{source}: table [{key}]"
    missing = [name for name in _AXES + _GRID if name not in head]
    if missing:
        raise DataError(
            where, expected=" ".join(f"${name}" for name in missing), found=message("nothing")
        )
    if "AN_CEC_IS_MODULO" in head and head["AN_CEC_IS_MODULO"].number() != 0:
        raise DataError(
            head["AN_CEC_IS_MODULO"].where,
            expected=message("linear-axis"),
            found=head["AN_CEC_IS_MODULO"].value,
        )
    input_axis, output_axis = (
        profile.letter_of(head[name].axis(), head[name].where) for name in _AXES
    )
    step, start, end = (head[name].number() for name in _GRID)
    held = read_points(points, step, start, end, where)
    return Table(
        kind=KIND,
        input_axis=input_axis,
        output_axis=output_axis,
        position_mm=held.position_mm,
        value_um=held.value_um,
        quantum_um=held.quantum_um,
        law=law(sense),
        reference_mm=profile.axis(input_axis).reference_mm,
        direction=_direction(head.get("AN_CEC_DIRECTION")),
        place={"table": whole(key, where), **_times(head.get("AN_CEC_MULT_BY_TABLE"))},
    )


def _times(item: Assignment | None) -> dict[str, int]:
    number = 0 if item is None else whole(item.value, item.where)
    if item is not None and number < 0:
        raise DataError(item.where, expected=message("table-number"), found=item.value)
    return {TIMES: number - 1} if number else {}


def _direction(item: Assignment | None) -> int:
    direction = 0 if item is None else int(item.number())
    if item is not None and direction not in (-1, 0, 1):
        raise DataError(item.where, expected=message("direction-number"), found=item.value)
    return direction
