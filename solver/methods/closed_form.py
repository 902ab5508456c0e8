from collections.abc import Callable

import numpy as np

from stepdiag.base.findings import Finding, info, warning
from stepdiag.base.result.members import Closure, Fit, Length
from stepdiag.base.result.result import (
    AXIS_LETTERS,
    DISPLACEMENTS,
    Function,
    Quantity,
    Result,
    Scale,
)
from stepdiag.base.volume import Vector, Volume
from stepdiag.solver.adjustment.diagnostics import travel_report
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import ASSUMED_U_UM
from stepdiag.solver.model.vector import (
    DiagonalData,
    VectorSolution,
    closure_um,
    diagonal_data,
    least_squares,
    wang2000,
    without_end_line,
)

THETA_OF = {"C0Y": ("xy", -1.0), "B0Z": ("zx", 1.0), "A0Z": ("yz", -1.0)}
"""Wang's theta (sign of Eq. 12) for each ISO 230-1 squareness, and its sign."""


def solve_wang2000(layout: Layout, chain: str) -> Result:
    """Return the result of Eqs 7, 8 and 13 of Wang 2000 as printed, but with straightness
    without its end-point line (contract 4). Raises ``DataError`` unless all four diagonals are
    present."""
    return _result(layout, chain, "wang2000", wang2000, terms=2)


def solve_least_squares(layout: Layout, chain: str) -> Result:
    """Return the least-squares result from four diagonals: functions, squareness, sum of the
    scales. Raises ``DataError`` unless all four diagonals are present."""
    return _result(layout, chain, "least-squares", least_squares, terms=4)


def _result(
    layout: Layout,
    chain: str,
    method: str,
    solution_of: Callable[[DiagonalData], VectorSolution],
    *,
    terms: int,
) -> Result:
    data = diagonal_data(layout)
    solution = solution_of(data)
    closure = closure_um(data)
    reading_u, findings = _reading_u(layout, data, closure)
    errors = _functions(layout.volume, solution, reading_u, terms)
    return Result(
        volume=layout.volume,
        chain=chain,
        method=method,
        errors=errors,
        squareness=_squareness(
            layout.volume, solution, reading_u * float(np.sqrt(2.0)), terms
        ),
        scale={letter: _scale(errors[f"E{letter}{letter}"]) for letter in AXIS_LETTERS},
        setups={
            setup.name: travel_report(layout, setup)
            for setup in layout.setups
            if setup.name in _used(layout)
        },
        findings=(*layout.findings, *_method_findings(method), *_unused(layout), *findings),
        closure_um=Closure.of(closure),
        scale_sum_um=None
        if solution.scale_sum_um is None
        else Length(value=solution.scale_sum_um),
        fit=Fit(noise_um=reading_u),
    )


def _functions(
    volume: Volume, solution: VectorSolution, reading_u: float, terms: int
) -> dict[str, Function]:
    size = np.array(volume.size_mm)
    nodes = np.arange(volume.increments + 1)
    bridge = np.sqrt(2.0 * nodes * (volume.increments - nodes) / volume.increments)
    walk = np.sqrt(2.0 * nodes)
    functions = {}
    for index, name in enumerate(DISPLACEMENTS):
        axis, component = divmod(index, 3)
        raw = solution.error_um[component, axis]
        sloped = axis == component and solution.scale_sum_um is None
        gain = np.linalg.norm(size) / size[component] / np.sqrt(terms)
        functions[name] = Function(
            position_mm=volume.nodes_mm(axis),
            value=raw if sloped else without_end_line(raw),
            u=reading_u * gain * (walk if sloped else bridge),
            unit="um",
            slope_identified=sloped or axis != component,
        )
    return functions


def _squareness(
    volume: Volume, solution: VectorSolution, end_u: float, terms: int
) -> dict[str, Quantity]:
    size = np.array(volume.size_mm)
    squareness = {}
    for name, (plane, sign) in THETA_OF.items():
        area = float(np.prod([size["xyz".index(axis)] for axis in plane]))
        u = end_u * 1e3 * float(np.linalg.norm(size)) / (area * np.sqrt(terms))
        squareness[name] = Quantity(value=sign * solution.theta_urad[plane], u=u)
    return squareness


def _scale(positioning: Function) -> Scale:
    if not positioning.slope_identified or positioning.value is None or positioning.u is None:
        return Scale(value=None, u=None, identified=False)
    per_metre = 1e3 / float(positioning.position_mm[-1] - positioning.position_mm[0])
    return Scale(
        value=float(positioning.value[-1]) * per_metre,
        u=float(positioning.u[-1]) * per_metre,
        identified=True,
    )


def _reading_u(
    layout: Layout, data: DiagonalData, closure: Vector
) -> tuple[float, list[Finding]]:
    """Return the standard uncertainty of an averaged reading, and findings. It is the stated value,
    or without a stated value the estimate from the increments of the closure."""
    used = np.isin([key.setup for key in layout.passes], _used(layout))[layout.pass_index]
    stated = layout.u_um[used]
    if np.all(np.isfinite(stated)):
        return float(np.sqrt(np.mean(stated**2) / np.mean(data.passes))), []
    increments = np.diff(closure, axis=1)
    if increments.shape[1] > 1:
        freedom = increments.size - len(increments)
        return float(np.sqrt(np.sum(increments**2) / freedom / 8.0)), []
    return ASSUMED_U_UM, [warning("noise-assumed", u_um=ASSUMED_U_UM)]


def _used(layout: Layout) -> list[str]:
    return [
        setup.name for setup in layout.setups if setup.kind == "step" and setup.shift == 0
    ]


def _method_findings(method: str) -> list[Finding]:
    if method == "wang2000":
        return [warning("method-limited.printed")]
    return [warning("unidentified.sum")]


def _unused(layout: Layout) -> list[Finding]:
    others = [setup.name for setup in layout.setups if setup.name not in _used(layout)]
    return [info("method-limited.runs", others=others)] if others else []
