"""Readings that contradict each other beyond everything that is usually wrong: what is most probably at fault.

Chi-square is held against its expectation: noise, repeatability, drift and wander as usual, and angular functions as large as the
closure of the readings says are in its weights, so that it is the degrees of freedom.
Three times that is no machine but a mistake: it must not be exported before somebody has looked.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.adjustment.diagnostics import NOISE_LIMIT_UM
from stepdiag.solver.findings import Finding
from stepdiag.solver.linear.fit import fit

FAR = 10.0
"""So many times the usual limit stops an export."""
REFUSED = 3.0
"""So many times the expectation of chi-square stops it, after every hypothesis has been looked at (`solver.adjustment.robustness`)."""
AS_LITTLE = 2.0
"""Passes without which chi-square for a degree of freedom differs by less than this factor are not told from each other."""
ONE_STOP = 0.5
"""A stop that makes so much of its pass's contradiction is at fault itself."""


def contradictions(found: Adjustment, reports: dict[str, dict[str, Any]]) -> list[Finding]:
    """Return an error for each contradiction that is far beyond what is usual, with the setup, pass and stop most probably at fault."""
    return _chi_square(found) or [each for name, report in reports.items() for each in _of_setup(name, report)]


def _chi_square(found: Adjustment) -> list[Finding]:
    chi_square, expected = found.chi_square, float(found.fit.freedom)
    if found.fit.freedom < 1 or chi_square <= REFUSED * expected:
        return []
    passes = _most_probable(found)
    setup, number, stop = _place(found, passes[0])
    among: tuple[str, ...] = ()
    if len(passes) > 1:
        place = " or ".join(f"pass {key.number} of {key.setup}" for key in (found.layout.passes[index] for index in passes))
        words = f"{place}: one of them is most probably at fault, the data do not say which: drive them again"
        setup, number, stop = "", None, None
        among = tuple(found.layout.passes[index].place for index in passes)
    else:
        place = f"pass {number} of {setup}" if stop is None else f"stop {stop} of pass {number} of {setup}"
        words = f"{place} is most probably at fault: drive it again"
    text = (
        f"the readings contradict each other {chi_square / expected:.3g} times more than noise, drift and angular errors explain "
        f"(chi-square {chi_square:.4g}, {expected:.4g} expected); {words}"
    )
    return [Finding(code="chi-square-far", severity="error", text=text, setup=setup, pass_number=number, stop=stop, among=among)]


def _most_probable(found: Adjustment) -> list[int]:
    """Return the pass without which the others contradict each other least, and those without which they hardly do more."""
    layout = found.layout
    left = np.array([_without(found, layout.pass_index == index) for index in range(len(layout.passes))])
    order = np.argsort(left, kind="stable")
    limit = max(AS_LITTLE * float(left[order[0]]), 1.0)
    return [int(index) for index in order if left[index] <= limit]


def _place(found: Adjustment, worst: int) -> tuple[str, int | None, int | None]:
    """Return setup and number of a pass, and its stop where one stands out."""
    layout = found.layout
    mine = np.flatnonzero(layout.pass_index == worst)
    squares = found.fit.weight[mine] * found.residual_um[mine] ** 2
    stands_out = np.max(squares) > ONE_STOP * np.sum(squares)
    key = layout.passes[worst]
    return key.setup, key.number, int(layout.stop[mine[np.argmax(squares)]]) if stands_out else None


def _without(found: Adjustment, rows: NDArray[np.bool_]) -> float:
    """Return chi-square for each degree of freedom of the adjustment without some readings."""
    before = found.fit.fixed
    weight = before.weight.copy()
    weight[: len(rows)][rows] = 0.0
    after = fit(before.rows, found.design.blocks, before.target, weight)
    return after.chi_square / max(after.freedom, 1)


def _of_setup(name: str, report: dict[str, Any]) -> list[Finding]:
    findings = []
    for key, what in (("noise_um", "a single reading is uncertain by"), ("repeatability_um", "a stop repeats only to")):
        if (report[key] or 0.0) > FAR * NOISE_LIMIT_UM:
            text = f"setup {name}: {what} {report[key]:.3g} um, {FAR:g} times what is usual: find the cause, drive it again"
            findings.append(Finding(code="noise-far", severity="error", text=text, setup=name))
    return findings
