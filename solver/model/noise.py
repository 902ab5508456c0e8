"""How noisy the readings are: as stated stop by stop, else from the residuals, else assumed and said so."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.findings import Finding
from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.mixed import AnyFit
from stepdiag.solver.model.layout import Layout

ASSUMED_U_UM = 0.3
"""A single-aperture laser on a machine in a quiet hall, where neither the readings nor their redundancy tell."""
LEAST_U_UM = 1e-3
"""No reading is taken for better than this: simulated readings without noise must not make an infinite weight."""
LEAST_FREEDOM = 4.0
CHECKED = 0.01
"""Residuals with less redundancy than this say nothing about the noise."""


REPEATABILITY_SPREAD = 0.7
"""Standard deviation of the logarithm of the usual repeatability: known within a factor of four."""


def starting_u_um(layout: Layout, repeatability_um: float, reading_um: float = ASSUMED_U_UM) -> Vector:
    """Return the standard uncertainty of every reading, shape (m,): stated and repeatability, ``reading_um`` where none is stated."""
    known = np.isfinite(layout.u_um)
    floored: Vector = np.maximum(np.where(known, np.hypot(layout.u_um, repeatability_um), reading_um), LEAST_U_UM)
    return floored


def repeatability_factor(stated_um: Vector, repeatability_um: float, chi_square: float, freedom: int) -> float:
    """Return by how much the repeatability is larger than usual: most likely by chi-square, which counts with the usual one.

    ``stated_um`` are the readings' own uncertainties. The logarithm of the factor has a normal prior: where the readings tell
    nothing (``freedom`` 0) it is 1.
    """
    if repeatability_um <= 0.0 or freedom < 1 or not len(stated_um):
        return 1.0
    factor = np.exp(np.linspace(-5.0, 9.0, 701))
    share = float(np.mean(stated_um**2 / (stated_um**2 + repeatability_um**2)))
    noise = share + (1.0 - share) * factor**2
    likely = -0.5 * (freedom * np.log(noise) + chi_square / noise) - 0.5 * (np.log(factor) / REPEATABILITY_SPREAD) ** 2
    return float(factor[int(np.argmax(likely))])


def noise_classes(layout: Layout) -> dict[str, NDArray[np.int64]]:
    """Return the rows without a stated uncertainty: diagonals (flat mirror) and linear runs (retroreflector) apart."""
    linear = np.array([setup.kind == "linear" for setup in layout.setups])[layout.setup_index]
    unknown = ~np.isfinite(layout.u_um)
    classes = {"diagonals": np.flatnonzero(unknown & ~linear), "linear runs": np.flatnonzero(unknown & linear)}
    return {name: rows for name, rows in classes.items() if len(rows)}


def robust_scale(fit: AnyFit, rows: NDArray[np.int64]) -> float | None:
    """Return the noise of some rows relative to what their weights say, unmoved by single wrong stops; None where nothing tells."""
    checked = rows[(fit.redundancy[rows] > CHECKED) & (fit.weight[rows] > 0)]
    if float(np.sum(fit.redundancy[checked])) < LEAST_FREEDOM:
        return None
    normalised = fit.residual[checked] * np.sqrt(fit.weight[checked] / fit.redundancy[checked])
    return 1.4826 * float(np.quantile(np.abs(normalised), 0.5))


def variance_scale(fit: AnyFit, rows: NDArray[np.int64]) -> float | None:
    """Return the noise of some rows relative to what their weights say (variance components); None where nothing tells."""
    used = rows[fit.weight[rows] > 0]
    freedom = float(np.sum(fit.redundancy_of(used)))
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
