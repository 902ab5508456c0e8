"""Wrong stops: found by their residuals, named, and left out or down-weighted.

One pass of each diagonal checks every stop once or not at all, and two stops of different diagonals may share that one check: then the
residuals alone cannot tell which of them is wrong. Smoothness decides where it is decisive (a guideway does not jump at one stop and
back), otherwise both stops lose the weight that the contradiction costs.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.findings import Finding
from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.model.design import Columns
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import CHECKED, robust_scale

CRITICAL = 4.2
"""A residual this many standard deviations off is no chance: once in three hundred surveys of 125 stops."""
LEAST_ERROR_UM = 0.5
"""Contradictions below this are not called wrong stops however small the noise."""
SAME_CHECK = 12.0
"""Two stops explain a contradiction equally well if their test statistics differ by less than this (chi-square, p < 0.001)."""
DECISIVE = 20.0
MOST = 0.05
"""With more wrong stops than this share, single stops are not the trouble."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Suspicion:
    """A contradiction: the rows that may be wrong, each by ``error_um`` if it is the one; one row where that is decided."""

    rows: NDArray[np.int64]
    error_um: Vector


def most_suspicious(fit: MixedFit, columns: Columns, count: int) -> Suspicion | None:
    """Return the worst contradiction among the first ``count`` rows, None where all readings agree within their noise."""
    rows = np.flatnonzero((fit.redundancy[:count] > CHECKED) & (fit.weight[:count] > 0))
    scale = max(robust_scale(fit, rows) or 1.0, 1.0)
    if not len(rows):
        return None
    error = fit.residual[rows] / fit.redundancy[rows]
    statistic = np.abs(fit.residual[rows]) * np.sqrt(fit.weight[rows] / fit.redundancy[rows]) / scale
    statistic = np.where(np.abs(error) < LEAST_ERROR_UM, 0.0, statistic)
    worst = float(np.max(statistic))
    if worst < CRITICAL:
        return None
    equal = worst**2 - statistic**2 < SAME_CHECK
    chosen, size = rows[equal], error[equal]
    order = np.argsort(-statistic[equal], kind="stable")
    return _smoothest(fit, columns, Suspicion(rows=chosen[order], error_um=size[order]))


def _smoothest(fit: MixedFit, columns: Columns, suspicion: Suspicion) -> Suspicion:
    """Return the one stop without which the machine is decisively smoother than without any other, else all of them."""
    if len(suspicion.rows) == 1 or columns.nodes < 3:
        return suspicion
    without = fit.unknowns[:, None] - fit.moved_by(suspicion.rows) * suspicion.error_um
    bends = np.vstack([_second_differences(columns, axis, component, without) for axis in range(3) for component in range(3)])
    rough = np.sum(bends**2, axis=0)
    best, second = np.argsort(rough, kind="stable")[:2]
    if rough[second] - rough[best] < DECISIVE * rough[best] / len(bends):
        return suspicion
    return Suspicion(rows=suspicion.rows[[best]], error_um=suspicion.error_um[[best]])


def _second_differences(columns: Columns, axis: int, component: int, unknowns: Vector) -> Vector:
    values = np.vstack([np.zeros((1, unknowns.shape[1])), unknowns[columns.of(0, axis, component)]])
    bends: Vector = np.diff(values, n=2, axis=0)
    return bends


def weight_without(weight: Vector, suspicion: Suspicion) -> Vector:
    """Return the weights with the one wrong row left out, or with every possible one as uncertain as the contradiction is large."""
    lowered = weight.copy()
    if len(suspicion.rows) == 1:
        lowered[suspicion.rows] = 0.0
    else:
        lowered[suspicion.rows] = 1.0 / (1.0 / weight[suspicion.rows] + suspicion.error_um**2)
    return lowered


def name_suspicion(layout: Layout, suspicion: Suspicion) -> Finding:
    """Return the finding that names the stops."""
    stops = [f"{layout.place(int(row))} ({error:+.3g} um)" for row, error in zip(suspicion.rows, suspicion.error_um, strict=True)]
    if len(stops) == 1:
        text = f"{stops[0]} contradicts the other readings and is left out; repeat the pass if its neighbours matter"
        return Finding(code="stop-outlier", severity="warning", text=text)
    text = f"one of these stops is wrong, the data do not say which, and all count little: {', '.join(stops)}; repeat one of these passes"
    return Finding(code="stop-outlier-ambiguous", severity="warning", text=text)


def name_excess(count: int) -> Finding:
    """Return the finding for more contradictions than single wrong stops explain."""
    text = (
        f"more than {count} stops contradict the others: the machine or the beam moved, or angular errors are large; "
        "look at the closure residual, give the angles, or measure again"
    )
    return Finding(code="too-many-outliers", severity="error", text=text)
