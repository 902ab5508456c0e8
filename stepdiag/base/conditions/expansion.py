"""Thermal expansion of each axis, relative to the reference temperature of 20 C (ISO 1)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepdiag.base.conditions.air import Done

Vector = NDArray[np.float64]

REFERENCE_TEMPERATURE_C = 20.0


def expansion_um(
    travel_mm: ArrayLike,
    direction: ArrayLike,
    coefficient_um_m_c: ArrayLike,
    temperature_c: ArrayLike,
) -> Vector:
    """Return the part of each reading that the thermal expansion of the axes causes, in um, shape
    (N,).

    ``travel_mm`` (N, 3) is the commanded travel since the first stop of the pass. ``direction``
    (3,) is the unit vector of the measuring direction. ``coefficient_um_m_c`` (3,) and
    ``temperature_c``, (3,) or (N, 3), belong to the axes. A shift of the whole machine between two
    stops is drift and not included.
    """
    travel = np.asarray(travel_mm, dtype=np.float64)
    excess = np.asarray(temperature_c, dtype=np.float64) - REFERENCE_TEMPERATURE_C
    # um/m/C times mm is nm
    stretch_um = travel * np.asarray(coefficient_um_m_c, dtype=np.float64) * excess * 1e-3
    along: Vector = stretch_um @ np.asarray(direction, dtype=np.float64)
    return along


def reading_at_20_c_mm(reading_mm: ArrayLike, expansion: Vector, done: Done) -> Vector:
    """Return the readings at 20 C, shape (N,). Readings that the instrument has already reduced to
    20 C stay unchanged."""
    readings = np.asarray(reading_mm, dtype=np.float64)
    return readings if Done.EXPANSION in done else readings - expansion * 1e-3
