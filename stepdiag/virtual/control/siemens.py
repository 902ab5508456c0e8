"""A virtual SINUMERIK: EEC and CEC tables from an INI file or the part program that loads them.

Function manual K3 (6FC5397-1BP40-3BA1): EEC pp. 237-242, "a positive compensation value causes the
corresponding machine axis to move in the negative direction"; CEC pp. 243-264. A machine builder's
production program shows the same sign for CEC. Values are absolute, linearly interpolated, and
constant beyond the ends. The input of CEC is the setpoint of the base axis.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from stepdiag.virtual.control.axis_table import AxisTable

AXIS_NAMES = {
    name: axis
    for axis, names in enumerate((("AX1", "X", "X1"), ("AX2", "Y", "Y1"), ("AX3", "Z", "Z1")))
    for name in names
}
_ASSIGNMENT = re.compile(
    r"^\s*(?:N\d+\s*)?\$(?P<name>[A-Z]{2}_[A-Z_]+)\[(?P<index>[^\]]*)\]\s*=\s*\(?(?P<value>[^\s;)"
    r"]+)"
)
_OFF = ("0", "FALSE")


@dataclass(slots=True)
class _Memory:
    """The system variables that a file has set: their texts by name and index."""

    cells: dict[str, dict[tuple[str, ...], str]] = field(default_factory=dict)

    def store(self, line: str) -> None:
        if found := _ASSIGNMENT.match(line):
            index = tuple(word.strip() for word in found["index"].split(","))
            self.cells.setdefault(found["name"], {})[index] = found["value"]

    def get(self, name: str, index: tuple[str, ...], default: str | None = None) -> str:
        value = self.cells.get(name, {}).get(index, default)
        if value is None:
            raise ValueError(
                f"${name}[{','.join(index)}]: expected an assignment, found none"
            )
        return value

    def indices(self, name: str) -> list[tuple[str, ...]]:
        return list(self.cells.get(name, {}))


class SiemensControl:
    """A control that keeps loaded values: a later file changes only the values that it writes.

    Only EEC tables of ``measuring_system`` are active. A table counts as active unless a file
    switches it off. ``adds_linked``: see `_cross_tables`.
    """

    def __init__(
        self,
        *,
        measuring_system: int = 0,
        axis_names: Mapping[str, int] | None = None,
        adds_linked: bool = False,
    ) -> None:
        self._memory = _Memory()
        self._adds_linked = adds_linked
        self._system = str(measuring_system)
        self._names = AXIS_NAMES | dict(axis_names or {})

    def load(self, text: str) -> None:
        for line in text.splitlines():
            self._memory.store(line)

    def tables(self) -> list[AxisTable]:
        """Return the active tables.

        Raises ValueError for an unwritten point (a real control would contain an older value
        there), a grid that does not fit, or a rotary table.
        """
        return _leadscrew_tables(self._memory, self._system, self._names) + _cross_tables(
            self._memory, self._names, adds_linked=self._adds_linked
        )


def load_siemens(
    text: str, *, measuring_system: int = 0, axis_names: Mapping[str, int] | None = None
) -> list[AxisTable]:
    """Return the active tables after ``text`` has been loaded into an empty `SiemensControl`."""
    control = SiemensControl(measuring_system=measuring_system, axis_names=axis_names)
    control.load(text)
    return control.tables()


def _leadscrew_tables(
    memory: _Memory, system: str, names: Mapping[str, int]
) -> list[AxisTable]:
    tables = []
    for index in memory.indices("AA_ENC_COMP_STEP"):
        if index[0] != system or memory.get("MA_ENC_COMP_ENABLE", index, "1").upper() in _OFF:
            continue
        axis = _axis(index[1], names)
        positions = _grid(memory, "AA_ENC_COMP", index)
        values = tuple(
            -float(memory.get("AA_ENC_COMP", (system, str(n), index[1])))
            for n in range(len(positions))
        )
        tables.append(
            AxisTable(
                input_axis=axis, output_axis=axis, position_mm=positions, value_mm=values
            )
        )
    return tables


def _cross_tables(
    memory: _Memory, names: Mapping[str, int], *, adds_linked: bool = False
) -> list[AxisTable]:
    """Return the active CEC tables. Two tables that are linked by $AN_CEC_MULT_BY_TABLE give their
    product (K3 p. 249).

    In the example of p. 252 only the product moves the axis, so a linked table adds no movement of
    its own. ``adds_linked`` is the other interpretation of the manual: a control that also adds
    both tables.
    """
    active = [index for index in memory.indices("AN_CEC_STEP") if not _is_off(memory, index)]
    linked = {
        index: (str(int(memory.get("AN_CEC_MULT_BY_TABLE", index, "0")) - 1),)
        for index in active
    }
    linked = {index: by for index, by in linked.items() if by != ("-1",)}
    tables = []
    for index in active:
        if index in linked:
            factor = _cross_table(memory, linked[index], names, sense=1.0)
            tables.append(_cross_table(memory, index, names, sense=-1.0, factor=factor))
        if adds_linked or (index not in linked and index not in linked.values()):
            tables.append(_cross_table(memory, index, names, sense=-1.0))
    return tables


def _is_off(memory: _Memory, index: tuple[str, ...]) -> bool:
    output = memory.get("AN_CEC_OUTPUT_AXIS", index)
    switched_off = memory.get("SN_CEC_TABLE_ENABLE", index, "1").upper() in _OFF
    return switched_off or memory.get("MA_CEC_ENABLE", (output,), "1").upper() in _OFF


def _cross_table(
    memory: _Memory,
    index: tuple[str, ...],
    names: Mapping[str, int],
    *,
    sense: float,
    factor: AxisTable | None = None,
) -> AxisTable:
    positions = _grid(memory, "AN_CEC", index)
    weight = sense * float(memory.get("SN_CEC_TABLE_WEIGHT", index, "1"))
    return AxisTable(
        input_axis=_axis(memory.get("AN_CEC_INPUT_AXIS", index), names),
        output_axis=_axis(memory.get("AN_CEC_OUTPUT_AXIS", index), names),
        position_mm=positions,
        value_mm=tuple(
            weight * float(memory.get("AN_CEC", (*index, str(n))))
            for n in range(len(positions))
        ),
        travel=int(memory.get("AN_CEC_DIRECTION", index, "0")),
        factor=factor,
    )


def _grid(memory: _Memory, prefix: str, index: tuple[str, ...]) -> tuple[float, ...]:
    step, low, high = (
        float(memory.get(f"{prefix}_{part}", index)) for part in ("STEP", "MIN", "MAX")
    )
    if int(memory.get(f"{prefix}_IS_MODULO", index, "0")):
        raise ValueError(
            f"${prefix}_IS_MODULO[{','.join(index)}]: expected 0 on a linear axis, found 1"
        )
    count = round((high - low) / step) + 1
    if abs(low + (count - 1) * step - high) > 1e-6:
        raise ValueError(
            f"${prefix}_MAX[{','.join(index)}]: expected a whole number of steps of {step}, "
            f"found {low} to {high}"
        )
    return tuple(low + n * step for n in range(count))


def _axis(name: str, names: Mapping[str, int]) -> int:
    if name not in names:
        raise ValueError(f"axis: expected one of {', '.join(names)}, found {name!r}")
    return names[name]
