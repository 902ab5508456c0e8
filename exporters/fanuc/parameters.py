"""FANUC parameters: their text for the report and for the machine's own parameter file, and their
values read back from this file.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from stepdiag.exporters.fanuc import lines, pitch
from stepdiag.exporters.fanuc.options import FanucOptions
from stepdiag.exporters.fanuc.punch import PunchFile
from stepdiag.exporters.files.numbers import fixed, shortest
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table

Key = tuple[int, int | None]
"""A parameter number, and the axis (A1 ..) or None for a parameter without an axis."""
BIDIRECTIONAL = 3605
"""Parameter whose bit 0 (BDP, the last digit) switches bidirectional compensation on."""
DISABLED = 8135
"""Parameter whose bit 0 (NPE) disables stored pitch error compensation (0i-D)."""
MOST_AXES = 32
INTERVAL = 3624
SET_BY_HAND = (3620, 3621, 3622, 3623, INTERVAL)
"""Parameters of the pitch points. If the profile contains no parameter file of the machine, the
report asks a person to set these parameters by hand.
"""


def fitted(
    parameters: Mapping[Key, str], master: PunchFile, options: FanucOptions
) -> dict[Key, str]:
    """Return the parameters in the form of the machine's own file. The bit BDP replaces the last
    digit of its parameter in the file. An interval is in mm (new controls), or in least input units
    if the file has no decimal point (old controls).
    """
    result: dict[Key, str] = {}
    for (number, axis), text in parameters.items():
        present = master.parameter(number, axis)
        if present is None:
            continue
        if number == BIDIRECTIONAL:
            result[number, axis] = present[:-1] + text
        elif number == INTERVAL and "." not in present:
            result[number, axis] = str(round(float(text) * 1000.0 / options.least_input_um))
        else:
            result[number, axis] = text
    return result


def stored_in(table: Table) -> dict[int, int]:
    """Return the pitch data of a table: the increment by point number, in units of the detection
    unit times the magnification.
    """
    if table.kind != pitch.KIND:
        return {}
    counts = np.round(table.value_um[1:] / table.quantum_um).astype(int)
    first = int(table.place["first point"])
    return {first + index: int(count) for index, count in enumerate(counts)}


def parameters_of(
    tables: Sequence[Table], profile: Profile, options: FanucOptions
) -> dict[Key, str]:
    found: dict[Key, str] = {}
    for table in tables:
        found |= _parameters(table, profile, options)
    return found


def switches_in(punched: Sequence[PunchFile]) -> dict[str, str]:
    """Return the switches in punch files: 8135#0 (NPE of the 0i-D; 1 disables all pitch error
    compensation) and 3605#0 of each axis.
    """
    keys: list[Key] = [
        (DISABLED, None),
        *((BIDIRECTIONAL, axis) for axis in range(1, MOST_AXES + 1)),
    ]
    found = {
        key: text
        for key in keys
        for master in punched
        if (text := master.parameter(*key)) is not None
    }
    return {switch_name(*key): text[-1] for key, text in found.items()}


def switch_name(number: int, axis: int | None) -> str:
    return f"{number}#0" + ("" if axis is None else f" A{axis}")


def _parameters(table: Table, profile: Profile, options: FanucOptions) -> dict[Key, str]:
    axis = options.axis(table.input_axis, profile.source)
    if table.kind == pitch.KIND:
        return _pitch_parameters(table, profile, options)
    values = [str(round(value / options.detection_unit_um)) for value in table.value_um]
    points = str(table.place["points"]).split()
    if table.kind == lines.INCLINATION:
        keys = [*lines.INCLINATION_POINTS, *lines.INCLINATION_VALUES]
        return {
            (key, axis.number): text
            for key, text in zip(keys, [*points, *values], strict=True)
        }
    numbers = options.straightness.get(table.name)
    if numbers is None:
        return {}
    compensated = options.axis(table.output_axis, profile.source).number
    return {
        (numbers.moving, None): str(axis.number),
        (numbers.compensated, None): str(compensated),
        **{
            (key, None): text
            for key, text in zip(
                [*numbers.points, *numbers.values], [*points, *values], strict=True
            )
        },
    }


def _pitch_parameters(
    table: Table, profile: Profile, options: FanucOptions
) -> dict[Key, str]:
    axis = options.axis(table.input_axis, profile.source)
    points = lines.numbers(table.input_axis, profile, options)
    if table.direction < 0:
        return {
            (BIDIRECTIONAL, axis.number): "1",
            (3626, axis.number): str(axis.reverse_first_point),
            (3627, axis.number): str(round(table.offset_um / options.detection_unit_um)),
        }
    single = (
        options.experimental_bidirectional
        and profile.machine.direction == "both"
        and table.direction == 0
    )
    return {
        **({(BIDIRECTIONAL, axis.number): "0"} if single else {}),
        (3620, axis.number): str(points.reference),
        (3621, axis.number): str(points.lowest),
        (3622, axis.number): str(points.highest),
        (3623, axis.number): str(round(table.quantum_um / options.detection_unit_um)),
        (INTERVAL, axis.number): shortest(float(table.position_mm[1] - table.position_mm[0])),
    }


def parameter_rows(table: Table, profile: Profile, options: FanucOptions) -> tuple[str, ...]:
    needed = _parameters(table, profile, options)
    rows = [
        f"parameter {number}{'' if axis is None else f' A{axis}'} = {text}"
        for (number, axis), text in needed.items()
    ]
    if table.kind != pitch.KIND:
        values = np.round(table.value_um / options.detection_unit_um).astype(int)
        knots = zip(
            str(table.place["points"]).split(), table.position_mm, values, strict=True
        )
        return (
            *rows,
            *(
                f"point {point:>5} at {position:>12.4f} mm: {value:>6}"
                for point, position, value in knots
            ),
        )
    data = zip(
        stored_in(table).items(), table.position_mm[1:], table.absolute_um[1:], strict=True
    )
    head = f"{'point':>6} {'up to mm':>14} {'data':>6} {'absolute µm':>12}"
    return (
        *rows,
        head,
        *(
            f"{point:>6} {at:>14.4f} {count:>6} {fixed(absolute, 3):>12}"
            for (point, count), at, absolute in data
        ),
    )
