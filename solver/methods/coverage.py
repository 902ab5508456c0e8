"""Coverage factors for 95 % if the noise is determined by few degrees of freedom (GUM G.4, Welch
and Satterthwaite)."""

from collections.abc import Mapping

import numpy as np

from stepdiag.base.findings import Finding, info
from stepdiag.base.result.members import CoverageFactor
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.model.quantities import Quantities

WORTH_SAYING = 2.1
_MOST = 1e6


def t_factor(freedom: float) -> float:
    """Return the factor for 95.45 % of Student's t, which is 2 for many degrees of freedom (GUM
    table G.2; exact to 2 % from three degrees on)."""
    z, v = 2.0, max(freedom, 1.0)
    first = (z**3 + z) / 4.0
    second = (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    third = (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0
    return z + first / v + second / v**2 + third / v**3


def coverage(
    found: Adjustment,
    quantities: Quantities,
    known: Mapping[str, bool],
    u: Vector,
    u_readings: Vector,
) -> dict[str, CoverageFactor]:
    """Return the effective degrees of freedom and k for 95 % of each quantity whose k is above
    `WORTH_SAYING`. The result is empty if all readings have a stated uncertainty."""
    if np.all(np.isfinite(found.layout.u_um)):
        return {}
    report = {}
    for name in (name for name in quantities.groups if known.get(name, True)):
        rows = quantities.of(name)
        combined, alone = (float(np.sum(each[rows] ** 2)) for each in (u, u_readings))
        freedom = (
            min(found.fit.freedom * (combined / alone) ** 2, _MOST) if alone > 0 else _MOST
        )
        if t_factor(freedom) > WORTH_SAYING:
            report[name] = CoverageFactor(degrees_of_freedom=freedom, k=t_factor(freedom))
    return report


def coverage_findings(report: Mapping[str, CoverageFactor]) -> list[Finding]:
    """Return the finding about the quantity with the largest coverage factor."""
    if not report:
        return []
    worst = max(report, key=lambda name: report[name].k)
    figures = report[worst]
    return [
        info(
            "coverage-factor",
            name=worst,
            factor=figures.k,
            freedom=figures.degrees_of_freedom,
        )
    ]
