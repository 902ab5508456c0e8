"""FANUC compensations along three straight lines between four points: inclination and straightness.

Inclination (B-64523EN-1/02; B-63522EN/02 15.4): parameters 5861-5864 contain the point numbers,
5871-5874 the amounts, which the control adds to the pitch error compensation. Straightness
(B-63522EN/02 15.5): amounts for the compensated axis at four pitch points of the moving axis. Both
kinds of amounts are absolute, in detection units, and linear between the points. (The page prints
(a - b) for the length of a section, a misprint for (b - a).) stepdiag chooses the four points with
the smallest sum of squared residuals.
"""

from itertools import combinations

import numpy as np

from stepdiag.base.errors import SafetyError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.exporters.fanuc.options import FanucOptions
from stepdiag.exporters.fanuc.pitch import Points, points_of
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import quantised, sampled_um
from stepdiag.exporters.tables.tables import Law, Table

INCLINATION = "inclination"
STRAIGHTNESS = "straightness"
LAW = Law(sense="as-compensation")
INCLINATION_POINTS = (5861, 5862, 5863, 5864)
INCLINATION_VALUES = (5871, 5872, 5873, 5874)
_CANDIDATES = 40
"""Largest number of interior points that the search tries. 40 points form 780 pairs, and each pair
needs a fit of four numbers.
"""


def line_table(
    kind: str, curve: Curve, profile: Profile, options: FanucOptions
) -> tuple[Table, float]:
    """Return the four-point table for the mean of both directions of a curve, and its largest
    residual in um on the grid.
    """
    grid, forward, reverse = sampled_um(curve, profile)
    if len(grid) < 4:
        raise SafetyError(
            f"{profile.source}: axes.{curve.input_axis}.step_mm",
            code="grid-unfit.points",
            expected=message("four-points"),
            found=str(len(grid)),
        )
    wanted = -(forward + reverse) / 2
    knots, values = _best_lines(grid, wanted)
    reference = profile.axis(curve.input_axis).reference_mm
    values = quantised(
        values - np.interp(reference, grid[knots], values), options.detection_unit_um
    )
    points = numbers(curve.input_axis, profile, options)
    table = Table(
        kind=kind,
        input_axis=curve.input_axis,
        output_axis=curve.output_axis,
        position_mm=grid[knots],
        value_um=values,
        quantum_um=options.detection_unit_um,
        law=LAW,
        reference_mm=reference,
        place={"points": " ".join(str(points.start + knot) for knot in knots)},
    )
    residual = np.interp(grid, grid[knots], values) - wanted
    return table, float(np.max(np.abs(residual - np.interp(reference, grid, residual))))


def numbers(letter: str, profile: Profile, options: FanucOptions) -> Points:
    where = f"{profile.source}: axes.{letter}.reference_mm"
    return points_of(
        options.axis(letter, profile.source),
        profile.grid_mm(letter),
        profile.axis(letter).reference_mm,
        where,
    )


def _best_lines(grid: Vector, wanted: Vector) -> tuple[list[int], Vector]:
    last = len(grid) - 1
    interior = np.unique(
        np.linspace(1, last - 1, min(last - 1, _CANDIDATES)).round().astype(int)
    )
    fits = [
        _fitted(grid, wanted, [0, *inner, last])
        for inner in combinations(interior.tolist(), 2)
    ]
    _, knots, values = min(fits, key=lambda fit: fit[0])
    return knots, values


def _fitted(
    grid: Vector, wanted: Vector, knots: list[int]
) -> tuple[float, list[int], Vector]:
    hats = np.column_stack(
        [np.interp(grid, grid[knots], unit) for unit in np.eye(len(knots))]
    )
    values = np.linalg.lstsq(hats, wanted, rcond=None)[0].astype(np.float64)
    return float(np.sum((hats @ values - wanted) ** 2)), knots, values
