"""SINUMERIK EEC: leadscrew and measuring-system error compensation, one table for each axis and
measuring system.

Function manual K3 (6FC5397-1BP40-3BA1) pp. 237-242: a table has absolute values, linear between
points, with the end values outside. "A positive compensation value causes the corresponding machine
axis to move in the negative direction", so a value is the error itself.
"""

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import whole
from stepdiag.exporters.siemens.ini import Assignment, read_assignments
from stepdiag.exporters.siemens.points import grid_lines, point_lines, read_points
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Law, Table

KIND = "eec"
LAW = Law(sense="as-error")
_VALUE = "AA_ENC_COMP"
_HEAD = ("AA_ENC_COMP_STEP", "AA_ENC_COMP_MIN", "AA_ENC_COMP_MAX", "AA_ENC_COMP_IS_MODULO")


def assignments(table: Table, decimals: int, points: int) -> list[str]:
    """Return the assignments of one table: the points, zeros up to ``points`` (MD38000), then the
    grid (K3 p. 242).
    """
    system, axis = table.place["measuring system"], table.place["axis"]
    index = int(system) - 1
    return [
        *point_lines(table, f"{_VALUE}[{index},{{}},{axis}]", decimals, points),
        *grid_lines(table, _VALUE, f"{index},{axis}"),
        f"$AA_ENC_COMP_IS_MODULO[{index},{axis}]=0",
    ]


def read_tables(file: ControlFile, profile: Profile) -> tuple[Table, ...]:
    """Return the EEC tables of a file. Raises ``DataError`` with file and line, ``UsageError`` for
    an unknown axis.
    """
    values: dict[tuple[str, str], dict[int, Assignment]] = {}
    heads: dict[tuple[str, str], dict[str, Assignment]] = {}
    for item in read_assignments(file):
        if item.name == _VALUE and len(item.index) == 3:
            system, point, axis = item.index
            values.setdefault((system, axis), {})[whole(point, item.where)] = item
        elif item.name in _HEAD and len(item.index) == 2:
            heads.setdefault((item.index[0], item.index[1]), {})[item.name] = item
        elif item.name.startswith(_VALUE):
            raise DataError(
                item.where,
                expected=message("eec-variable"),
                found=f"${item.name}[{','.join(item.index)}]",
            )
    return tuple(
        _eec_table(key, values.get(key, {}), heads.get(key, {}), profile, file.name)
        for key in sorted(values | heads)
    )


def _eec_table(
    key: tuple[str, str],
    points: dict[int, Assignment],
    head: dict[str, Assignment],
    profile: Profile,
    source: str,
) -> Table:
    system, axis = key
    where = f"{source}: table [{system},{axis}]"
    missing = [name for name in _HEAD if name not in head]
    if missing:
        raise DataError(
            where, expected=" ".join(f"${name}" for name in missing), found=message("nothing")
        )
    step, start, end, modulo = (head[name].number() for name in _HEAD)
    if modulo:
        raise DataError(
            head[_HEAD[3]].where,
            expected=message("linear-modulo"),
            found=message("rotary-axis"),
        )
    letter = profile.letter_of(axis, head[_HEAD[0]].where)
    held = read_points(points, step, start, end, where)
    return Table(
        kind=KIND,
        input_axis=letter,
        output_axis=letter,
        position_mm=held.position_mm,
        value_um=held.value_um,
        quantum_um=held.quantum_um,
        law=LAW,
        reference_mm=profile.axis(letter).reference_mm,
        place={"measuring system": whole(system, where) + 1, "axis": axis},
    )
