"""The values of the standards for each setup: ISO 230-2, ASME B5.54 and VDI/DGQ 3441 along axes,
ISO 230-6 along diagonals.

Values that include the reversal (B, R, A, and all of VDI/DGQ 3441) require passes in both
directions with a common zero of the laser's count (contract 4, column ``zero``). Otherwise these
values are omitted, with a finding.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.findings import Finding
from stepdiag.base.result.members import StandardFigures
from stepdiag.base.setups import Kind
from stepdiag.base.volume import Vector
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.standards.iso230 import (
    COVERAGES,
    DiagonalFigures,
    PositioningFigures,
    PositioningRuns,
    VdiFigures,
    arrange_runs,
    diagonal_figures,
    positioning_figures,
    vdi_3441_figures,
)
from stepdiag.solver.standards.iso230_uncertainty import (
    SOURCE_STATUS,
    RunSources,
    expanded_um,
)

STEPS_A_CYCLE: dict[Kind, int] = {"step": 3, "body": 1}
"""Number of stops from one point of the diagonal to the next."""
DIAGONAL_STANDARD: dict[Kind, str] = {
    "body": "ISO 230-6:2002",
    "step": "as ISO 230-6:2002, on step diagonals (axes one after the other)",
}
DIAGONAL_ENTRY: dict[Kind, str] = {"body": "diagonals", "step": "step-diagonals"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SetupRuns:
    """The runs of one setup: deviations by target and run, the rows of the readings, and
    findings about omitted targets or runs."""

    setup: str
    rows: NDArray[np.int64]
    runs: PositioningRuns
    findings: tuple[Finding, ...]


def way_mm(layout: Layout, rows: np.ndarray[tuple[int, ...], np.dtype[np.intp]]) -> Vector:
    """Return the distance in mm of each stop from the lowest stop along the setup's direction,
    shape (rows,)."""
    along: Vector = np.einsum("ij,ij->i", layout.position_mm[rows], layout.direction[rows])
    way: Vector = np.round(along - along.min(), 6)
    return way


def linear_runs(layout: Layout) -> dict[str, SetupRuns]:
    """Return the runs of every setup along an axis."""
    found = {
        setup.name: _runs(layout, index, 1)
        for index, setup in enumerate(layout.setups)
        if setup.kind == "linear" and setup.shift == 0
    }
    return {name: runs for name, runs in found.items() if runs is not None}


def diagonals(
    layout: Layout, kind: Kind
) -> tuple[DiagonalFigures, dict[str, SetupRuns]] | None:
    """Return the values along the four diagonals of a kind (body, step) and the runs of each
    diagonal; None unless all four were driven.

    Only points on the diagonal are used: the first-order effect of a mirror tilt is zero there
    (theory 4.2). ISO 230-6 moves all axes together, so the name of the values of step diagonals
    states the difference (`DIAGONAL_STANDARD`).
    """
    found = {
        setup.name: _runs(layout, index, STEPS_A_CYCLE[kind])
        for index, setup in enumerate(layout.setups)
        if setup.kind == kind and setup.shift == 0
    }
    runs = {name: one for name, one in found.items() if one is not None}
    if len(runs) < 4:
        return None
    figures = diagonal_figures({name: one.runs for name, one in runs.items()})
    return replace(figures, standard=DIAGONAL_STANDARD[kind]), runs


def standards_report(
    layout: Layout, assumed: Assumptions | None = None
) -> dict[str, tuple[StandardFigures, ...]]:
    """Return the values of each standard in um with ``U`` (k = 2), by setup."""
    sources = assumed or Assumptions()
    report: dict[str, tuple[StandardFigures, ...]] = {}
    for name, found in linear_runs(layout).items():
        report[name] = (
            *(_positioning(layout, found, sources, standard) for standard in COVERAGES),
            *_vdi(found),
        )
    for kind in STEPS_A_CYCLE:
        along = diagonals(layout, kind)
        if along is not None:
            figures, runs = along
            each = {
                name: replace(
                    _positioning(layout, one, sources), standard=DIAGONAL_STANDARD[kind]
                )
                for name, one in runs.items()
            }
            report[DIAGONAL_ENTRY[kind]] = (
                StandardFigures(**_plain(figures), U=_largest_u(each)),
            )
            report |= {name: (one,) for name, one in each.items()}
    return report


def standards_findings(layout: Layout) -> list[Finding]:
    """Return the findings about omitted values, without repetition."""
    along = [
        found for kind in STEPS_A_CYCLE if (found := diagonals(layout, kind)) is not None
    ]
    runs = [
        *linear_runs(layout).values(),
        *(one for _, each in along for one in each.values()),
    ]
    lost = {finding: one.setup for one in reversed(runs) for finding in one.findings}
    return [*reversed(lost)]


def _runs(layout: Layout, index: int, cycle: int) -> SetupRuns | None:
    """Return the runs of a setup over every ``cycle``-th stop, from passes that contain all
    these stops; None if no pass contains them."""
    rows = np.flatnonzero(layout.setup_index == index)
    rows = rows[layout.stop[rows] % cycle == 0]
    way = way_mm(layout, rows)
    # at a reversal without overrun the target was approached from one side only
    rows = rows[
        ~np.isin(way, way[np.any(layout.approach[rows] != _travel(layout, rows), axis=1)])
    ]
    targets = len(np.unique(way_mm(layout, rows)))
    whole = [
        mine
        for number in np.unique(layout.pass_index[rows])
        if len(mine := rows[layout.pass_index[rows] == number]) == targets
    ]
    unbroken = [mine for mine in whole if not np.ptp(layout.zero_index[mine])]
    upward = [mine for mine in unbroken if _upward(layout, mine)]
    if not upward:
        return None
    kept = _one_zero(layout, unbroken)
    joined = len({_upward(layout, mine) for mine in kept}) > 1
    used = kept if joined else unbroken
    rows = np.concatenate(used)
    # passes along the setup's direction have odd numbers; a run may start at either end
    numbers = np.concatenate(
        [
            np.full(targets, 2 * place + _upward(layout, mine))
            for place, mine in enumerate(used)
        ]
    )
    runs, findings = arrange_runs(
        way_mm(layout, rows), numbers, layout.deviation_um[rows], common_zero=joined
    )
    return SetupRuns(setup=layout.setups[index].name, rows=rows, runs=runs, findings=findings)


def _one_zero(layout: Layout, passes: list[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    zeros = [int(layout.zero_index[mine[0]]) for mine in passes]
    ways = [(zero, _upward(layout, mine)) for zero, mine in zip(zeros, passes, strict=True)]
    longest = max(
        dict.fromkeys(zeros),
        key=lambda zero: (
            min(ways.count((zero, way)) for way in (True, False)),
            zeros.count(zero),
        ),
    )
    return [mine for mine, zero in zip(passes, zeros, strict=True) if zero == longest]


def _travel(layout: Layout, rows: NDArray[np.int64]) -> Vector:
    last = {int(number): row for row, number in enumerate(layout.pass_index.tolist())}
    travel: Vector = layout.approach[
        [last[number] for number in layout.pass_index[rows].tolist()]
    ]
    return travel


def _upward(layout: Layout, rows: NDArray[np.int64]) -> bool:
    return float(layout.approach[rows[0]] @ layout.direction[rows[0]]) > 0


def _positioning(
    layout: Layout, found: SetupRuns, assumed: Assumptions, standard: str = "iso-230-2"
) -> StandardFigures:
    figures = positioning_figures(found.runs, standard)
    length_mm = float(np.ptp(found.runs.target_mm))
    up, down = found.runs.up_um, found.runs.down_um
    runs = up.shape[1], up.shape[1] if down is None else down.shape[1]
    sources = _sources(layout, found, assumed)
    u = expanded_um(figures.numbers(), length_mm, runs, len(up), sources)
    lengths: Literal["as measured", "at 20 C"] = "as measured"
    if assumed.reduced_to_20_c:
        lengths = "at 20 C"
    return StandardFigures(
        **_plain(figures), runs=up.shape[1], lengths=lengths, U=u, U_status=SOURCE_STATUS
    )


def _sources(layout: Layout, found: SetupRuns, assumed: Assumptions) -> RunSources:
    """Return the sources of uncertainty of the runs: relative uncertainties of lengths, and
    uncertainties of the readings and the drift in um. The material's temperature is a source only
    for lengths at 20 C."""
    direction = np.abs(layout.direction[found.rows[0]])
    grown = float(assumed.reduced_to_20_c) * 1e-6 * assumed.u_grown_um_m()
    cosine = (1e-3 * assumed.alignment_mrad) ** 2 / 2 / np.sqrt(3.0)
    growth = np.sum((direction**2 * grown) ** 2)
    relative = float(np.sqrt(assumed.index**2 + cosine**2 + growth))
    stated = layout.u_um[found.rows]
    u_um = np.where(np.isfinite(stated), stated, assumed.reading_um)
    return RunSources(
        relative=relative,
        reading_um=float(np.sqrt(np.mean(u_um**2))),
        environment_um=float(np.hypot(assumed.drift_um, assumed.wander_um)),
    )


def _vdi(found: SetupRuns) -> list[StandardFigures]:
    runs = found.runs
    if runs.down_um is None or min(runs.up_um.shape[1], runs.down_um.shape[1]) < 2:
        return []
    return [StandardFigures(**_plain(vdi_3441_figures(runs)))]


def _largest_u(each: Mapping[str, StandardFigures]) -> dict[str, float]:
    names = {"E_d": "E", "B_d": "B", "R_d": "R", "A_d": "A"}
    stated = [one.U or {} for one in each.values()]
    return {
        name: max(u[of] for u in stated)
        for name, of in names.items()
        if all(of in u for u in stated)
    }


def _plain(figures: PositioningFigures | DiagonalFigures | VdiFigures) -> dict[str, Any]:
    values = {field.name: getattr(figures, field.name) for field in fields(figures)}
    return {name: value for name, value in values.items() if isinstance(value, float | str)}
