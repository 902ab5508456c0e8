"""FANUC tables and their parameters, read from punch files as the control reads them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.exporters.fanuc import lines, pitch
from stepdiag.exporters.fanuc.options import (
    LAST_POINT,
    AxisPoints,
    FanucOptions,
    StraightnessNumbers,
)
from stepdiag.exporters.fanuc.parameters import BIDIRECTIONAL
from stepdiag.exporters.fanuc.punch import PunchFile
from stepdiag.exporters.fanuc.straightness import found_in
from stepdiag.exporters.files.listing import finite, whole
from stepdiag.exporters.tables.curves import STRAIGHTNESS
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, require_rising


def read_tables(
    files: Sequence[PunchFile], profile: Profile, options: FanucOptions
) -> tuple[Table, ...]:
    """Return pitch, inclination and straightness tables of the profile's axes.

    Raises ``DataError`` for a range with missing points, and for a parameter that is not a number.
    """
    reader = _Reader(files, profile, options)
    tables: list[Table] = []
    for letter in options.axes:
        tables += reader.pitch(letter)
        tables += reader.inclination(letter)
    for name, numbers in {**found_in(files, options), **options.straightness}.items():
        if name not in STRAIGHTNESS:
            raise UsageError(
                f"{profile.source}: fanuc.straightness.{name}",
                expected=message("one-of", names=STRAIGHTNESS),
                found=name,
            )
        tables += reader.straightness(name, numbers)
    return tuple(tables)


class _Reader:
    def __init__(
        self, files: Sequence[PunchFile], profile: Profile, options: FanucOptions
    ) -> None:
        self._files = files
        self._profile = profile
        self._options = options
        self._data = {point: value for file in files for point, value in file.pitch.items()}

    def pitch(self, letter: str) -> list[Table]:
        """Return the pitch table of an axis, two tables for two directions, or none if the files
        contain no point of the axis.
        """
        axis = self._options.axis(letter, self._profile.source)
        lowest, highest = self._range(letter, axis)
        if self._interval_mm(letter, axis) <= 0 or not any(
            point in self._data for point in range(lowest, highest + 1)
        ):
            return []
        interval = self._interval_mm(letter, axis)
        reference = self._number(3620, axis.number, axis.reference_point)
        position: Vector = (
            self._profile.axis(letter).reference_mm
            + (np.arange(lowest - 1, highest + 1, dtype=np.float64) - reference) * interval
        )
        both = self._bidirectional(axis, highest - lowest + 1)
        require_rising(position, f"{self._names}: parameter 3624 A{axis.number}")
        forward = self._pitch_table(letter, position, lowest, 1 if both else 0, 0.0)
        if not both:
            return [forward]
        first = self._number(3626, axis.number, axis.reverse_first_point)
        offset = self._number(3627, axis.number, None) * self._options.detection_unit_um
        return [forward, self._pitch_table(letter, position, first, -1, offset)]

    def _bidirectional(self, axis: AxisPoints, count: int) -> bool:
        """Return whether parameter 3605#0 gives an axis a second table for travel in -.

        Without parameter 3605#0 in the files, two conditions must be true: the profile requests
        both directions, and the files contain data of a second table.
        """
        bits = self._find(BIDIRECTIONAL, axis.number)
        if bits is not None:
            return bits.endswith("1")
        asked = (
            self._options.experimental_bidirectional
            and self._profile.machine.direction == "both"
        )
        first = axis.reverse_first_point
        return asked and any(self._data.get(point) for point in range(first, first + count))

    def inclination(self, letter: str) -> list[Table]:
        number = self._options.axis(letter, self._profile.source).number
        keys = (*lines.INCLINATION_POINTS, *lines.INCLINATION_VALUES)
        if not self._options.axes[letter].inclination or self._find(keys[0], number) is None:
            return []
        return [self._line_table(lines.INCLINATION, letter, letter, keys, number)]

    def straightness(self, name: str, numbers: StraightnessNumbers) -> list[Table]:
        """Return the four-point table of the straightness ``name``, if the files contain one. A
        control with the option but without a table punches the four points as zeros.
        """
        keys = (*numbers.points, *numbers.values)
        if not any(self._find(key, None) not in (None, "0") for key in numbers.points):
            return []
        table = self._line_table(lines.STRAIGHTNESS, name[2], name[1], keys, None)
        return [replace(table, place={**table.place, "set": numbers.moving})]

    def _range(self, letter: str, axis: AxisPoints) -> tuple[int, int]:
        if self._find(3621, axis.number) is None or self._find(3622, axis.number) is None:
            points = lines.numbers(letter, self._profile, self._options)
            return points.lowest, points.highest
        lowest, highest = (
            self._number(3621, axis.number, None),
            self._number(3622, axis.number, None),
        )
        if not 0 <= lowest <= highest <= LAST_POINT:
            raise DataError(
                self._names,
                expected=message("points-ascending", letter=letter, last=LAST_POINT),
                found=message("lowest-and-highest", lowest=lowest, highest=highest),
            )
        return lowest, highest

    def _interval_mm(self, letter: str, axis: AxisPoints) -> float:
        text = self._find(3624, axis.number)
        if text is None:
            return self._profile.axis(letter).step_mm
        # Old controls write lengths as integers in least input units. New controls write
        # lengths in mm with a decimal point (controllers.md 2.6).
        value = finite(text, f"{self._names}: parameter 3624 A{axis.number}")
        if value < 0:
            raise DataError(
                f"parameter 3624 A{axis.number}",
                expected=message("interval-not-negative"),
                found=text,
            )
        return value if "." in text else value * self._options.least_input_um / 1000.0

    def _pitch_table(
        self, letter: str, position: Vector, first: int, direction: int, offset_um: float
    ) -> Table:
        axis = self._options.axis(letter, self._profile.source)
        wanted = range(first, first + len(position) - 1)
        missing = [point for point in wanted if point not in self._data]
        if missing:
            raise DataError(
                self._names,
                expected=message(
                    "points-of", first=wanted[0], last=wanted[-1], letter=letter
                ),
                found=message("no-point", number=missing[0]),
            )
        # The magnification has no effect on an empty table, so a machine without compensation
        # need not state it.
        default = (
            axis.magnification
            if any(self._data[point] for point in wanted)
            else axis.magnification or 1
        )
        quantum = (
            self._number(3623, axis.number, default, f"fanuc.axes.{letter}.magnification")
            * self._options.detection_unit_um
        )
        return Table(
            kind=pitch.KIND,
            input_axis=letter,
            output_axis=letter,
            position_mm=position,
            value_um=np.array([0.0, *(self._data[point] * quantum for point in wanted)]),
            quantum_um=quantum,
            law=pitch.LAW,
            reference_mm=self._profile.axis(letter).reference_mm,
            direction=direction,
            offset_um=offset_um,
            place={"axis": axis.number, "first point": first},
        )

    def _line_table(
        self, kind: str, moving: str, compensated: str, keys: Sequence[int], axis: int | None
    ) -> Table:
        points = [self._number(key, axis, None) for key in keys[:4]]
        section = self._options.axis(moving, self._profile.source)
        reference = self._number(3620, section.number, section.reference_point)
        unit = self._options.detection_unit_um
        offsets = (np.array(points) - reference) * self._interval_mm(moving, section)
        position = self._profile.axis(moving).reference_mm + offsets
        require_rising(position, f"{self._names}: points of {kind} along {moving}")
        return Table(
            kind=kind,
            input_axis=moving,
            output_axis=compensated,
            position_mm=position,
            value_um=np.array([self._number(key, axis, None) * unit for key in keys[4:]]),
            quantum_um=unit,
            law=lines.LAW,
            reference_mm=self._profile.axis(moving).reference_mm,
            place={"points": " ".join(map(str, points))},
        )

    @property
    def _names(self) -> str:
        return ", ".join(file.name for file in self._files)

    def _find(self, number: int, axis: int | None) -> str | None:
        for file in self._files:
            if (text := file.parameter(number, axis)) is not None:
                return text
        return None

    def _number(
        self, number: int, axis: int | None, default: int | None, field: str = ""
    ) -> int:
        text = self._find(number, axis)
        where = f"{self._names}: parameter {number}{'' if axis is None else f' A{axis}'}"
        if text is None and default is not None:
            return default
        if text is None:
            remedy = (
                message("punched-or-field", field=field)
                if field
                else message("punched-parameters")
            )
            raise DataError(
                where, expected=message("a-value"), found=message("nothing"), remedy=remedy
            )
        return whole(text.removesuffix(".0").removesuffix("."), where)
