"""Scatter far beyond any machine's: that is no machine but a mistake, and it must not be exported before its cause is found."""

from collections.abc import Mapping

from stepdiag.base.findings import Finding
from stepdiag.solver.adjustment.diagnostics import NOISE_LIMIT_UM
from stepdiag.solver.adjustment.scatter import Scatter
from stepdiag.solver.result.members import SetupReport

FAR = 10.0
"""So many times the usual limit stops an export."""
REPEATS_UM = 5.0
"""Repeatability of an approach, three times that of a worn machine: it is a mirror, a beam or a pass that moved."""


def contradictions(reports: Mapping[str, SetupReport], scatter: Scatter) -> list[Finding]:
    """Return an error for each setup, and for the machine, whose scatter is far beyond what is usual."""
    return [*_of_machine(scatter), *(each for name, report in reports.items() for each in _of_setup(name, report))]


def _of_machine(scatter: Scatter) -> list[Finding]:
    if scatter.repeatability_um <= REPEATS_UM:
        return []
    text = (
        f"this machine repeats only to {scatter.repeatability_um:.3g} um, as no machine does: a mirror or a beam moved; "
        "drive the survey again"
    )
    return [Finding(code="noise-far", severity="error", text=text)]


def _of_setup(name: str, report: SetupReport) -> list[Finding]:
    findings = []
    for size, what in ((report.noise_um, "a single reading is uncertain by"), (report.repeatability_um, "a stop repeats only to")):
        if size is not None and size > FAR * NOISE_LIMIT_UM:
            text = f"setup {name}: {what} {size:.3g} um, {FAR:g} times what is usual: find the cause, drive it again"
            findings.append(Finding(code="noise-far", severity="error", text=text, setup=name))
    return findings
