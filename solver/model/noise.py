"""Noise of the readings: as stated stop by stop, else from the residuals, else assumed, with a
finding.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, warning
from stepdiag.solver.linear.mixed import AnyFit

ASSUMED_U_UM = 0.3
"""A single-aperture laser on a machine in a quiet hall, if neither the readings nor their
redundancy give the noise.
"""
LEAST_U_UM = 1e-3
"""Smallest noise of a reading: simulated readings without noise must not have an infinite
weight.
"""
LEAST_FREEDOM = 4.0
"""Degrees of freedom below which the residuals do not measure the noise."""
CHECKED = 0.01
"""Redundancy below which residuals give no noise."""


def variance_scale(fit: AnyFit, rows: NDArray[np.int64]) -> float | None:
    """Return the noise of some rows relative to their weights (variance components); None without
    evidence.
    """
    used = rows[fit.weight[rows] > 0]
    freedom = float(np.sum(fit.redundancy_of(used)))
    if freedom < LEAST_FREEDOM:
        return None
    return float(np.sqrt(np.sum(fit.weight[used] * fit.residual[used] ** 2) / freedom))


def assumed_noise(setups: Iterable[str]) -> tuple[Finding, ...]:
    """Return the finding for setups whose noise had to be assumed."""
    names = list(setups)
    return (warning("noise-assumed.of", setups=names, u_um=ASSUMED_U_UM),) if names else ()
