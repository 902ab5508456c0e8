"""The sign test: a table with a bump for one function, and the verdict on its sense from the
movement of the axis (controllers.md 11).

A manual may state a wrong sense; the sign test measures the sense. The table is zero everywhere
except for one trapezium with gentle flanks. The axis is driven to the same commanded positions with
the table off and on. The difference of the readings is the effect of the table.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.messages import Message, message
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.safety.restore import restore_files
from stepdiag.exporters.tables.controller import Controller, Multiplying, Plan
from stepdiag.exporters.tables.curves import FUNCTIONS, SQUARENESS_SLOPE, Curve
from stepdiag.exporters.tables.fit import Product
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Sense, Table, correction_um

HEIGHT_UM = 10.0
"""Height of the bump in um: well above the repeatability of a machine, well below the limits of the
safety checks.
"""
SLOPE_UM_MM = 0.2
"""Slope of a flank of the bump, small enough for the safety checks."""
_LEFT_BEYOND = 0.5
"""Largest movement beyond the bump, as a share of the measured or the expected movement at the top
of the bump, whichever is larger.
"""
_NO_MOVEMENT = 0.05
"""Share of the expected movement below which the table is not active."""
_SIZE = (0.525, 1.9)
"""Shares of the expected movement between which the sense is accepted. A movement of half or twice
the expected size is not accepted, because it has a likely cause. The limits differ from 1/2 and 2
by the error of a reading.
"""
_CAUSES = (
    (10.0, message("unit-ten-times")),
    (2.0, message("counts-in-diameters")),
    (25.4, message("inch-mixed-up")),
    (1000.0, message("um-mixed-up")),
)
_ALIKE = 1.3
"""Largest ratio between the measured share of the movement and the share that a known cause
produces, at which the report names this cause.
"""


_BESIDE = 5.0
"""Share of the expected movement above which a control adds two linked tables instead of their
product. A control that adds linked tables moves the axis ten times as far.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bump:
    """A sign test ready for loading, with the movement that the control's stated law predicts.

    ``files`` are loaded into the control for the test, ``restore`` after the test. ``beyond_mm`` is
    the position where the movement ends; None for a ramp, which is the table of a control with a
    slope and no curve.
    """

    function: str
    tables: tuple[Table, ...]
    files: tuple[ControlFile, ...]
    restore: tuple[ControlFile, ...]
    reference_mm: float
    top_mm: float
    beyond_mm: float | None
    lever: tuple[str, float] | None = None
    """For a product: the position of its other axis at which the product moves the output axis
    most.
    """

    @property
    def expected_um(self) -> float:
        """Return the movement of the output axis from the reference to the top of the bump, if the
        stated sense is right.
        """
        return float(np.diff(self.moved_um(np.array([self.reference_mm, self.top_mm])))[0])

    def moved_um(self, at_mm: Vector) -> Vector:
        lever = np.array([0.0 if self.lever is None else self.lever[1]])
        times = [
            1.0 if table.multiplier is None else table.multiplier.at(lever).item()
            for table in self.tables
        ]
        return sum(
            (
                correction_um(table, at_mm) * by
                for table, by in zip(self.tables, times, strict=True)
            ),
            0.0 * at_mm,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Result of the sign test. ``sense`` is None without a decision. ``words`` contains the
    reason.
    """

    kind: str
    sense: Sense | None
    moved_um: float
    words: Message

    @property
    def text(self) -> str:
        return str(self.words)


def bump(controller: Controller, profile: Profile, function: str) -> Bump:
    """Return the bump table for ``function`` (EXX, EYX ..), on the longer side of its reference.

    Raises ``SafetyError`` if the travel is too short for a bump that a laser can measure,
    ``UsageError`` for an unknown function.
    """
    base, star, by = function.partition("*")
    if base not in FUNCTIONS or (star and by not in tuple(_levers(base))):
        raise UsageError(
            "--function",
            expected=message("one-or-product-such", functions=FUNCTIONS),
            found=function,
        )
    letter = function[2]
    grid = profile.grid_mm(letter)
    reference = profile.axis(letter).reference_mm
    one_way = replace(
        profile, machine=msgspec.structs.replace(profile.machine, direction="mean")
    )
    corners, height = _trapezium(grid, reference, profile.source)
    shape = np.interp(grid, np.sort(corners), [0.0, height, height, 0.0])
    end = float(grid[-1] if corners[3] > corners[0] else grid[0])
    plan = (
        _product_plan(controller, one_way, function, shape)
        if by
        else controller.plan([_curve(function, grid, shape)], one_way)
    )
    ramp = not plan.tables
    if ramp:
        shape = HEIGHT_UM * (grid - reference) / (end - reference)
        plan = controller.plan(
            [_curve(function, grid, shape, *_squareness_of(function))], one_way
        )
    if not plan.tables:
        expected = message("has-table")
        raise UsageError(
            "--function",
            expected=expected,
            found=function,
            remedy=message("straightness-stays-in-its"),
        )
    settled = replace(one_way, options=plan.options or profile.options)
    tested = tuple(table for table in plan.tables if not by or table.name == function)
    return Bump(
        function=function,
        tables=tested,
        files=controller.render(
            plan.tables, settled, notes=("SIGN TEST: a bump, no compensation",)
        ),
        restore=tuple(restore_files(controller, plan.tables, settled)),
        reference_mm=reference,
        top_mm=end if ramp else float(np.mean(corners[1:3])),
        beyond_mm=None if ramp else end,
        lever=(by, _far_mm(tested, profile.grid_mm(by))) if by else None,
    )


def _curve(function: str, grid: Vector, shape: Vector, *parts: str) -> Curve:
    return Curve(
        name=function,
        position_mm=grid,
        forward_um=shape,
        u_um=np.zeros(grid.shape),
        parts=("sign test", *parts),
    )


def _squareness_of(function: str) -> tuple[str, ...]:
    return tuple(name for name, slopes in SQUARENESS_SLOPE.items() if function in slopes)


def _levers(base: str) -> str:
    return "XYZ".replace(base[2], "")


def _product_plan(
    controller: Controller, profile: Profile, function: str, shape_um: Vector
) -> Plan:
    ends = profile.grid_mm(function[4])[[0, -1]]
    product = Product(
        output_axis=function[1],
        input_axis=function[2],
        by_axis=function[4],
        position_mm=profile.grid_mm(function[2]),
        value_um=shape_um,
        u_um=np.zeros(shape_um.shape),
        middle_mm=float(np.mean(ends)),
        half_mm=float(ends[1] - ends[0]) / 2,
        rms_um=float(np.std(shape_um)),
    )
    plan = (
        controller.plan_products((), (product,), profile)
        if isinstance(controller, Multiplying)
        else None
    )
    if plan is None or not plan.tables:
        raise UsageError(
            f"{profile.source}: {controller.name}.products",
            expected=message("control-and-profile-with"),
            found=message("none"),
            remedy=message("set-products-true-in"),
        )
    return plan


def verdict(test: Bump, position_mm: Vector, off_um: Vector, on_um: Vector) -> Verdict:
    """Return the verdict on the sense, from the movement between table off and table on.

    ``position_mm`` contains the commanded positions of the input axis. ``off_um`` and ``on_um``
    contain the actual position of the output axis there, in its + direction, from any common zero.
    Raises ``DataError`` if the run does not include the reference, the top of the bump and the end
    beyond it.
    """
    table = test.tables[-1]
    moved = _from_reference(test, position_mm, np.asarray(on_um) - np.asarray(off_um))
    at_top = float(np.interp(test.top_mm, *moved))
    beyond = 0.0 if test.beyond_mm is None else float(np.interp(test.beyond_mm, *moved))
    expected = test.expected_um
    signed = at_top / expected
    share = abs(signed)

    def undecided(words: Message) -> Verdict:
        return Verdict(kind=table.kind, sense=None, moved_um=at_top, words=words)

    if share < _NO_MOVEMENT:
        return undecided(message("axis-moved-um-table", at_top_um=at_top))
    if abs(beyond) > _LEFT_BEYOND * max(abs(at_top), abs(expected)):
        return undecided(
            message(
                "left-beyond-bump-incremental"
                if table.law.data == "absolute"
                else "left-beyond-bump-absolute",
                left_um=beyond,
            )
        )
    if test.lever is not None and share > _BESIDE:
        text = message("axis-moved-um-um", at_top_um=at_top, expected_um=expected)
        return undecided(text)
    if not _SIZE[0] <= share <= _SIZE[1]:
        return undecided(
            message(
                "axis-moved-um-instead",
                at_top_um=at_top,
                expected_um=expected,
                share=share,
                cause=_cause(share),
            )
        )
    right = signed > 0
    sense = table.law.sense if right else _opposite(table.law.sense)
    words = (
        message("sense-shown", moved_um=at_top, sense=sense)
        if right
        else message(
            "other-sense-shown", moved_um=at_top, sense=sense, written=table.law.sense
        )
    )
    return Verdict(kind=table.kind, sense=sense, moved_um=at_top, words=words)


def _cause(share: float) -> Message:
    factor = max(share, 1.0 / share)
    nearest, words = min(_CAUSES, key=lambda cause: abs(np.log(factor / cause[0])))
    if max(factor / nearest, nearest / factor) <= _ALIKE:
        return words
    return message("look-at-units")


def _trapezium(grid: Vector, reference: float, where: str) -> tuple[Vector, float]:
    """Return the four corners of the bump at grid points, from the corner next to the reference
    outwards, and the height of the bump in um.
    """
    up = grid[-1] - reference >= reference - grid[0]
    outward = grid[grid >= reference] if up else grid[grid <= reference][::-1]
    flank = max(1, round(HEIGHT_UM / SLOPE_UM_MM / float(grid[1] - grid[0])))
    flank = min(flank, (len(outward) - 2) // 3)
    if flank < 1:
        raise SafetyError(
            where,
            code="grid-unfit.bump",
            expected=message("at-least-five-points"),
            found=str(len(outward)),
            remedy=message("take-smaller-step-mm"),
        )
    start = 1 if len(outward) > 3 * flank + 1 else 0
    corners = outward[[start, start + flank, start + 2 * flank, start + 3 * flank]]
    return corners, min(HEIGHT_UM, SLOPE_UM_MM * abs(float(corners[1] - corners[0])))


def _far_mm(tables: Sequence[Table], grid_mm: Vector) -> float:
    low, high = (
        sum(abs(t.multiplier.at(np.array([at])).item()) for t in tables if t.multiplier)
        for at in grid_mm[[0, -1]]
    )
    return float(grid_mm[0] if low > high + 1e-9 else grid_mm[-1])


def _from_reference(
    test: Bump, position_mm: Vector, moved_um: Vector
) -> tuple[Vector, Vector]:
    order = np.argsort(position_mm)
    position, moved = np.asarray(position_mm)[order], moved_um[order]
    needed = (
        test.reference_mm,
        test.top_mm,
        test.top_mm if test.beyond_mm is None else test.beyond_mm,
    )
    if (
        len(position) < 3
        or position[0] > min(needed) + 1e-3
        or position[-1] < max(needed) - 1e-3
    ):
        raise DataError(
            message("sign-test"),
            expected=message("positions-from-to-mm", low_mm=min(needed), high_mm=max(needed)),
            found=message("so-many-positions", count=len(position)),
            remedy=message("drive-run-over-reference"),
        )
    return position, moved - np.interp(test.reference_mm, position, moved)


def _opposite(sense: Sense) -> Sense:
    return "as-compensation" if sense == "as-error" else "as-error"
