"""Scatter far beyond any machine's: a mistake, not to be exported before its cause is found."""

from collections.abc import Mapping

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Place, message
from stepdiag.base.result.members import SetupReport
from stepdiag.solver.adjustment.diagnostics import NOISE_LIMIT_UM
from stepdiag.solver.adjustment.scatter import Scatter

FAR = 10.0
"""So many times the usual limit stops an export."""
REPEATS_UM = 5.0
"""Repeatability of an approach, three times that of a worn machine: beyond it a mirror, a beam or a
pass has moved.
"""


def contradictions(reports: Mapping[str, SetupReport], scatter: Scatter) -> list[Finding]:
    """Return an error for each setup, and for the machine, whose scatter is far beyond what is usual."""
    return [*_of_machine(scatter), *(each for name, report in reports.items() for each in _of_setup(name, report))]


def _of_machine(scatter: Scatter) -> list[Finding]:
    if scatter.repeatability_um <= REPEATS_UM:
        return []
    return [finding("error", message("noise-high.machine", repeatability_um=scatter.repeatability_um))]


def _of_setup(name: str, report: SetupReport) -> list[Finding]:
    noise_um, repeats_um = report.noise_um or 0.0, report.repeatability_um or 0.0
    messages = []
    if noise_um > FAR * NOISE_LIMIT_UM:
        messages.append(message("noise-high.reading", setup=name, u_um=noise_um, times=FAR))
    if repeats_um > FAR * NOISE_LIMIT_UM:
        messages.append(message("noise-high.stop", setup=name, u_um=repeats_um, times=FAR))
    return [finding("error", words, Place(setup=name)) for words in messages]
