"""The interface of every controller module: plan, render, parse, and the law of its control for a
table.

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
(controllers.md 10.4): 800 urad, twice the limit for a whole axis in
`exporters.tables.profile.WARN_UM_M`, because straightness bends and contains the squareness too.
"""
PLAUSIBLE_STEP_UM = 6.0
"""Additional plausible change between two measured values, however close they are: peak to peak of
a screw's waves of 3 um, or four times the scatter of a difference of two values on a poor machine.
"""


def plausible_slope_um_mm(measured_mm: float) -> float:
    """Return the slope in um/mm from which values at a distance of ``measured_mm`` are not
    plausible.
    """
    return PLAUSIBLE_SLOPE_UM_MM + PLAUSIBLE_STEP_UM / measured_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of the control itself; None without a limit.

    ``points``: largest number of points in a table; ``neighbour_um``: largest change from point to
    point; ``neighbour_um_mm``: the same per mm of spacing; ``value_um``: largest value; ``tables``:
    largest number of tables of a kind. ``slope_um_mm`` is the control's own limit of the slope, or
    "plausible"; None if the control limits neighbouring values instead. ``reference_um`` is the
    table's intended value at the reference, which replaces another compensation of the control.
    ``ends_backlash``: the control's own backlash compensation stops wherever this table acts, so
    the reversal error cannot be corrected twice.
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

    ``listed`` are tables without a file: the report shows them for entering by hand. ``options``
    are the profile's options with every choice of the planning, None without choices; ``render``
    and ``parse`` need them.
    """

    tables: tuple[Table, ...]
    findings: tuple[Finding, ...] = ()
    listed: tuple[Table, ...] = ()
    options: msgspec.Struct | None = None


@runtime_checkable
class Multiplying(Protocol):
    """A control that can multiply a table by another."""

    def plan_products(
        self, curves: Sequence[Curve], products: Sequence[Product], profile: Profile
    ) -> Plan:
        """Return the tables for the curves, and for the products that the profile allows and for
        which the control has tables.
        """


@runtime_checkable
class Pairing(Protocol):
    """A control whose squareness is one number for both functions of a pair of axes: neither is
    corrected without the other."""

    def paired(self, names: Sequence[str], fold: Mapping[str, str]) -> tuple[str, ...]:
        """Return the functions, with the partners of those that contain a squareness; ``fold``
        names these functions.
        """


@runtime_checkable
class Emptying(Protocol):
    """A control on which an old table that no new table overwrites can be emptied, so that the two
    do not act together.
    """

    def emptied(
        self, own: Sequence[ControlFile], tables: Sequence[Table], profile: Profile
    ) -> tuple[Table, ...]:
        """Return tables of zeros for every seat of ``own`` whose table would be active without
        being included in ``tables``.
        """


@runtime_checkable
class Reporting(Protocol):
    """A control that can write out its contents."""

    def read_back(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        """Return the programs that write out the control's contents of these tables, switches and
        weights included.
        """


@runtime_checkable
class Switching(Protocol):
    """A control whose tables have switches and weights beside their values."""

    def switches(self, tables: Sequence[Table], profile: Profile) -> Mapping[str, str]:
        """Return the switches and weights with which the tables are active, by the control's own
        names.
        """

    def held_switches(self, files: Sequence[ControlFile]) -> Mapping[str, str]:
        """Return the switches and weights in files that were read out of the control."""


class Controller(Protocol):
    """One controller family. Implementations hold no state: the profile contains all data about a
    machine.
    """

    @property
    def name(self) -> str:
        """Return the word of ``--controller``."""

    @property
    def title(self) -> str:
        """Return maker and models, for people."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return the kinds of table of this control; each has its own sense, and its own sign
        test.
        """

    @property
    def options(self) -> type[msgspec.Struct]:
        """Return the model of the profile's section ``[<name>]``."""

    @property
    def options_template(self) -> str:
        """Return this section as commented TOML, header line included; an open question is written
        as "?".
        """

    def quick_options(self) -> msgspec.Struct:
        """Return the options for a provisional export without a profile (contract 5); ``plan``
        states each of their assumptions.
        """

    def limits(self, table: Table, profile: Profile) -> Limits:
        """Return the limits of the control of this profile for such a table."""

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        """Return the tables for the curves: sampled on the profile's grid, zero at the reference,
        quantised once.

        Raises ``SafetyError`` where the control cannot hold the curve at all.
        """

    def render(
        self, tables: Sequence[Table], profile: Profile, notes: Sequence[str] = ()
    ) -> tuple[ControlFile, ...]:
        """Return the files for the control, with ``notes`` as comments at the head of every file
        that may hold comments.

        Notes are plain ASCII, a line each. Raises ``SafetyError`` if a needed template is missing.
        """

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        """Return the tables as the control would read them from these files.

        Raises ``DataError`` naming file and line for a foreign, damaged or incomplete file.
        """

    def standing(
        self, own: Sequence[ControlFile], new: Sequence[ControlFile], profile: Profile
    ) -> tuple[Table, ...]:
        """Return the active tables after loading ``new`` into a control that held ``own``; without
        new files, the tables of ``own``.

        A loaded table replaces the table in the same place (a number, a pair of axes or a file
        name, by the rule of this control), and no other. Raises ``DataError`` as `parse` does.
        """

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:
        """Return the files that bring the control back to its state before ``tables`` were loaded.

        The machine's own files byte for byte, and for every table missing in them a file that takes
        it out of effect. Names are those of the control; ``profile`` carries the choices that the
        planning of the tables made.
        """

    def recognises(self, file: ControlFile) -> bool:
        """Return whether the file is in this controller's format, from its name and first lines."""

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:
        """Return the table for the report, in the control's own words and numbers (or
        `plain_rows`).
        """

    def instructions(self, profile: Profile) -> tuple[str, ...]:
        """Return the steps of a person who loads the files, in order, precautions first."""


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
