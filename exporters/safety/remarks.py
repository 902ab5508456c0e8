"""Findings about an export that never refuse it: assumptions, preconditions, and missing parts."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag.base.findings import Finding, info, warning
from stepdiag.base.messages import Message, message
from stepdiag.base.result.members import Backlash
from stepdiag.base.result.result import POSITIONING, Result
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.numbers import fixed
from stepdiag.exporters.safety.checks import Case, untested_kinds
from stepdiag.exporters.tables.curves import SIGNIFICANT
from stepdiag.exporters.tables.sampling import is_directional

_COARSE_UM = 0.5
"""Largest error of a table between its points, in um, that needs no report: about the uncertainty
of a good survey.
"""


def remarks(case: Case) -> tuple[Finding, ...]:
    makers = (
        _assumptions,
        _shape_only,
        _sign,
        _coarse,
        _ends,
        _state,
        _reversal,
        _runs,
        _data,
    )
    return tuple(one for maker in makers for one in maker(case))


def _assumptions(case: Case) -> Iterator[Finding]:
    if not case.profile.assumed:
        return
    axes = [
        message("axis-assumed", letter=letter, name=axis.name, reference_mm=axis.reference_mm)
        for letter, axis in case.profile.axes.items()
    ]
    yield info("profile-assumed", axes=axes)


def _shape_only(case: Case) -> Iterator[Finding]:
    names = [curve.name for curve in case.curves if not curve.slope_known]
    if names:
        yield warning("shape-only", names=names)


def _sign(case: Case) -> Iterator[Finding]:
    kinds = untested_kinds(case)
    if kinds:
        yield warning("sign-untested", kinds=kinds)


def _coarse(case: Case) -> Iterator[Finding]:
    written = {table.name for table in case.tables}
    left = {}
    for curve in (curve for curve in case.curves if curve.name in written):
        left[curve.name] = missed_um(
            case.profile.grid_mm(curve.input_axis), curve.position_mm, curve.mean_um
        )
    yield from coarse(message("these-tables"), left)


def missed_um(grid_mm: Vector, position_mm: Vector, value_um: Vector) -> float:
    """Return the largest difference between a value and the straight lines between the points of a
    grid, at the positions within the grid.
    """
    joined = np.interp(position_mm, grid_mm, np.interp(grid_mm, position_mm, value_um))
    inside = (position_mm >= grid_mm[0]) & (position_mm <= grid_mm[-1])
    return float(np.max(np.abs(value_um - joined)[inside], initial=0.0))


def coarse(whose: Message, missed: Mapping[str, float]) -> Iterator[Finding]:
    """Yield the remark about a table or lattice (``whose``) with a coarse grid: the straight lines
    between its points differ from the functions by more than the uncertainty of a survey.
    """
    left = [
        message("so-much-of", name=name, size_um=um)
        for name, um in missed.items()
        if um >= _COARSE_UM
    ]
    if left:
        yield info("step-coarse", whose=whose, left=left)


def _ends(case: Case) -> Iterator[Finding]:
    for table in case.tables:
        if table.law.ends == "held" and np.any(
            np.abs(table.absolute_um[[0, -1]]) > table.quantum_um / 2
        ):
            low, high = (fixed(um, 2) for um in table.absolute_um[[0, -1]])
            first, last = table.position_mm[[0, -1]]
            yield info(
                "travel-not-covered.held",
                label=table.label,
                low=low,
                first_mm=first,
                high=high,
                last_mm=last,
            )


def _state(case: Case) -> Iterator[Finding]:
    yield info("reference-axes-first")
    if not case.profile.existing:
        yield info("restore-is-zero")


def _reversal(case: Case) -> Iterator[Finding]:
    for curve in case.curves:
        if curve.name not in POSITIONING:
            continue
        own = [table for table in case.tables if table.name == curve.name]
        both = is_directional(curve, case.profile) and any(table.direction for table in own)
        if curve.reverse_um is not None and not both:
            ends = any(
                case.controller.limits(table, case.profile).ends_backlash for table in own
            )
            yield from backlash_offered(case.result, curve.input_axis, ends_backlash=ends)
        elif curve.reverse_um is None and case.profile.machine.direction == "both":
            yield info("direction-averaged.chance", name=curve.name)


def backlash_offered(
    result: Result, letter: str, *, ends_backlash: bool
) -> Iterator[Finding]:
    """Yield the backlash of an axis with its U, if the survey has a significant backlash.

    The control's backlash parameter was active during the measurement. The remark asks a person to
    add the measured backlash to the value of the parameter during the measurement. The present
    value is not used, because it may already contain the measured backlash. With ``ends_backlash``
    a table switches this parameter off, and the remark concerns the table instead.
    """
    number: Backlash | None = getattr(result.backlash, letter, None)
    if number is None or abs(number.value) <= SIGNIFICANT * number.u:
        return
    whither = message("backlash-into-table") if ends_backlash else message("backlash-to-add")
    value_um, expanded_um = -number.value, 2 * number.u
    yield info(
        "reversal-value",
        name=f"E{letter}{letter}",
        value_um=value_um,
        expanded_um=expanded_um,
        whither=whither,
    )


def _runs(case: Case) -> Iterator[Finding]:
    single = [name for name, report in case.result.setups.items() if report.passes == (1,)]
    if single:
        yield info("single-run", single=single)


def _data(case: Case) -> Iterator[Finding]:
    for each in case.result.findings:
        if each.severity == "warning":
            yield info("data-quality.remark", code=each.code, what=each.words)
