"""What a result says about the 4-DOF head's straightness: its figures by the three reference lines, and whether the diagonals agree."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.adjustment.diagnostics import chi_square_limit
from stepdiag.solver.findings import Finding
from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.standards.straightness import LineMethod, residuals_um, straightness_um

_LINES: dict[str, LineMethod] = {
    "end_point_um": "end-point",
    "least_squares_um": "least-squares",
    "minimum_zone_um": "minimum-zone",
}
LEAST_FREEDOM = 2.0
"""Where the diagonals and other passes check less than two of the head's values, nothing is said about agreement."""


def head_report(found: Adjustment, measured: Sequence[MeasuredStraightness]) -> dict[str, dict[str, Any]]:
    """Return for each function the head measured: passes, straightness by each line, its uncertainty, and how it fits the readings.

    ``residual_um`` is the rms of the head's values against the adjusted function; ``misclosure`` their weighted square sum over
    what chance allows (its 99.9 % point): above 1 the head and the diagonals contradict each other.
    """
    rows = _rows(found, measured)
    names = dict.fromkeys(one.name for one in measured)
    return {name: _of_function([(one, rows[index]) for index, one in enumerate(measured) if one.name == name], found) for name in names}


def _rows(found: Adjustment, measured: Sequence[MeasuredStraightness]) -> list[NDArray[np.int64]]:
    """Return the rows of the fit that belong to each pass: they follow the readings."""
    edges = len(found.layout) + np.concatenate([[0], np.cumsum([len(one.position_mm) for one in measured])])
    return [np.arange(edges[index], edges[index + 1]) for index in range(len(measured))]


def _of_function(passes: Sequence[tuple[MeasuredStraightness, NDArray[np.int64]]], found: Adjustment) -> dict[str, Any]:
    position = np.concatenate([one.position_mm for one, _ in passes])
    value = np.concatenate([residuals_um(one.position_mm, one.value_um) for one, _ in passes])
    rows = np.concatenate([mine for _, mine in passes])
    at, mean = _mean(position, value)
    usual = found.as_usual()
    residual, weight = usual.residual[rows], usual.weight[rows]
    freedom = float(np.sum(usual.redundancy[rows]))
    excess = float(np.sum(weight * residual**2)) / chi_square_limit(max(round(freedom), 1)) if freedom >= LEAST_FREEDOM else None
    return {
        "passes": len(passes),
        **{key: straightness_um(at, mean, line) for key, line in _LINES.items()},
        "u_um": float(np.sqrt(np.mean(np.concatenate([one.u_um for one, _ in passes]) ** 2) / len(passes))),
        "residual_um": float(np.sqrt(np.mean(residual**2))),
        "misclosure": excess,
    }


def _mean(position: Vector, value: Vector) -> tuple[Vector, Vector]:
    at, place = np.unique(position, return_inverse=True)
    return at, np.bincount(place, weights=value) / np.bincount(place)


def head_findings(report: dict[str, dict[str, Any]]) -> list[Finding]:
    """Return the finding on functions that head and diagonals see differently."""
    bad = [name for name, facts in report.items() if facts["misclosure"] is not None and facts["misclosure"] > 1.0]
    if not bad:
        return []
    worst = max(report[name]["residual_um"] for name in bad)
    text = (
        f"{', '.join(bad)}: the 4-DOF head and the diagonals differ by more than their uncertainties (rms {worst:.2g} um): a roll that is "
        "not known, air that bends the head's beam, or a wrong sign of the head; the result holds the weighted mean, uncertainties enlarged"
    )
    return [Finding(code="straightness-misclosure", severity="warning", text=text)]
