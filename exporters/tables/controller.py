"""The interface of every control: functions that plan, render and parse tables, and the law by
which the control applies a table.

    curves --plan--> tables --render--> files          (export)
    files  --parse-> tables --law-----> correction     (verify, merge, sign test)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import msgspec

from stepdiag.base.findings import Finding
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.fit import Product
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table

PLAUSIBLE_SLOPE_UM_MM = 0.8
"""Largest plausible slope of a guideway or screw along its travel, for a control without a limit
(controllers.md 10.4): 800 urad. The slope is twice the limit for a whole axis in
`exporters.tables.profile.WARN_UM_M`, because straightness has bends and also contains the
squareness.
"""
PLAUSIBLE_STEP_UM = 6.0
"""Plausible change in um between two measured values, in addition to the plausible slope. It allows
for screw waves of 3 um peak to peak, and for four times the scatter of the difference of two values
on a poor machine.
"""


def plausible_slope_um_mm(measured_mm: float) -> float:
    """Return the largest plausible slope in um/mm between two values measured at a distance of
    ``measured_mm``.
    """
    return PLAUSIBLE_SLOPE_UM_MM + PLAUSIBLE_STEP_UM / measured_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits that a control has for a table; None means no limit.

    ``points`` is the largest number of points in a table, ``value_um`` the largest value,
    ``tables`` the largest number of tables of a kind. ``neighbour_um`` is the largest change from
    point to point, ``neighbour_um_mm`` the largest change per mm of spacing. ``slope_um_mm`` is the
    control's own limit of the slope, or "plausible"; None if the control limits neighbouring values
    instead. ``reference_um`` is the intended value at the reference of a table that replaces
    another compensation of the control. ``ends_backlash`` is true if this table switches off the
    control's backlash compensation, so that the reversal error cannot be corrected twice.
    """

    points: int | None = None
    neighbour_um: float | None = None
    neighbour_um_mm: float | None = None
    value_um: float | None = None
    tables: int | None = None
    slope_um_mm: float | Literal["plausible"] | None = "plausible"
    reference_um: float = 0.0
    ends_backlash: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The planned tables of an export, with remarks about the plan.

    ``listed`` contains tables without a file, which the report shows for typing in. ``options``
    contains the profile's options with the choices of the planning, for ``render`` and ``parse``;
    None if the planning chose nothing.
    """

    tables: tuple[Table, ...]
    findings: tuple[Finding, ...] = ()
    listed: tuple[Table, ...] = ()
    options: msgspec.Struct | None = None


@runtime_checkable
class Multiplying(Protocol):
    def plan_products(
        self, curves: Sequence[Curve], products: Sequence[Product], profile: Profile
    ) -> Plan:
        """Return the tables for the curves, and for the products that the profile allows and the
        control has room for.
        """


@runtime_checkable
class Pairing(Protocol):
    """A control with one number for the squareness of a pair of axes. Such a control corrects both
    straightness functions of the pair or none.
    """

    def paired(self, names: Sequence[str], fold: Mapping[str, str]) -> tuple[str, ...]:
        """Return the functions, each with the second function of its pair if it contains a
        squareness. ``fold`` contains the function of each squareness.
        """


@runtime_checkable
class Emptying(Protocol):
    """A control in which an export can empty an old table that no new table overwrites, so that old
    and new table do not act together.
    """

    def emptied(
        self, own: Sequence[ControlFile], tables: Sequence[Table], profile: Profile
    ) -> tuple[Table, ...]:
        """Return a table of zeros for every old table of ``own`` that would stay active although
        ``tables`` do not contain it.
        """


@runtime_checkable
class Reporting(Protocol):
    def read_back(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        """Return the programs by which the control writes out tables, switches and weights."""


@runtime_checkable
class Switching(Protocol):
    def switches(self, tables: Sequence[Table], profile: Profile) -> Mapping[str, str]:
        """Return the switches and weights that make the tables active, by the control's own
        names.
        """

    def held_switches(self, files: Sequence[ControlFile]) -> Mapping[str, str]:
        """Return the switches and weights in files that were read out of the control."""


class Controller(Protocol):
    """A family of controls. Implementations have no state: the profile contains all data about a
    machine.
    """

    @property
    def name(self) -> str:
        """Return the name of the control for ``--controller``."""

    @property
    def title(self) -> str:
        """Return the maker and the models as a text for people."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return the kinds of table of this control; each has its own sense, and its own sign
        test.
        """

    @property
    def options(self) -> type[msgspec.Struct]:
        """Return the type of the options in the profile's section ``[<name>]``."""

    @property
    def options_template(self) -> str:
        """Return the section ``[<name>]`` as commented TOML with its header line; "?" marks an open
        question.
        """

    def quick_options(self) -> msgspec.Struct:
        """Return the options for an export without a profile. ``plan`` reports each assumption in
        these options.
        """

    def limits(self, table: Table, profile: Profile) -> Limits:
        """Return the limits that the control of the profile has for a table."""

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        """Return the tables for the curves. Their values are sampled on the grid of the profile,
        zero at the reference, and rounded once to the unit of the control.

        Raises ``SafetyError`` for a curve that the control cannot represent.
        """

    def render(
        self, tables: Sequence[Table], profile: Profile, notes: Sequence[str] = ()
    ) -> tuple[ControlFile, ...]:
        """Return the files for the control. Every file that may contain comments has the ``notes``
        as comments at its head.

        Each note is one line of plain ASCII. Raises ``SafetyError`` if the machine's own file that
        serves as template is missing.
        """

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        """Return the tables that the control would read from these files.

        Raises ``DataError``, with file and line, for a foreign, damaged or incomplete file.
        """

    def standing(
        self, own: Sequence[ControlFile], new: Sequence[ControlFile], profile: Profile
    ) -> tuple[Table, ...]:
        """Return the tables that are active after loading the files ``new`` into a control with the
        files ``own``. Without new files, return the tables of ``own``.

        A loaded table replaces only the table in the same place, which is a number, a pair of axes
        or a file name, by the rule of the control. Raises the ``DataError`` of `parse`.
        """

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        """Return the files that bring the control back to its state before ``tables`` were loaded.

        The files are the machine's own files, byte for byte, and for every other table a file that
        makes it ineffective. The file names are those of the control. ``profile`` contains the
        choices of the planning.
        """

    def recognises(self, file: ControlFile) -> bool:
        """Return whether the file is in this controller's format, from its name and first lines."""

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:
        """Return the table as rows of the report, in the words and numbers of the control (or
        `plain_rows`).
        """

    def instructions(self, profile: Profile) -> tuple[str, ...]:
        """Return the steps for a person who loads the files, in order, with precautions first."""


def plan_of(
    controller: Controller,
    curves: Sequence[Curve],
    products: Sequence[Product],
    profile: Profile,
) -> Plan:
    """Return the tables of a control for curves, and for products where the control multiplies
    tables. Raises as `Controller.plan` does.
    """
    if isinstance(controller, Multiplying):
        return controller.plan_products(curves, products, profile)
    return controller.plan(curves, profile)
