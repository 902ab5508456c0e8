"""The machine's temperature from stop to stop: its growth during a survey is subtracted before the
adjustment.

Each reading is reduced to the mean temperature of the survey with the assumed expansion
coefficients, so that the result is valid for one temperature. The uncertainty of the coefficients
enters the adjustment as one of its random effects (`solver.model.effects`).
"""

from dataclasses import replace

import numpy as np

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.findings import Finding, info
from stepdiag.base.messages import Message, message
from stepdiag.base.volume import Vector
from stepdiag.solver.model.layout import Layout

STEADY_C = 0.005
"""Smallest difference of temperatures in C that is corrected: thermometers resolve 0.01 C."""
WORTH_SAYING_C = 0.1
"""Smallest change of temperature in C that gives a finding: 0.1 C changes a metre of steel by 1.2
um.
"""


def excess_c(layout: Layout, assumed: Assumptions) -> Vector:
    """Return the difference between the machine's temperature in each reading's pass and the mean
    of the survey, shape (m,).

    The mean of a pass is used, so that the resolution of a thermometer does not become noise of the
    stops. All differences are zero if a reading has no temperature, if all temperatures are equal,
    or if the readings were already reduced to 20 C.
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
    """Return the commanded travel of each axis since the zero of the reading's count, along the
    reading's direction, shape (m, 3).
    """
    first = np.unique(layout.zero_index, return_index=True)[1]
    number = np.searchsorted(layout.zero_index[first], layout.zero_index)
    travelled: Vector = (
        layout.position_mm - layout.position_mm[first][number]
    ) * layout.direction
    return travelled


def at_one_temperature(layout: Layout, assumed: Assumptions) -> Layout:
    """Return the layout with every deviation reduced to the mean temperature of the survey, with a
    finding if the temperature changed by `WORTH_SAYING_C`.
    """
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
    """Return the words for the expansions of the axes in um/m/C, one for each different value."""
    return [
        message("plain-figure", figure=one) for one in dict.fromkeys(assumed.expansion_um_m_c)
    ]
