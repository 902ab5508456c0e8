"""Straightness by end-point, least-squares and minimum-zone lines."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stepdiag.base.errors import DataError
from stepdiag.solver.standards.straightness import (
    reference_line,
    residuals_um,
    straightness_um,
)

DATA = Path(__file__).parents[2] / "data"
METHODS = ("end-point", "least-squares", "minimum-zone")
profiles = arrays(np.float64, st.integers(3, 25), elements=st.floats(-50, 50, width=32))


@pytest.mark.parametrize(
    ("method", "expected_um"),
    [("end-point", 4.7), ("least-squares", 4.777273), ("minimum-zone", 4.7)],
)
def test_vector_of_the_reference(method, expected_um):
    """data/straightness_test_vector.csv (synthetic; figures in its first line)."""
    position, deviation = np.loadtxt(DATA / "straightness_test_vector.csv", delimiter=",").T
    assert straightness_um(position, deviation, method) == pytest.approx(
        expected_um, abs=5e-7
    )


def test_triangle_by_hand():
    """Heights 0, 3, 0 µm at 0, 100, 200 mm: all three lines are horizontal; the zone is 3 µm
    wide."""
    position, deviation = [0.0, 100.0, 200.0], [0.0, 3.0, 0.0]
    assert [
        reference_line(position, deviation, method).offset_um for method in METHODS
    ] == pytest.approx([0.0, 1.0, 1.5])
    assert [
        straightness_um(position, deviation, method) for method in METHODS
    ] == pytest.approx([3.0, 3.0, 3.0])


@pytest.mark.parametrize("start_mm", [0.0, -700.0, 300.0])
def test_each_line_lies_where_its_method_says(start_mm):
    """End points on it; least squares with no mean and no slope left; the minimum zone with as much
    above as below."""
    position, deviation = (
        start_mm + np.array([0.0, 100.0, 250.0, 400.0]),
        np.array([1.0, 4.0, -2.0, 9.0]),
    )
    left = {method: residuals_um(position, deviation, method) for method in METHODS}
    assert left["end-point"][[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert [left["least-squares"].sum(), left["least-squares"] @ position] == pytest.approx(
        [0.0, 0.0], abs=1e-6
    )
    assert left["minimum-zone"].max() == pytest.approx(-left["minimum-zone"].min())


def brute_force_zone_um(position, deviation):
    """Smallest range over the slopes of all pairs of points: contains every hull edge."""
    i, j = np.triu_indices(len(position), 1)
    slopes = (deviation[j] - deviation[i]) / (position[j] - position[i])
    return np.ptp(deviation - slopes[:, None] * position, axis=1).min()


@given(profiles)
def test_minimum_zone_is_the_narrowest_of_all(deviation):
    position = np.arange(len(deviation)) * 25.0
    zone = straightness_um(position, deviation, "minimum-zone")
    assert zone == pytest.approx(brute_force_zone_um(position, deviation), abs=1e-9)
    for method in ("end-point", "least-squares"):
        assert zone <= straightness_um(position, deviation, method) + 1e-9


@given(profiles, st.floats(-100, 100), st.floats(-100, 100))
def test_a_straight_slope_never_counts(deviation, offset_um, slope_urad):
    position = np.arange(len(deviation)) * 25.0
    tilted = deviation + offset_um + 1e-3 * slope_urad * position
    for method in METHODS:
        flat = residuals_um(position, deviation, method)
        assert np.ptp(residuals_um(position, tilted, method)) == pytest.approx(
            np.ptp(flat), abs=1e-8
        )


@given(profiles, st.randoms(use_true_random=False))
def test_order_of_the_stops_does_not_matter(deviation, random):
    position = np.arange(len(deviation)) * 25.0
    order = list(range(len(deviation)))
    random.shuffle(order)
    for method in METHODS:
        shuffled = straightness_um(position[order], deviation[order], method)
        assert shuffled == pytest.approx(
            straightness_um(position, deviation, method), abs=1e-9
        )


def test_repeated_stops_are_welcome():
    """Two passes over the same stops: the end points are means, the zone holds both passes."""
    position, deviation = [0.0, 0.0, 100.0, 100.0], [-1.0, 1.0, -1.0, 1.0]
    assert reference_line(position, deviation, "end-point").slope_urad == 0.0
    assert straightness_um(position, deviation, "minimum-zone") == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("position", "deviation"),
    [([5.0, 5.0], [0.0, 1.0]), ([0.0], [0.0]), ([0.0, 1.0], [0.0, np.nan])],
)
def test_stops_that_span_no_line_are_refused(position, deviation):
    with pytest.raises(DataError, match="straightness"):
        reference_line(position, deviation)
