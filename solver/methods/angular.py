"""Angular functions that were not measured: their likely values, and the findings about them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from stepdiag.base.findings import Finding, error, finding, info
from stepdiag.base.messages import message
from stepdiag.base.result.prediction import TAIL
from stepdiag.base.result.result import AXIS_LETTERS, ROTATIONS, Function
from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.uncertainty.spread import Spread, deviation

FAR, FAR_IN_FEW = 10.0, 6.0
"""Largest credible ratio of an angular function to the usual size of an ordinary machine; the
second value is for surveys with less than `FEW_FREEDOM` degrees of freedom. Worn machines with
90 urad have 6 times the usual size, and their surveys show at most 7 times. The cause of a
larger value is a wrong reading."""
FEW_FREEDOM = 20
"""Number of degrees of freedom below which a survey is small; a survey driven once has 13 with
three increments and 7 with two. In a small survey, a slip of 20 um in a run of three stops looks
like angles of 130 urad; compensation with these angles increased the error of a machine from 5.7
to 9.8 um."""


def expected_angles(found: Adjustment, spread: Spread) -> dict[str, Function]:
    """Return the likely values of every unknown angular function at the nodes, with standard
    uncertainties."""
    volume, shapes = found.layout.volume, found.shapes
    if not shapes.names:
        return {}
    share = np.arange(volume.increments + 1) / volume.increments
    first = found.first_cause("angles")
    expected = {}
    for name in shapes.names:
        own = shapes.causes_of(name)
        at_nodes = np.zeros((len(share), len(spread.fit.size)))
        at_nodes[:, first + own] = shapes.range_of(name) * shapes.at(share)
        none = Rows(
            np.zeros((len(share), 1), dtype=np.int64),
            np.zeros((len(share), 1)),
            found.design.columns.count,
        )
        moved = spread.moved(none, at_nodes)
        expected[name] = Function(
            position_mm=volume.nodes_mm(AXIS_LETTERS.index(name[2])),
            value=at_nodes @ spread.fit.amount,
            u=deviation(spread.variance(moved)),
            unit="urad",
            u_readings=deviation(spread.variance_by_readings(moved)),
        )
    return expected


def angle_size_urad(found: Adjustment, spread: Spread) -> tuple[float, float, float] | None:
    """Return the likely range of an angular function over the travel in urad, median and 95 %
    limits; None if all angular functions are known."""
    if not found.shapes.names:
        return None
    place = spread.names.index("angles")
    usual = float(np.mean(found.shapes.range_urad)) * float(found.sizes.factor[place])
    likely = (
        usual * spread.families[place].factor
        if place in spread.families
        else np.full(1, usual)
    )
    low, middle, high = (float(size) for size in np.quantile(likely, (TAIL, 0.5, 1.0 - TAIL)))
    return middle, low, high


def angle_findings(
    found: Adjustment, spread: Spread, resolved: Sequence[str], volume_um: dict[str, Any]
) -> list[Finding]:
    """Return the findings about angular functions that were not measured."""
    size = angle_size_urad(found, spread)
    if size is None:
        return []
    if len(resolved) == len(found.shapes.names):
        return [info("angles-resolved", names=resolved)]
    unknown = [name for name in found.shapes.names if name not in resolved]
    every = len(unknown) == len(ROTATIONS)
    words = message(
        "angles-unmeasured",
        names=message("all-angular-functions")
        if every
        else message("angular-functions-of", names=unknown),
        turn_urad=size[0],
        low_urad=size[1],
        high_urad=size[2],
        left_um=volume_um["now"],
        head_um=volume_um["with_head"],
    )
    return [finding("info", words), *_far(found, size[1])]


def _far(found: Adjustment, least_urad: float) -> list[Finding]:
    usual = float(np.mean(found.shapes.range_urad))
    if least_urad <= (FAR_IN_FEW if found.fit.freedom < FEW_FREEDOM else FAR) * usual:
        return []
    setups = [setup.name for setup in found.layout.setups]
    return [error("angles-far", setups=setups, least_urad=least_urad, assumed_urad=usual)]
