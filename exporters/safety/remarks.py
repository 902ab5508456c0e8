"""What has to be said about an export and never refuses it: assumptions, preconditions, what is missing."""

from collections.abc import Iterator

import numpy as np

from stepdiag.exporters.safety.checks import Case, untested_kinds
from stepdiag.exporters.tables.curves import POSITIONING
from stepdiag.solver.findings import Finding

_COARSE_UM = 0.5
"""What a wide table may leave before it is said: about the uncertainty of a good survey."""


def remarks(case: Case) -> tuple[Finding, ...]:
    """Return the remarks for the report and the terminal."""
    makers = (_assumptions, _shape_only, _sign, _coarse, _ends, _state, _reversal, _runs, _data)
    return tuple(finding for maker in makers for finding in maker(case))


def _assumptions(case: Case) -> Iterator[Finding]:
    if not case.profile.assumed:
        return
    axes = ", ".join(f"{letter} = {axis.name} with its reference at {axis.reference_mm:g} mm" for letter, axis in case.profile.axes.items())
    yield _note(
        "profile-assumed", f"no profile: assumed {axes}; first measuring system; compensation was off while measuring; lengths in mm"
    )


def _shape_only(case: Case) -> Iterator[Finding]:
    names = [curve.name for curve in case.curves if not curve.slope_known]
    if names:
        text = (
            f"{', '.join(names)}: ONLY THE SHAPE is in the tables. The scale of these axes was not identified (four diagonals cannot "
            "separate the three scales); measure one linear run along two axes to have it"
        )
        yield Finding(code="shape-only", severity="warning", text=text)


def _sign(case: Case) -> Iterator[Finding]:
    kinds = untested_kinds(case)
    if kinds:
        text = f"no sign test within 12 months for {', '.join(kinds)}: the files are named _UNTESTED_SIGN; make the sign test first"
        yield Finding(code="sign-untested", severity="warning", text=text)


def _coarse(case: Case) -> Iterator[Finding]:
    """Say what tables leave whose points lie wider apart than the measured positions."""
    written = {table.name for table in case.tables}
    left = []
    for curve in case.curves:
        grid = case.profile.grid_mm(curve.input_axis)
        missed = np.abs(curve.mean_um - np.interp(curve.position_mm, grid, curve.at(grid)))
        inside = (curve.position_mm >= grid[0]) & (curve.position_mm <= grid[-1])
        worst_um = float(np.max(missed[inside], initial=0.0))
        if curve.name in written and np.diff(grid).max() > 1.001 * np.diff(curve.position_mm).max() and worst_um >= _COARSE_UM:
            left.append(f"{curve.name} {worst_um:.1f} um")
    if left:
        text = f"the points of these tables lie wider apart than the measured positions, which leaves up to: {', '.join(left)}"
        yield _note("step-coarse", text + "; take a smaller step")


def _ends(case: Case) -> Iterator[Finding]:
    for table in case.tables:
        if table.law.ends == "held" and np.any(np.abs(table.absolute_um[[0, -1]]) > table.quantum_um / 2):
            low, high = table.absolute_um[[0, -1]] + 0.0
            first, last = table.position_mm[[0, -1]]
            text = f"{table.label}: {low:.2f} um below {first:g} mm and {high:.2f} um above {last:g} mm are held"
            yield _note("ends-held", text)


def _state(case: Case) -> Iterator[Finding]:
    yield _note("reference-axes-first", "reference (home) every axis before the tables are switched on, and again after the restart")
    if not case.profile.existing:
        yield _note(
            "restore-is-zero",
            "no table of the control was given: the restore files take the new tables out, they bring nothing of before back",
        )


def _reversal(case: Case) -> Iterator[Finding]:
    """Offer the backlash number with its U, or say that there is none; and say where a table for each direction would hold chance only."""
    numbers = case.result.extra.get("backlash")
    for curve in case.curves:
        if curve.name not in POSITIONING:
            continue
        number = numbers.get(curve.input_axis) if isinstance(numbers, dict) else None
        if isinstance(number, dict) and curve.reverse_um is not None and case.profile.machine.direction == "mean":
            text = f"{curve.name}: the table holds the mean of both directions; backlash {-number['value']:.2f} um (in - minus in +), "
            yield _note("reversal-value", text + f"U {2 * number['u']:.2f} um (k = 2): for the backlash parameter")
        elif curve.reverse_um is None and case.profile.machine.direction == "both":
            text = (
                f"{curve.name}: no significant reversal, or passes that share no zero of the count: the mean of both directions is written"
            )
            yield _note("reversal-insignificant", text)


def _runs(case: Case) -> Iterator[Finding]:
    single = [name for name, report in case.result.setups.items() if report.get("passes") in (1, [1])]
    if single:
        yield _note("single-run", f"{', '.join(single)}: driven once only: nothing is known about the repeatability")


def _data(case: Case) -> Iterator[Finding]:
    for finding in case.result.findings:
        if finding.severity == "warning":
            yield _note("data-remark", f"the result says {finding.code}: {finding.text}")


def _note(code: str, text: str) -> Finding:
    return Finding(code=code, severity="info", text=text)
