"""A virtual FANUC control: stored pitch error compensation from punched parameter and pitch data.

B-64303CM-1/01 section 1.3.1 and B-63980EN/01 p. 100: point N covers the section N-1 to N; its value
is added when the axis passes the point in +. The compensation is output at the point, without
interpolation, and is added to the command.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from stepdiag.virtual.control.axis_table import AxisTable

_LINE = re.compile(r"^\s*N\s*(?P<number>\d+)\s*(?:Q\s*(?P<kind>\d+))?\s*(?P<words>.*?)\s*\Z")
_AXIS_WORD = re.compile(r"A\s*(\d+)\s*P\s*(-?[\d.]+)")
_PLAIN_WORD = re.compile(r"^P\s*(-?\d+)\.?\Z")
_FIRST_PITCH_LINE = 10000
_PARAMETER_KIND = "1"


@dataclass(slots=True)
class _Memory:
    parameters: dict[int, dict[int, str]] = field(default_factory=dict)
    pitch: dict[int, int] = field(default_factory=dict)
    plain: dict[int, int] = field(default_factory=dict)
    """Numbers of parameters that belong to no axis."""

    def read(self, text: str) -> None:
        """Read the lines from the first % to the next %: text after it is lost, as on the
        machine."""
        body = text.replace("\r", "\n").split("%")
        for line in (body[1] if len(body) > 1 else body[0]).split("\n"):
            if found := _LINE.match(line):
                self._store(int(found["number"]), found["kind"], found["words"])

    def _store(self, number: int, kind: str | None, words: str) -> None:
        by_axis = _AXIS_WORD.findall(words)
        plain = _PLAIN_WORD.match(words)
        if by_axis:
            self.parameters.setdefault(number, {}).update(
                {int(axis): value for axis, value in by_axis}
            )
        elif plain and number >= _FIRST_PITCH_LINE and kind != _PARAMETER_KIND:
            self.pitch[number - _FIRST_PITCH_LINE] = int(plain[1])
        elif plain:
            self.plain[number] = int(plain[1])

    def integer(self, number: int, axis: int) -> int:
        return round(float(self._word(number, axis)))

    def length_mm(self, number: int, axis: int, least_input_mm: float) -> float:
        """Return a length in mm: a number with a decimal point is in mm, a number without one in
        least input units (older controls)."""
        word = self._word(number, axis)
        return float(word) if "." in word else int(word) * least_input_mm

    def _word(self, number: int, axis: int) -> str:
        try:
            return self.parameters[number][axis]
        except KeyError:
            raise ValueError(
                f"parameter {number} of axis {axis}: expected a value, found none"
            ) from None


def load_fanuc(
    texts: Iterable[str],
    *,
    detection_unit_um: float = 1.0,
    least_input_mm: float = 0.001,
    interpolated: bool = False,
) -> list[AxisTable]:
    """Return the tables of axes 1 to 3 after loading ``texts`` (parameters and pitch data, one or
    several files).

    An axis whose parameter 3624 (interval) is 0 or missing has no compensation. ``interpolated``:
    the series of the control interpolates between points. Raises ValueError for a missing parameter
    or pitch point.
    """
    memory = _Memory()
    for text in texts:
        memory.read(text)
    tables: list[AxisTable] = []
    for axis in (1, 2, 3):
        if axis in memory.parameters.get(3624, {}) and memory.length_mm(
            3624, axis, least_input_mm
        ):
            tables += _axis_tables(
                memory,
                axis,
                detection_unit_um * 1e-3,
                least_input_mm,
                interpolated=interpolated,
            )
    tables += [
        table
        for number in range(3)
        for table in _straightness(memory, number, detection_unit_um * 1e-3, least_input_mm)
    ]
    return tables


def _straightness(
    memory: _Memory, number: int, unit_mm: float, least_input_mm: float
) -> list[AxisTable]:
    """Return a straightness compensation: the values that are added to another axis at four pitch
    points of the moving axis, with straight lines between the points.

    B-63522EN/02 15.5; a set of parameters without a moving axis is off. These parameter numbers are
    valid only for the virtual control.
    """
    moving, compensated = (memory.plain.get(first + number, 0) for first in (5711, 5721))
    if not moving:
        return []
    reference, interval_mm = (
        memory.integer(3620, moving),
        memory.length_mm(3624, moving, least_input_mm),
    )
    points = [memory.plain[5731 + 10 * number + point] for point in range(4)]
    values = [memory.plain[5761 + 10 * number + point] for point in range(4)]
    return [
        AxisTable(
            input_axis=moving - 1,
            output_axis=compensated - 1,
            position_mm=tuple((point - reference) * interval_mm for point in points),
            value_mm=tuple(value * unit_mm for value in values),
        )
    ]


def _axis_tables(
    memory: _Memory, axis: int, unit_mm: float, least_input_mm: float, *, interpolated: bool
) -> list[AxisTable]:
    reference, lowest, highest = (
        memory.integer(number, axis) for number in (3620, 3621, 3622)
    )
    interval_mm = memory.length_mm(3624, axis, least_input_mm)
    scale_mm = memory.integer(3623, axis) * unit_mm
    positions = tuple(
        (point - reference) * interval_mm for point in range(lowest - 1, highest + 1)
    )

    def table(first: int, travel: int, at_reference_mm: float) -> AxisTable:
        increments = [
            _increment(memory, first + offset) for offset in range(highest - lowest + 1)
        ]
        values = _absolute(increments, reference - lowest + 1)
        return AxisTable(
            input_axis=axis - 1,
            output_axis=axis - 1,
            position_mm=positions,
            value_mm=tuple(at_reference_mm + scale_mm * value for value in values),
            travel=travel,
            stepped=not interpolated,
        )

    if not _bidirectional(memory, axis):
        return [table(lowest, 0, 0.0)]
    opposite = memory.integer(3627, axis) * unit_mm
    return [table(lowest, 1, 0.0), table(memory.integer(3626, axis), -1, opposite)]


def _increment(memory: _Memory, point: int) -> int:
    if point not in memory.pitch:
        raise ValueError(f"pitch point {point}: expected a value, found none")
    return memory.pitch[point]


def _absolute(increments: list[int], reference: int) -> list[int]:
    """Return the sums of the increments: one value more than increments, zero at index
    ``reference``."""
    sums = [0]
    for increment in increments:
        sums.append(sums[-1] + increment)
    return [value - sums[reference] for value in sums]


def _bidirectional(memory: _Memory, axis: int) -> bool:
    return memory.parameters.get(3605, {}).get(axis, "0")[-1] == "1"
