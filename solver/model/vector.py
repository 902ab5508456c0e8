"""Wang's closed form for four body step diagonals (Wang 2000, Eqs 3-8 and 12-13), as printed and
corrected.

The printed text has gaps, which are filled as follows (theory 3):

- dR(x), dR(y), dR(z) of Eqs 6-8 are the deviations of an axis' moves, cumulated by the position of
  the axis from its low end (E6). For an axis that travels backwards the sign and the order are
  reversed (E7).
- The lower-case x/R, y/R, z/R of Eqs 4-6 are the capital letters X/R, Y/R, Z/R (E8). In Eqs 12-13,
  X, Y, Z, R are the whole travels, and dR is the deviation from start to end in the direction of
  travel (E4, E6).
- The thetas have the sign of Eqs 12-13, which is opposite to Eqs 9-11 (E3): theta_xy = -C0Y,
  theta_zx = +B0Z, theta_yz = -A0Z.

The printed equations convert mirror tilt to machine errors (up to 420 um/m for 0.5 mrad) and scale
errors to squareness (E5). The least-squares form uses all four equations, removes end-point lines
and separates the sum of the scales.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.names import BODY_DIAGONALS
from stepdiag.base.volume import Vector, Volume
from stepdiag.solver.model.design import between_nodes
from stepdiag.solver.model.layout import Layout

SIGNS = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]], dtype=np.float64)
"""Signs of the travel along X, Y, Z in the setups ppp, npp, pnp, ppn."""
CLOSURE = np.array([1.0, -1.0, -1.0, -1.0])
"""Factors of the closure dR_ppp - dR_npp - dR_pnp - dR_ppn, which is zero at each node for every
rigid machine (E14)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DiagonalData:
    """The deviations along the four diagonals, sorted as in section III.I of Wang 2000.

    ``by_position_um`` (diagonal, axis, n+1) are the deviations of the moves of an axis, cumulated
    by position. ``end_um`` (diagonal,) is the deviation from start to end in the direction of
    travel. ``passes`` (diagonal,) is the number of averaged passes.
    """

    volume: Volume
    by_position_um: Vector
    end_um: Vector
    passes: Vector


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VectorSolution:
    """The solution of a closed form: ``error_um`` (component, axis, n+1), for example E_x(y) at [0,
    1]; ``theta_urad`` with xy, zx, yz and the sign of Eq. 12.

    ``scale_sum_um`` is S = sum L^2 scale / R, or None if the method assumes S = 0.
    """

    error_um: Vector
    theta_urad: dict[str, float]
    scale_sum_um: float | None


def diagonal_data(layout: Layout) -> DiagonalData:
    """Return the data of the four diagonals as means over the passes.

    Raises ``DataError`` if a diagonal is missing or the diagonals have different increments.
    """
    names = [setup.name for setup in layout.setups]
    missing = [diagonal for diagonal in BODY_DIAGONALS if diagonal not in names]
    if missing:
        raise DataError(
            f"{layout.source}: setups",
            expected=message("four-body", names=BODY_DIAGONALS),
            found="no " + ", ".join(missing),
            remedy=message("use-estimate-takes"),
        )
    parts = [
        [
            _one_pass(layout, index)
            for index, key in enumerate(layout.passes)
            if key.setup == diagonal
        ]
        for diagonal in BODY_DIAGONALS
    ]
    return DiagonalData(
        volume=layout.volume,
        by_position_um=np.array(
            [np.mean([moves for moves, _ in part], axis=0) for part in parts]
        ),
        end_um=np.array([np.mean([end for _, end in part]) for part in parts]),
        passes=np.array([len(part) for part in parts], dtype=np.float64),
    )


def _one_pass(layout: Layout, index: int) -> tuple[Vector, float]:
    """Return the cumulated deviations of a pass by position (axis, n+1), and its deviation from
    start to end, both in the sign of an outward pass."""
    rows = np.flatnonzero(layout.pass_index == index)
    n = layout.volume.increments
    if len(rows) != 3 * n + 1:
        raise DataError(
            f"{layout.source}: {layout.passes[index]}",
            expected=message("stops-as", count=3 * n + 1),
            found=f"{len(rows)}",
        )
    if np.any(np.diff(layout.zero_index[rows])):
        lost = int(
            layout.stop[rows][int(np.argmax(np.diff(layout.zero_index[rows]) != 0)) + 1]
        )
        found = message("count-lost", stop=lost)
        where = f"{layout.source}: {layout.passes[index]}"
        raise DataError(
            where,
            expected=message("unbroken-count"),
            found=found,
            remedy=message("estimate-or"),
        )
    lower, fraction = between_nodes(layout.volume, layout.position_mm[rows])
    node = lower + np.round(fraction).astype(np.int64)
    step = np.diff(node, axis=0)
    rise = np.diff(layout.deviation_um[rows])
    increments = np.zeros((3, n))
    for axis in range(3):
        moved = step[:, axis] != 0
        increments[axis, np.minimum(node[:-1, axis], node[1:, axis])[moved]] = (
            step[:, axis] * rise
        )[moved]
    sense = 1.0 if layout.passes[index].outward else -1.0
    cumulated = np.hstack([np.zeros((3, 1)), np.cumsum(increments, axis=1)])
    return cumulated, sense * float(
        layout.deviation_um[rows[-1]] - layout.deviation_um[rows[0]]
    )


def wang2000(data: DiagonalData) -> VectorSolution:
    """Return the solution of Eqs 7, 8 and 13 as printed: two of the four diagonals for each
    component, with all slopes."""
    size, diagonal = _sizes(data.volume)
    f = data.by_position_um
    error = np.array(
        [
            (f[0] - f[1 + component]) * diagonal / (2 * size[component])
            for component in range(3)
        ]
    )
    ppp, npp, pnp, ppn = data.end_um
    pairs = {"xy": ppp + ppn, "zx": ppp + pnp, "yz": ppp + npp}
    theta = {
        plane: float(total) * 1e3 * diagonal / (2 * _area(plane, size))
        for plane, total in pairs.items()
    }
    return VectorSolution(error_um=error, theta_urad=theta, scale_sum_um=None)


def least_squares(data: DiagonalData) -> VectorSolution:
    """Return the least-squares solution from all four diagonals, without end-point lines; the
    squareness has four terms (theory E5, E14)."""
    size, diagonal = _sizes(data.volume)
    error = (
        np.einsum("dc,dan->can", SIGNS, data.by_position_um)
        * diagonal
        / (4 * size[:, None, None])
    )
    ppp, npp, pnp, ppn = data.end_um
    terms = {
        "xy": ppp - npp - pnp + ppn,
        "zx": ppp - npp + pnp - ppn,
        "yz": ppp + npp - pnp - ppn,
    }
    return VectorSolution(
        error_um=without_end_line(error),
        theta_urad={
            plane: float(total) * 1e3 * diagonal / (4 * _area(plane, size))
            for plane, total in terms.items()
        },
        scale_sum_um=float(np.sum(data.end_um)) / 4,
    )


def closure_um(data: DiagonalData) -> Vector:
    """Return the closure r(axis, node), shape (3, n+1), without its end-point line, which is mirror
    tilt (theory E14, 6.5).

    The expected closure is noise, twice as large as the noise of one deviation. A small closure
    does not prove that there are no angular errors (theory 5.3).
    """
    return without_end_line(np.einsum("d,dan->an", CLOSURE, data.by_position_um))


def without_end_line(values: Vector) -> Vector:
    """Return functions (.., n+1), zero at the first node, minus the line to the last node."""
    share = np.arange(values.shape[-1]) / (values.shape[-1] - 1)
    shape: Vector = values - values[..., -1:] * share
    return shape


def _sizes(volume: Volume) -> tuple[Vector, float]:
    size = np.array(volume.size_mm)
    return size, float(np.linalg.norm(size))


def _area(plane: str, size: Vector) -> float:
    first, second = ("xyz".index(axis) for axis in plane)
    return float(size[first] * size[second])
