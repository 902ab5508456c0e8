"""Curves as CSV for any control that is not in the registry: the error itself, in um, in machine
coordinates.

The numbers are ``e = actual - commanded`` relative to the reference position, without the law of a
control. `stepdiag` reads the curves of such a file as the error of the machine. A person who types
the numbers into a control must choose the sign with which the control subtracts the error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines, finite, headed_lines
from stepdiag.exporters.files.numbers import fixed, shortest
from stepdiag.exporters.tables.controller import Limits, Plan
from stepdiag.exporters.tables.curves import FUNCTIONS, Curve
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import absolute_tables
from stepdiag.exporters.tables.tables import Law, Table, plain_rows

NAME = "neutral"
KIND = "curve"
LAW = Law(sense="as-error")
HEADER = "function,direction,position_mm,error_um"
_DECIMALS = 3


class NeutralOptions(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The section ``[neutral]`` of a profile, which has no settings."""


@dataclass(frozen=True, slots=True)
class Neutral:
    name: str = NAME
    title: str = "neutral curves (CSV)"
    kinds: tuple[str, ...] = (KIND,)
    options: type[msgspec.Struct] = NeutralOptions
    options_template: str = "[neutral]                     # nothing to choose\n"

    def quick_options(self) -> NeutralOptions:
        return NeutralOptions()

    def limits(self, table: Table, profile: Profile) -> Limits:  # noqa: ARG002 - part of the protocol
        return Limits()

    def plan(self, curves: Sequence[Curve], profile: Profile) -> Plan:
        quantum_um = 10.0**-_DECIMALS
        planned = [
            absolute_tables(
                curve, profile, kind=KIND, law=LAW, quantum_um=quantum_um, place={}
            )
            for curve in curves
        ]
        return Plan(tables=tuple(table for tables in planned for table in tables))

    def render(
        self,
        tables: Sequence[Table],
        profile: Profile,  # noqa: ARG002
        notes: Sequence[str] = (),  # noqa: ARG002
    ) -> tuple[ControlFile, ...]:
        """Return the file ``curves.csv``. In its column ``direction``, 1 and -1 are travel of the
        input axis in + and -, and 0 is both.
        """
        rows = [
            f"{table.name},{table.direction},{shortest(float(at))},{fixed(float(value), _DECIMALS)}"
            for table in tables
            for at, value in zip(table.position_mm, table.value_um, strict=True)
        ]
        return (ControlFile(name="curves.csv", data=ascii_lines([HEADER, *rows, "end,,,"])),)

    def parse(self, files: Sequence[ControlFile], profile: Profile) -> tuple[Table, ...]:
        return tuple(table for file in files for table in _tables(file, profile))

    def standing(
        self, own: Sequence[ControlFile], new: Sequence[ControlFile], profile: Profile
    ) -> tuple[Table, ...]:
        """Return the curves of the new files. If there are no new files, return the curves of the
        machine's own files.

        Each file contains all curves of a compensation, so new files replace the own files.
        """
        return self.parse(new or own, profile)

    def restore(self, tables: Sequence[Table], profile: Profile) -> tuple[ControlFile, ...]:  # noqa: ARG002 - part of the protocol
        """Return no file, because curves change no control."""
        return ()

    def recognises(self, file: ControlFile) -> bool:
        return file.data.startswith(HEADER.encode("ascii"))

    def readable(self, table: Table, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        return plain_rows(table)

    def instructions(self, profile: Profile) -> tuple[str, ...]:  # noqa: ARG002 - part of the protocol
        return (
            (
                "The numbers are errors: positive where the output axis went too far in its + "
                "direction."
            ),
            (
                "A control that adds its table to the command needs them with the opposite sign; "
                "one "
                "that subtracts it takes them as they are."
            ),
            (
                "Try a small bump first (sign test), save the old table, and measure again after "
                "loading."
            ),
        )


def _tables(file: ControlFile, profile: Profile) -> list[Table]:
    lines = headed_lines(file, HEADER)
    if lines[-1][1] != "end,,,":
        raise DataError(
            file.name,
            expected=message("last-row-end"),
            found=lines[-1][1],
            remedy=message("file-truncated"),
        )
    groups: dict[tuple[str, int], list[tuple[float, float]]] = {}
    for where, line in lines[1:-1]:
        name, direction, at, value = _curve_row(where, line)
        points = groups.setdefault((name, direction), [])
        if points and at <= points[-1][0]:
            raise DataError(
                where,
                expected=message("position-above", points=points[-1][0]),
                found=f"{at:g}",
            )
        points.append((at, value))
    return [
        _curve_table(name, direction, np.array(points), profile, file.name)
        for (name, direction), points in groups.items()
    ]


def _curve_row(where: str, line: str) -> tuple[str, int, float, float]:
    cells = line.split(",")
    if len(cells) != 4 or cells[0] not in FUNCTIONS or cells[1] not in ("0", "1", "-1"):
        raise DataError(
            where, expected=message("function-exx-ezz-direction"), found=repr(line)
        )
    return cells[0], int(cells[1]), finite(cells[2], where), finite(cells[3], where)


def _curve_table(
    name: str,
    direction: int,
    points: np.ndarray[tuple[int, int], np.dtype[np.float64]],
    profile: Profile,
    source: str,
) -> Table:
    if len(points) < 2:
        raise DataError(
            f"{source}: {name}",
            expected=message("at-least-two-points"),
            found=str(len(points)),
        )
    return Table(
        kind=KIND,
        input_axis=name[2],
        output_axis=name[1],
        position_mm=points[:, 0],
        value_um=points[:, 1],
        quantum_um=10.0**-_DECIMALS,
        law=LAW,
        reference_mm=profile.axis(name[2]).reference_mm,
        direction=direction,
    )
