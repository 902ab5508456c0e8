"""The safety checks of an export (controllers.md 10). Each check has a finding code.

An error refuses the export. A warning refuses the export unless a person accepts its code. The
module `remarks` contains the findings that never refuse. Check numbers in the docstrings are those
of controllers.md 10. The profile and the modules of the controls make parts of the checks 1 (grid),
5 (overlap) and 9 (axes).
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np

from stepdiag.base.errors import SafetyError
from stepdiag.base.findings import Finding, error, warning
from stepdiag.base.messages import Words, message
from stepdiag.base.names import AXES
from stepdiag.base.result.result import Result
from stepdiag.base.volume import ROUNDING_MM, Vector
from stepdiag.exporters.neutral import curves_csv
from stepdiag.exporters.safety.sign_evidence import subject
from stepdiag.exporters.safety.standing import acts_with
from stepdiag.exporters.safety.verdicts.case import TableCase
from stepdiag.exporters.tables.controller import Controller, plausible_slope_um_mm
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, correction_um, summed_um

SIGN_TEST_DAYS = 365
"""A sign test is valid for twelve months."""
_ZERO_UM = 1e-3
_METRIC_ONLY = ("siemens", "fanuc", "heidenhain", "beckhoff", "mitsubishi", "fagor")


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Input of the checks. ``previous`` contains the tables in the control now, as far as the
    profile contains them. ``today`` is used only for the age of a sign test.
    """

    controller: Controller
    profile: Profile
    result: Result
    tables: Sequence[Table]
    curves: Sequence[Curve] = ()
    previous: Sequence[Table] = ()
    today: date = date.min


Check = Callable[[Case], Iterator[Finding]]


def check_finite(case: Case) -> Iterator[Finding]:
    """Check 1: finite values, ascending positions."""
    for table in case.tables:
        if not (np.isfinite(table.value_um).all() and np.isfinite(table.position_mm).all()):
            yield error("file-unsound.number", label=table.label)
        elif np.any(np.diff(table.position_mm) <= ROUNDING_MM):
            yield error("grid-unfit.order", label=table.label)


def check_values(case: Case) -> Iterator[Finding]:
    """Check 2: size of the correction, and largest value of the control."""
    for table in case.tables:
        limits = case.profile.limits.at(_travel_mm(table))
        largest = float(np.max(np.abs(_net_um(case, table))))
        own = case.controller.limits(table, case.profile).value_um
        limit = min(limits.value_um, _most(own))
        if largest > limit:
            yield error("value-large.limit", label=table.label, um=largest, limit_um=limit)
        elif largest > limits.warn_value_um:
            yield warning(
                "value-large", label=table.label, um=largest, limit_um=limits.warn_value_um
            )


def check_change(case: Case) -> Iterator[Finding]:
    """Check 3: change from the previous tables of the same function. The module `standing` checks
    all other old tables.

    Tables of zeros are no previous tables: only check 2 applies to the first compensation of a
    machine.
    """
    for table in case.tables:
        before = [
            old for old in case.previous if old.name == table.name and np.any(old.value_um)
        ]
        if not before or not np.any(table.value_um):
            continue
        new = [each for each in case.tables if each.name == table.name]
        change = float(np.max(np.abs(movement_um(table, new) - movement_um(table, before))))
        if change > case.profile.limits.at(_travel_mm(table)).change_um:
            yield warning("change-large", label=table.label, um=change)


def check_slope(case: Case) -> Iterator[Finding]:
    """Check 4: change of the correction per mm; and the change from point to point, if the control
    limits this change.
    """
    for table in case.tables:
        own = case.controller.limits(table, case.profile)
        spacing = np.diff(table.position_mm)
        steps = np.abs(np.diff(table.absolute_um))
        steepest = float(np.max(np.abs(np.diff(_net_um(case, table))) / spacing))
        most = case.profile.limits.slope_um_mm or own.slope_um_mm
        if most == "plausible":
            most = plausible_slope_um_mm(_measured_mm(case.result, table))
        if most is not None and steepest > most:
            yield warning(
                "slope-steep", label=table.label, slope_um_mm=steepest, limit_um_mm=most
            )
        allowed = np.minimum(_most(own.neighbour_um), _most(own.neighbour_um_mm) * spacing)
        if np.any(steps > allowed + _ZERO_UM):
            yield error(
                "slope-steep.neighbour",
                label=table.label,
                um=np.max(steps),
                limit_um=np.min(allowed),
            )


def check_points(case: Case) -> Iterator[Finding]:
    """Check 5: number of points of a table, and number of tables of a kind."""
    for kind in sorted({table.kind for table in case.tables}):
        of_kind = [table for table in case.tables if table.kind == kind]
        held = case.controller.limits(of_kind[0], case.profile).tables
        numbers = [table.place.get("table") for table in of_kind]
        last = max([len(of_kind) - 1, *(each for each in numbers if isinstance(each, int))])
        if held is not None and last >= held:
            yield error(
                "control-full.tables", count=len(of_kind), kind=kind, number=last, held=held
            )
    for table in case.tables:
        own = case.controller.limits(table, case.profile).points
        limits = [each for each in (own, case.profile.limits.points) if each is not None]
        count = len(table.position_mm)
        if limits and count > min(limits):
            yield error(
                "control-full.points", label=table.label, count=count, held=min(limits)
            )


def check_reference(case: Case) -> Iterator[Finding]:
    """Check 6: zero at the reference position; otherwise the axis jumps when the table becomes
    active.
    """
    for table in case.tables:
        if (
            table.law.ends == "extended"
            or table.direction < 0
            or table.multiplier is not None
        ):
            continue  # a product is zero where its lever, which is another axis, is zero
        at_reference = abs(
            correction_um(table, np.array([table.reference_mm]), table.direction or 1).item()
        )
        wanted = case.controller.limits(table, case.profile).reference_um
        if at_reference > abs(wanted) + table.quantum_um / 2 + _ZERO_UM:
            yield error(
                "reference-unfit.value",
                label=table.label,
                um=at_reference,
                place_mm=table.reference_mm,
            )


def check_travel(case: Case) -> Iterator[Finding]:
    """Check 7: the table covers the travel of its axis; otherwise the end values act beyond the
    table.
    """
    for table in case.tables:
        travel = case.profile.axis(table.input_axis).travel_mm
        if travel is None or table.law.ends == "extended" or not table.absolute_um.any():
            continue  # for an old table that is emptied no values remain
        first, last = table.position_mm[[0, -1]]
        if first > travel[0] + _ZERO_UM or last < travel[1] - _ZERO_UM:
            low, high = table.absolute_um[[0, -1]]
            yield warning(
                "travel-not-covered",
                label=table.label,
                first_mm=first,
                last_mm=last,
                from_mm=travel[0],
                to_mm=travel[1],
                low_um=low,
                high_um=high,
            )


def check_units(case: Case) -> Iterator[Finding]:
    """Check 8: the control works in mm."""
    if case.profile.machine.units != "mm" and case.controller.name in _METRIC_ONLY:
        yield error(
            "units-not-metric",
            control=case.controller.title,
            units=case.profile.machine.units,
        )


def check_axes(case: Case) -> Iterator[Finding]:
    """Check 9: two axes do not have the same name."""
    names = [axis.name for axis in case.profile.axes.values()]
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield error("profile-incomplete.name", source=case.profile.source, name=name)


def check_reversal(case: Case) -> Iterator[Finding]:
    """Check 12: tables and backlash parameter do not correct the reversal error twice."""
    letters = {
        table.input_axis
        for table in case.tables
        if table.direction
        and table.input_axis == table.output_axis
        and not case.controller.limits(table, case.profile).ends_backlash
    }
    for letter in sorted(letters):
        axis = case.profile.axis(letter)
        label = f"{letter} ({axis.name})"
        if axis.backlash_um is None:
            yield warning("profile-incomplete.reversal", axis_label=label)
        elif axis.backlash_um != 0:
            yield error("direction-unfit.twice", axis=label, um=axis.backlash_um)


def check_quality(case: Case) -> Iterator[Finding]:
    """Check 13: the solver's findings about the data, and the size of the correction relative to
    repeatability and uncertainty.
    """
    for each in case.result.findings:
        if each.severity == "error":
            yield error("data-quality", code=each.code, what=each.words)
    largest = max(
        (float(np.max(np.abs(table.absolute_um))) for table in case.tables), default=0.0
    )
    spreads = {
        name: report.repeatability_um or 0.0 for name, report in case.result.setups.items()
    }
    worst = max(spreads, key=lambda name: spreads[name], default="")
    if worst and spreads[worst] > largest / 2:
        yield warning(
            "correction-small.repeatability",
            setup=worst,
            um=spreads[worst],
            largest_um=largest,
        )
    uncertain = [curve for curve in case.curves if np.isfinite(curve.u_um).any()]
    if uncertain and all(
        np.max(np.abs(curve.mean_um)) < 2 * np.nanmax(curve.u_um) for curve in uncertain
    ):
        yield warning("correction-small.uncertainty")


def check_sign(case: Case) -> Iterator[Finding]:
    """Check 14: no sign test contradicts the sense of a table. Without a sign test, the file names
    carry a warning instead.
    """
    for kind, sense in sorted({(table.kind, table.law.sense) for table in case.tables}):
        for record in case.profile.sign_tests:
            if record.kind == kind and record.verdict != sense:
                yield error(
                    "sign-contradicted",
                    kind=kind,
                    date=record.date.isoformat(),
                    verdict=record.verdict,
                    sense=sense,
                )


CHECKS: tuple[Check, ...] = (
    check_values,
    check_change,
    check_slope,
    check_points,
    check_reference,
    check_travel,
    check_units,
    check_axes,
    check_reversal,
    check_quality,
    check_sign,
)


def run_checks(case: Case, checks: Sequence[Check] = CHECKS) -> tuple[Finding, ...]:
    """Return every error and every warning. If `check_finite` has findings, only these findings are
    returned.
    """
    broken = tuple(check_finite(case))
    return broken or tuple(one for check in checks for one in check(case))


LIMITS: tuple[Check, ...] = (check_values, check_slope, check_points, check_units)
"""Checks that need only a control, a profile and a result. These checks also apply to tables that
no export has made.
"""


def refuse(findings: Collection[Finding], accept: Collection[str], where: Words) -> None:
    """Raise ``SafetyError`` with the key of the first error, or of the first warning that is not
    accepted.
    """
    refusing = [
        item
        for item in findings
        if item.severity == "error"
        or (item.severity == "warning" and not item.is_accepted(accept))
    ]
    if not refusing:
        return
    first, *rest = sorted(refusing, key=lambda item: item.severity != "error")
    others = [message("with-its-code", what=item.words, code=item.key) for item in rest]
    remedy = (
        message("mend-cause")
        if first.severity == "error"
        else message("mend-or-accept", code=first.key)
    )
    raise SafetyError(
        where,
        code=first.key,
        expected=message("safe-tables"),
        found=first.words,
        remedy=message("also-refused", remedy=remedy, others=others) if others else remedy,
    )


def untested_kinds(case: Case) -> tuple[str, ...]:
    """Return the kinds of table without a sign test of this machine, control and measuring system
    in the twelve months before today.

    Neutral curves need no sign test.
    """
    if case.controller.name == curves_csv.NAME:
        return ()
    about = subject(case.controller.name, case.profile)
    tested = {
        record.kind
        for record in case.profile.sign_tests
        if about.covers(record) and 0 <= (case.today - record.date).days <= SIGN_TEST_DAYS
    }
    return tuple(sorted({table.kind for table in case.tables} - tested))


def movement_um(grid_of: Table, tables: Sequence[Table]) -> Vector:
    return summed_um(tables, grid_of.position_mm, grid_of.direction or 1)


def _travel_mm(table: Table) -> float:
    """Return the travel over which the errors of a table grow: the travel of its own axis, or of
    the lever of its angle.
    """
    lever_mm = 0.0 if table.multiplier is None else np.ptp(table.multiplier.position_mm)
    return float(max(np.ptp(table.position_mm), lever_mm))


def _measured_mm(result: Result, table: Table) -> float:
    function = result.errors.get(table.name)
    if function is not None and len(function.position_mm) > 1:
        return float(np.min(np.diff(function.position_mm)))
    return (
        result.volume.size_mm[AXES.index(table.input_axis.lower())] / result.volume.increments
    )


def _most(limit: float | None) -> float:
    return np.inf if limit is None else limit


def _net_um(case: Case, table: Table) -> Vector:
    """Return the correction at the points of a table plus the correction by the angles of the same
    axis, whose levers count from the zero of the axes.

    Far from this zero, the table and the effect of its angles are large and nearly cancel each
    other. The result is the mean of their sum over the volume, relative to the reference.
    """
    turns = [
        each
        for each in case.tables
        if each.multiplier is not None
        and each.multiplier.ends == "extended"
        and acts_with(each, table)
    ]
    if table.multiplier is not None or not turns:
        return table.absolute_um
    together = [*turns, *(each for each in case.tables if each.name == table.name)]
    moving = TableCase(table=table, together=together, before=(), volume=case.result.volume)
    at = np.append(table.position_mm, table.reference_mm)
    moved = moving.sum_um(together, at)
    return np.asarray(moved[:-1] - moved[-1])
