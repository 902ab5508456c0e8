"""Reduction of each reading to the mean temperature of the survey, with the assumed expansion
coefficients.

The uncertainty of the coefficients is a random effect of the adjustment (`solver.model.effects`).
"""

from dataclasses import replace

import numpy as np

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.findings import Finding, info
from stepdiag.base.messages import Message, message
from stepdiag.base.volume import Vector
from stepdiag.solver.model.layout import Layout

STEADY_C = 0.005
"""Smallest range of temperatures in C that is corrected: thermometers resolve 0.01 C."""
WORTH_SAYING_C = 0.1
"""Smallest range of temperatures in C that gives a finding: 0.1 C changes 1 m of steel by 1.2
um."""


def excess_c(layout: Layout, assumed: Assumptions) -> Vector:
    """Return the machine's temperature in each reading's pass minus the mean of the survey in C,
    shape (m,).

    The mean of each pass is used, because the resolution of a thermometer would be noise of single
    stops. The result is zero if a reading has no temperature, if all temperatures are equal, or if
    the readings are reduced to 20 C.
    """
    known = layout.temperature_c
    if (
        assumed.reduced_to_20_c
        or not len(known)
        or not np.all(np.isfinite(known))
        or np.ptp(known) <= STEADY_C
    ):
        return np.zeros(len(known))
    of_pass = np.bincount(layout.pass_index, weights=known) / np.bincount(layout.pass_index)
    warmer: Vector = of_pass[layout.pass_index] - np.mean(known)
    return warmer


def counted_mm(layout: Layout) -> Vector:
    """Return the commanded travel of each axis since the zero of the count, along the reading's
    direction, shape (m, 3)."""
    first = np.unique(layout.zero_index, return_index=True)[1]
    number = np.searchsorted(layout.zero_index[first], layout.zero_index)
    travelled: Vector = (
        layout.position_mm - layout.position_mm[first][number]
    ) * layout.direction
    return travelled


def at_one_temperature(layout: Layout, assumed: Assumptions) -> Layout:
    """Return the layout with deviations reduced to the mean temperature of the survey, and a
    finding if the temperature changed by `WORTH_SAYING_C`."""
    warmer = excess_c(layout, assumed)
    if not np.any(warmer):
        return layout
    grown = 1e-3 * (counted_mm(layout) @ np.array(assumed.expansion_um_m_c)) * warmer
    return replace(
        layout,
        deviation_um=layout.deviation_um - grown,
        findings=(*layout.findings, *_remarks(layout, assumed)),
    )


def _remarks(layout: Layout, assumed: Assumptions) -> tuple[Finding, ...]:
    low, mean, high = (float(of(layout.temperature_c)) for of in (np.min, np.mean, np.max))
    if high - low < WORTH_SAYING_C:
        return ()
    return (
        info(
            "temperature-levelled",
            low_c=low,
            high_c=high,
            mean_c=mean,
            expansions=expansions(assumed),
        ),
    )


def expansions(assumed: Assumptions) -> list[Message]:
    """Return the expansion coefficients of the axes in um/m/C as messages, without repetition."""
    return [
        message("plain-figure", figure=one) for one in dict.fromkeys(assumed.expansion_um_m_c)
    ]
