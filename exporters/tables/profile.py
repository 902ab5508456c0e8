"""The profile of a machine: every fact that an export must not guess.

A profile is a TOML file. A field without a default is a question: the template contains ``"?"`` in
its place. A profile with an unanswered question is refused (`exporters.profiles.file` reads
profiles).
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Literal, TypeVar

import msgspec
import numpy as np

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.settings import nearest
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables.curves import FOLD_DEFAULT, FUNCTIONS

Positive = Annotated[float, msgspec.Meta(gt=0)]
Options = TypeVar("Options", bound=msgspec.Struct)
MOST_EXISTING = 64
"""Largest number of own files of a machine in a profile."""
NEARLY_MM = 0.01
"""Largest difference in mm between a travel and a whole number of steps, for steps of 1 mm or
more.
"""
MOST_SECTIONS = 20_000
"""Largest number of steps along one axis (20 m in steps of 1 mm), more than any control has."""
WARN_UM_M = 400.0
"""Largest plausible error in um per metre of travel, on a poor machine (k = 3). It consists of a
squareness of 100 urad or a scale of 50 um/m, a growth of 60 um/m, and a hall that differs by 5 C
from 20 C (`CLASSES`). A correction above this limit must be accepted by a person; a correction
above twice the limit is refused.
"""
CHANGE_UM_M = 80.0
"""Largest change of a table between two surveys without acceptance by a person, in um/m: growth of
a poor machine (60 um/m, k = 1) and drift.
"""
SHORTEST_TRAVEL_MM = 500.0
"""Travel in mm below which the limits stay constant (200, 400 and 40 um), because reversal,
straightness and screw waves do not decrease with the travel.
"""
AxisName = Annotated[
    str, msgspec.Meta(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,31}\Z", description="name-of-letters")
]
"""Name of an axis in the control: files and file names contain it, so its characters must have no
other meaning there.
"""
Line = Annotated[
    str,
    msgspec.Meta(
        max_length=200,
        pattern=r"^[^\x00-\x1f\x7f-\x9f\u2028\u2029]*\Z",
        description="one line of text of at most 200 characters",
    ),
]
"""A text for a single line of the report, without line breaks."""
PlainPath = Annotated[
    str, msgspec.Meta(pattern=r"^[^\x00-\x1f\x7f]{1,100}\Z", description="name-of-file")
]


class MachineSection(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    name: Line
    controller: str
    measured_with: Literal["off", "on"]
    units: Literal["mm", "inch"] = "mm"
    direction: Literal["mean", "both"] = "mean"
    functions: list[str] = msgspec.field(default_factory=lambda: list(FUNCTIONS))
    squareness_into: dict[str, str] = msgspec.field(
        default_factory=lambda: dict(FOLD_DEFAULT)
    )
    existing: Annotated[list[PlainPath], msgspec.Meta(max_length=MOST_EXISTING)] = []
    active_sha256: list[str] = []


class AxisSection(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    name: AxisName
    step_mm: Positive
    reference_mm: float
    start_mm: float | None = None
    end_mm: float | None = None
    travel_mm: tuple[float, float] | None = None
    backlash_um: float | None = None
    working_mm: tuple[float, float] | None = None


class LimitsSection(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The section ``[limits]``: the limits at which safety checks warn or refuse (controllers.md
    10).

    A size of None means that the limit grows with the travel, as errors do. A slope of None means
    the control's own limit, or a plausible slope for a control without a limit.
    """

    value_um: Positive | None = None
    warn_value_um: Positive | None = None
    change_um: Positive | None = None
    slope_um_mm: Positive | None = None
    points: Annotated[int, msgspec.Meta(ge=2)] | None = None

    def at(self, travel_mm: float) -> "TravelLimits":
        """Return the limits in um for a travel in mm. A limit in the profile has priority."""
        warn, change = (
            max(SHORTEST_TRAVEL_MM, travel_mm) * um_m / 1000.0
            for um_m in (WARN_UM_M, CHANGE_UM_M)
        )
        return TravelLimits(
            value_um=self.value_um or 2.0 * warn,
            warn_value_um=self.warn_value_um or warn,
            change_um=self.change_um or change,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TravelLimits:
    """Limits of one table in um: for the correction, for a correction that no person has accepted,
    and for the change from the table in the control.
    """

    value_um: float
    warn_value_um: float
    change_um: float


class SignTestRecord(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The section ``[[sign_test]]`` for a kind of table: date, machine, files and result of the
    sign test.

    A test without machine, control, bump and runs is no evidence for the sense, but may contradict
    it.
    """

    kind: str
    date: date
    verdict: Literal["as-error", "as-compensation"]
    machine: str = ""
    control: str = ""
    measuring_system: str = ""
    function: str = ""
    bump_sha256: list[str] = []
    runs_sha256: list[str] = []

    def as_toml(self) -> str:
        lines = [
            f"{name} = {_toml(getattr(self, name))}"
            for name in self.__struct_fields__
            if getattr(self, name)
        ]
        return "\n".join(["[[sign_test]]", *lines, ""])


def _toml(value: str | date | list[str]) -> str:
    return (
        value.isoformat()
        if isinstance(value, date)
        else json.dumps(value, ensure_ascii=False)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """A checked profile. ``existing`` contains the machine's own files, byte for byte. ``assumed``
    is true for the profile of an export without a profile.
    """

    machine: MachineSection
    axes: Mapping[str, AxisSection]
    limits: LimitsSection
    sign_tests: tuple[SignTestRecord, ...]
    options: msgspec.Struct
    existing: tuple[ControlFile, ...] = ()
    assumed: bool = False
    source: str = "profile"

    def options_as(self, model: type[Options]) -> Options:
        if not isinstance(self.options, model):
            raise UsageError(
                f"{self.source}: machine.controller",
                expected=message("profile-this"),
                found=self.machine.controller,
            )
        return self.options

    def axis(self, letter: str) -> AxisSection:
        """Return the section of axis X, Y or Z. Raises ``UsageError`` for an axis that is not in
        the profile.
        """
        if letter not in self.axes:
            raise UsageError(
                f"{self.source}: axes.{letter}",
                expected=message("section-axes", letter=letter),
                found=message("nothing"),
            )
        return self.axes[letter]

    @property
    def zone(self) -> dict[str, tuple[float, float]]:
        """Return ``working_mm``, the part of the travel in which the tables fit best, for each axis
        whose section contains it.
        """
        return {
            letter: axis.working_mm
            for letter, axis in self.axes.items()
            if axis.working_mm is not None
        }

    def letter_of(self, name: str, where: str) -> str:
        """Return X, Y or Z for an axis name of the control. Raises ``UsageError``, with the place
        ``where``, for a foreign name.
        """
        names = {axis.name: letter for letter, axis in self.axes.items()}
        if name not in names:
            raise UsageError(
                where,
                expected=message("axis-named"),
                found=name,
                remedy=nearest(name, list(names)),
            )
        return names[name]

    def grid_mm(self, letter: str) -> Vector:
        """Return the ascending table positions of an axis in mm. Raises ``SafetyError`` for a step
        that does not divide the travel.
        """
        axis = self.axis(letter)
        if axis.start_mm is None or axis.end_mm is None:
            remedy = message("start-end-from")
            raise UsageError(
                f"{self.source}: axes.{letter}",
                expected=message("start-end"),
                found=message("nothing"),
                remedy=remedy,
            )
        sections = (axis.end_mm - axis.start_mm) / axis.step_mm
        if not abs(sections) <= MOST_SECTIONS:
            raise UsageError(
                f"{self.source}: axes.{letter}.step_mm",
                expected=message("sections-most", count=MOST_SECTIONS),
                found=f"{axis.step_mm:g} mm",
            )
        count = whole_steps(axis.end_mm - axis.start_mm, axis.step_mm)
        if count is None:
            raise SafetyError(
                f"{self.source}: axes.{letter}.step_mm",
                code="grid-unfit.step",
                expected=message("step-that-divides", size_mm=axis.end_mm - axis.start_mm),
                found=message("step-in-sections", step_mm=axis.step_mm, count=sections),
                remedy=message(
                    "nearest-that-fits",
                    step=f"{(axis.end_mm - axis.start_mm) / max(round(sections), 1):.10g}",
                ),
            )
        grid: Vector = axis.start_mm + axis.step_mm * np.arange(count + 1, dtype=np.float64)
        return grid

    def grid_words(self, letter: str) -> str:
        grid = self.grid_mm(letter)
        return f"{grid[0]:g} to {grid[-1]:g} mm, step {self.axis(letter).step_mm:g}"


def whole_steps(travel_mm: float, step_mm: float) -> int | None:
    """Return the number of steps in a travel, or None if it is not whole (controllers.md 3.2: (MAX
    - MIN) / STEP must be an integer; a control also accepts other numbers, and then keeps old
    values).

    The positions of a survey may make the travel slightly longer or shorter: by a digit of an
    encoder, or by the accumulated rounding of incremental moves (G91) with few decimals.
    """
    count = round(travel_mm / step_mm)
    near = abs(travel_mm - count * step_mm) <= max(
        min(NEARLY_MM, step_mm / 100.0), 1e-9 * travel_mm
    )
    return count if count >= 1 and near else None
