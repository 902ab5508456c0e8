"""Noise of the readings: the value stated for each stop, else a value from the residuals, else an
assumed value with a finding.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, warning
from stepdiag.solver.linear.mixed import AnyFit

ASSUMED_U_UM = 0.3
"""Assumed noise of a reading, if neither the file nor the residuals give it: that of a
single-aperture laser on a machine in a quiet hall.
"""
LEAST_U_UM = 1e-3
"""Smallest noise of a reading: it keeps the weight of simulated readings without noise finite."""
LEAST_FREEDOM = 4.0
"""Degrees of freedom below which the residuals do not measure the noise."""
CHECKED = 0.01
"""Redundancy of a reading below which its residual gives no noise."""


def variance_scale(fit: AnyFit, rows: NDArray[np.int64]) -> float | None:
    """Return the ratio of the noise of some rows to the noise assumed in their weights (variance
    components); None if too few degrees of freedom show it.
    """
    used = rows[fit.weight[rows] > 0]
    freedom = float(np.sum(fit.redundancy_of(used)))
    if freedom < LEAST_FREEDOM:
        return None
    return float(np.sqrt(np.sum(fit.weight[used] * fit.residual[used] ** 2) / freedom))


def assumed_noise(setups: Iterable[str]) -> tuple[Finding, ...]:
    """Return the finding that names the setups with an assumed noise."""
    names = list(setups)
    return (warning("noise-assumed.of", setups=names, u_um=ASSUMED_U_UM),) if names else ()
