"""The controller profile: everything about one machine that an export must know and must not guess.

A profile is a TOML file. What has no default is asked: the template holds ``"?"`` in its place, and an unanswered question
refuses the profile (`exporters.profiles.file` reads it).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Literal, TypeVar

import msgspec
import numpy as np

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.settings import nearest
from stepdiag.exporters.tables.curves import FOLD_DEFAULT, FUNCTIONS
from stepdiag.solver.errors import SafetyError, UsageError
from stepdiag.solver.geometry.volume import Vector

Positive = Annotated[float, msgspec.Meta(gt=0)]
Options = TypeVar("Options", bound=msgspec.Struct)
AXIS_LETTERS = ("X", "Y", "Z")
MOST_EXISTING = 64
"""Files of its own that a machine may have."""
MOST_SECTIONS = 20_000
"""Sections of one axis: 20 m in millimetres; no control holds as many."""
AxisName = Annotated[
    str, msgspec.Meta(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,31}\Z", description="a name of letters, digits and underscore, a letter first")
]
"""It stands in files for the control and in the names of some: nothing in it may be taken for anything else."""
Line = Annotated[
    str,
    msgspec.Meta(
        max_length=200, pattern=r"^[^\x00-\x1f\x7f-\x9f\u2028\u2029]*\Z", description="one line of text of at most 200 characters"
    ),
]
"""What a report says in a line of its own cannot become several."""
PlainPath = Annotated[str, msgspec.Meta(pattern=r"^[^\x00-\x1f\x7f]{1,100}\Z", description="the name of a file, of at most 100 characters")]


class MachineSection(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """``[machine]``: which machine and control, and in what state it was measured."""

    name: Line
    controller: str
    measured_with: Literal["off", "on"]
    units: Literal["mm", "inch"] = "mm"
    direction: Literal["mean", "both"] = "mean"
    functions: list[str] = msgspec.field(default_factory=lambda: list(FUNCTIONS))
    squareness_into: dict[str, str] = msgspec.field(default_factory=lambda: dict(FOLD_DEFAULT))
    existing: Annotated[list[PlainPath], msgspec.Meta(max_length=MOST_EXISTING)] = []
    active_sha256: list[str] = []


class AxisSection(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """``[axes.X]``: name, grid, reference and travel of one axis, in machine coordinates."""

    name: AxisName
    step_mm: Positive
    reference_mm: float
    start_mm: float | None = None
    end_mm: float | None = None
    travel_mm: tuple[float, float] | None = None
    backlash_um: float | None = None
    working_mm: tuple[float, float] | None = None


class LimitsSection(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """``[limits]``: where the safety checks warn and refuse (controllers.md 10)."""

    value_um: Positive = 100.0
    warn_value_um: Positive = 50.0
    change_um: Positive = 20.0
    slope_um_mm: Positive | None = None
    """None: the control's own limit, or what is plausible where it has none."""
    points: Annotated[int, msgspec.Meta(ge=2)] | None = None


class SignTestRecord(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """One ``[[sign_test]]``: for one kind of table, when its sense was tried on this machine and what it showed."""

    kind: str
    date: date
    verdict: Literal["as-error", "as-compensation"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """A validated profile. ``existing`` are the machine's own files, byte for byte; ``assumed`` says that nobody wrote
    this profile: it stands in for one in a quick look with ``--step-mm`` alone."""

    machine: MachineSection
    axes: Mapping[str, AxisSection]
    limits: LimitsSection
    sign_tests: tuple[SignTestRecord, ...]
    options: msgspec.Struct
    existing: tuple[ControlFile, ...] = ()
    assumed: bool = False
    source: str = "profile"

    def options_as(self, model: type[Options]) -> Options:
        """Return the controller's own section as its model. Raises ``UsageError`` for another controller's profile."""
        if not isinstance(self.options, model):
            raise UsageError(f"{self.source}: machine.controller", expected="a profile of this controller", found=self.machine.controller)
        return self.options

    def axis(self, letter: str) -> AxisSection:
        """Return the section of axis X, Y or Z. Raises ``UsageError`` for an axis that the profile does not name."""
        if letter not in self.axes:
            raise UsageError(f"{self.source}: axes.{letter}", expected=f"a section [axes.{letter}]", found="nothing")
        return self.axes[letter]

    @property
    def zone(self) -> dict[str, tuple[float, float]]:
        """Return, by axis, the part of the travel where the tables have to fit best, for the axes that name one."""
        return {letter: axis.working_mm for letter, axis in self.axes.items() if axis.working_mm is not None}

    def letter_of(self, name: str, where: str) -> str:
        """Return X, Y or Z for an axis name of the control. Raises ``UsageError`` naming ``where`` for a foreign name."""
        names = {axis.name: letter for letter, axis in self.axes.items()}
        if name not in names:
            raise UsageError(where, expected="an axis that the profile names", found=name, remedy=nearest(name, list(names)))
        return names[name]

    def grid_mm(self, letter: str) -> Vector:
        """Return the table positions of an axis, ascending. Raises ``SafetyError`` where the step does not fit."""
        axis = self.axis(letter)
        if axis.start_mm is None or axis.end_mm is None:
            remedy = "write them there, or give --result: the travel that was measured"
            raise UsageError(f"{self.source}: axes.{letter}", expected="start_mm and end_mm", found="nothing", remedy=remedy)
        sections = (axis.end_mm - axis.start_mm) / axis.step_mm
        if not abs(sections) <= MOST_SECTIONS:
            raise UsageError(
                f"{self.source}: axes.{letter}.step_mm", expected=f"at most {MOST_SECTIONS} sections", found=f"{axis.step_mm:g} mm"
            )
        count = round(sections)
        # Controllers.md 3.2: (MAX - MIN) / STEP must be an integer; a control accepts less, and then holds old values.
        if count < 1 or abs(sections - count) > 1e-9 * max(1.0, sections):
            raise SafetyError(
                f"{self.source}: axes.{letter}.step_mm",
                code="grid-not-integral",
                expected=f"a step that divides {axis.end_mm - axis.start_mm:g} mm into whole sections",
                found=f"{axis.step_mm:g} mm ({sections:.6g} sections)",
                remedy=f"the nearest that fits is {(axis.end_mm - axis.start_mm) / max(count, 1):.10g} mm",
            )
        grid: Vector = axis.start_mm + axis.step_mm * np.arange(count + 1, dtype=np.float64)
        return grid
