"""The figures of the standards for what a survey has driven: ISO 230-2 and ASME B5.54 along axes, ISO 230-6 along diagonals.

A readings file restarts at zero with every pass, which loses the reversal value: what needs both directions (B, R, A, and all of
VDI/DGQ 3441) is left out here; `solver.standards.iso230` has it for tables with one common zero.
"""

from dataclasses import fields
from typing import Any

import numpy as np

from stepdiag.solver.findings import Finding
from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.standards.iso230 import (
    COVERAGES,
    DiagonalFigures,
    PositioningFigures,
    PositioningRuns,
    arrange_runs,
    diagonal_figures,
    positioning_figures,
)

STEPS_A_CYCLE = {"step": 3, "body": 1}
"""Stops from one point of the diagonal to the next, for the kinds of setup that run along a body diagonal."""


def way_mm(layout: Layout, rows: np.ndarray[tuple[int, ...], np.dtype[np.intp]]) -> Vector:
    """Return the way along the setup's direction from the low end of the pass, shape (rows,)."""
    along: Vector = np.einsum("ij,ij->i", layout.position_mm[rows], layout.direction[rows])
    way: Vector = np.round(along - along.min(), 6)
    return way


def linear_runs(layout: Layout) -> dict[str, PositioningRuns]:
    """Return targets by runs of every run along an axis; readings restart with each pass, so only the outward runs count."""
    return {
        setup.name: _runs(layout, index, 1)[0] for index, setup in enumerate(layout.setups) if setup.kind == "linear" and setup.variant == 0
    }


def diagonals(layout: Layout) -> tuple[DiagonalFigures, tuple[Finding, ...]] | None:
    """Return the ISO 230-6 figures from the points that lie on the body diagonals, None where fewer than four were driven.

    At these points the mirror's lean has no first-order effect: it sums to zero over X + Y + Z (theory 4.2).
    """
    runs: dict[str, PositioningRuns] = {}
    findings: dict[str, Finding] = {}
    for index, setup in enumerate(layout.setups):
        if setup.kind in STEPS_A_CYCLE and setup.variant == 0:
            runs[setup.name], lost = _runs(layout, index, STEPS_A_CYCLE[setup.kind])
            findings |= {finding.code: finding for finding in lost}
    return (diagonal_figures(runs), tuple(findings.values())) if len(runs) >= 4 else None


def standards_report(layout: Layout) -> dict[str, Any]:
    """Return every figure as plain JSON, in um: by setup, by standard, with how well the standard's text is known."""
    report: dict[str, Any] = {}
    for name, runs in linear_runs(layout).items():
        report[name] = [_plain(positioning_figures(runs, standard)) for standard in COVERAGES]
    along = diagonals(layout)
    if along is not None:
        report["diagonals"] = [{name: value for name, value in _plain(along[0]).items() if name != "diagonals"}]
        report |= {name: [_plain(each)] for name, each in along[0].diagonals.items()}
    return report


def _runs(layout: Layout, index: int, cycle: int) -> tuple[PositioningRuns, tuple[Finding, ...]]:
    """Return the stops of a setup that lie on its line: every ``cycle``-th."""
    rows = np.flatnonzero(layout.setup_index == index)
    on_line = rows[layout.stop[rows] % cycle == 0]
    numbers = np.array([layout.passes[number].number for number in layout.pass_index[on_line]])
    return arrange_runs(way_mm(layout, on_line), numbers, layout.deviation_um[on_line], common_zero=False)


def _plain(figures: PositioningFigures | DiagonalFigures) -> dict[str, Any]:
    """Return the named numbers of figures; what the runs do not give is left out."""
    values = {field.name: getattr(figures, field.name) for field in fields(figures)}
    return {name: value for name, value in values.items() if isinstance(value, float | str)}
