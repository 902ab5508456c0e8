"""How noisy the readings are: as stated stop by stop, else from the residuals, else assumed and said so."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.findings import Finding
from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.fit import Fit
from stepdiag.solver.model.layout import Layout

ASSUMED_U_UM = 0.3
"""A single-aperture laser on a machine in a quiet hall, where neither the readings nor their redundancy tell."""
LEAST_U_UM = 1e-4
"""No reading is taken for better than this: simulated readings without noise must not make an infinite weight."""
LEAST_FREEDOM = 4.0
CHECKED = 0.01
"""Residuals with less redundancy than this say nothing about the noise."""


def starting_u_um(layout: Layout) -> Vector:
    """Return the stated standard uncertainty of every reading, `ASSUMED_U_UM` where none is stated, shape (m,)."""
    stated = np.where(np.isfinite(layout.u_um), layout.u_um, ASSUMED_U_UM)
    floored: Vector = np.maximum(stated, LEAST_U_UM)
    return floored


def noise_classes(layout: Layout) -> dict[str, NDArray[np.int64]]:
    """Return the rows without a stated uncertainty: diagonals (flat mirror) and linear runs (retroreflector) apart."""
    linear = np.array([setup.kind == "linear" for setup in layout.setups])[layout.setup_index]
    unknown = ~np.isfinite(layout.u_um)
    classes = {"diagonals": np.flatnonzero(unknown & ~linear), "linear runs": np.flatnonzero(unknown & linear)}
    return {name: rows for name, rows in classes.items() if len(rows)}


def robust_scale(fit: Fit, rows: NDArray[np.int64]) -> float | None:
    """Return the noise of some rows relative to what their weights say, unmoved by single wrong stops; None where nothing tells."""
    checked = rows[(fit.redundancy[rows] > CHECKED) & (fit.weight[rows] > 0)]
    if float(np.sum(fit.redundancy[checked])) < LEAST_FREEDOM:
        return None
    normalised = fit.residual[checked] * np.sqrt(fit.weight[checked] / fit.redundancy[checked])
    return 1.4826 * float(np.median(np.abs(normalised)))


def variance_scale(fit: Fit, rows: NDArray[np.int64]) -> float | None:
    """Return the noise of some rows relative to what their weights say (variance components); None where nothing tells."""
    used = rows[fit.weight[rows] > 0]
    freedom = float(np.sum(fit.redundancy[used]))
    if freedom < LEAST_FREEDOM:
        return None
    return float(np.sqrt(np.sum(fit.weight[used] * fit.residual[used] ** 2) / freedom))


def assumed_noise(unknown: Iterable[str]) -> tuple[Finding, ...]:
    """Return the finding for classes of readings whose noise had to be assumed."""
    names = " and ".join(unknown)
    if not names:
        return ()
    text = (
        f"the noise of the {names} is neither stated nor visible in the data: {ASSUMED_U_UM:g} um is assumed; state u_um or repeat passes"
    )
    return (Finding(code="noise-assumed", severity="warning", text=text),)
