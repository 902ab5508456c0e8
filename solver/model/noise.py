"""The noise of the readings: the stated value, else the value from the residuals, else an
assumed value with a finding."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, warning
from stepdiag.solver.linear.mixed import AnyFit

ASSUMED_U_UM = 0.3
"""Assumed standard uncertainty of a reading: usual for a single-aperture laser in a quiet hall."""
LEAST_U_UM = 1e-3
"""Smallest standard uncertainty of a reading, so that simulated readings without noise have a
finite weight."""
LEAST_FREEDOM = 4.0
"""Smallest number of degrees of freedom from which noise is computed."""
CHECKED = 0.01
"""Smallest redundancy of a reading from which noise is computed."""


def variance_scale(fit: AnyFit, rows: NDArray[np.int64]) -> float | None:
    """Return the ratio of the noise of some rows to the noise assumed in their weights (variance
    components), or None if these rows have too few degrees of freedom."""
    used = rows[fit.weight[rows] > 0]
    freedom = float(np.sum(fit.redundancy_of(used)))
    if freedom < LEAST_FREEDOM:
        return None
    return float(np.sqrt(np.sum(fit.weight[used] * fit.residual[used] ** 2) / freedom))


def assumed_noise(setups: Iterable[str]) -> tuple[Finding, ...]:
    names = list(setups)
    return (warning("noise-assumed.of", setups=names, u_um=ASSUMED_U_UM),) if names else ()
