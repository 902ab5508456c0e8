"""Reduction of readings to 20 C, axis by axis."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.conditions.air import Done
from stepdiag.base.conditions.expansion import expansion_um, reading_at_20_c_mm


def test_one_metre_of_steel_grows_by_the_book():
    """1 m, 11.7 µm/m/C, 1 C above 20 C: 11.7 µm (ISO 1)."""
    growth = expansion_um(
        [[1000.0, 0.0, 0.0]], [1.0, 0.0, 0.0], [11.7, 0.0, 0.0], [21.0, 35.0, 35.0]
    )
    assert growth == pytest.approx([11.7])


@given(st.floats(-15, 15), st.floats(-15, 15), st.floats(-15, 15))
def test_each_axis_brings_its_own_temperature(tx, ty, tz):
    """On a diagonal the stretch is the projection of three independent stretches (exact forward
    model)."""
    size = np.array([500.0, 400.0, 300.0])
    direction = size / np.linalg.norm(size)
    alpha, excess = np.array([11.7, 10.5, 8.0]), np.array([tx, ty, tz])
    grown_mm = size * (1 + alpha * 1e-6 * excess)
    growth = expansion_um([size], direction, alpha, 20.0 + excess)
    assert growth[0] == pytest.approx((grown_mm - size) @ direction * 1e3, abs=1e-6)
    assert reading_at_20_c_mm([grown_mm @ direction], growth, Done.NOTHING)[
        0
    ] == pytest.approx(np.linalg.norm(size))


def test_temperature_may_change_from_stop_to_stop():
    travel = np.array([[0.0, 0, 0], [500.0, 0, 0], [1000.0, 0, 0]])
    temperature = np.array([[20.0, 20, 20], [22.0, 20, 20], [24.0, 20, 20]])
    assert expansion_um(travel, [1, 0, 0], [10.0] * 3, temperature) == pytest.approx(
        [0.0, 10.0, 40.0]
    )


def test_nothing_is_reduced_twice():
    growth = np.array([11.7])
    assert reading_at_20_c_mm([1000.0], growth, Done.EXPANSION).tolist() == [1000.0]
    assert reading_at_20_c_mm([1000.0], growth, Done.WAVELENGTH) == pytest.approx(
        [1000.0 - 0.0117]
    )
