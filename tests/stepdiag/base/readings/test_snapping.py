"""Targets of reported positions: one rounding for nodes, targets of a run's own, and the edges of
the box."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.readings.snapping import arrivals, edges_mm, shared_mm, snapped_mm
from stepdiag.base.volume import POSITION_TOLERANCE_MM, Volume
from stepdiag.solver.model.layout import lay_out
from testkit.exact.beside import Beside, scattered
from testkit.exact.surveys import Bench
from testkit.examples import few

VOLUME = Volume(origin_mm=(-100.0, 0.0, 20.0), size_mm=(500.0, 400.0, 300.0), increments=7)


@given(st.integers(1, 40), st.floats(1.0, 4000.0), st.integers(0, 1000))
@few(40)
def test_a_stop_within_the_tolerance_gets_its_node(increments, length_mm, seed):
    volume = Volume(
        origin_mm=(-7.0, 0.0, 0.0),
        size_mm=(length_mm, length_mm / 2, length_mm / 3),
        increments=increments,
    )
    draw = np.random.default_rng(seed)
    node = draw.integers(0, increments + 1, (30, 3))
    target = np.array(volume.origin_mm) + volume.step_mm * node
    beside = draw.uniform(-1.0, 1.0, (30, 3)) * volume.tolerance_mm
    assert np.allclose(snapped_mm(volume, target + beside), target, atol=1e-9)


def test_targets_of_a_run_are_one_target_each_and_what_is_snapped_stays():
    target = np.array([13.0, 13.5, 60.2, 77.77])
    position = np.repeat(target, 50) + np.random.default_rng(1).uniform(-0.1, 0.1, 200)
    points = np.column_stack([position, np.zeros(200), np.full(200, 20.0)])
    snapped = snapped_mm(VOLUME, points)
    assert len(np.unique(snapped[:, 0])) == 4
    assert np.unique(snapped[:, 0]) == pytest.approx(target, abs=0.05)
    assert np.array_equal(snapped_mm(VOLUME, snapped), snapped)


def test_targets_closer_together_than_the_tolerance_stay_apart_where_a_run_has_them():
    """The pitch of a screw is looked at in steps of 0.2 mm: the tolerance is a quarter of that."""
    targets = {"linear-x": (*np.round(np.arange(0.0, 4.01, 0.2), 1).tolist(), 500.0)}
    survey = Beside(
        bench=Bench(increments=2), passes=(1, 2), stands=scattered(5.0, 1), targets_mm=targets
    )
    layout = lay_out(survey.readings())
    along = layout.position_mm[
        np.array([setup.name for setup in layout.setups])[layout.setup_index] == "linear-x", 0
    ]
    assert np.unique(along) == pytest.approx(np.array(targets["linear-x"]), abs=0.005)


def test_an_axis_without_travel_has_one_target():
    flat = Volume(origin_mm=(0.0, 5.0, 0.0), size_mm=(500.0, 0.0, 0.0), increments=5)
    points = np.array([[100.0, 5.04, -0.03], [200.003, 4.95, 0.0]])
    assert snapped_mm(flat, points) == pytest.approx(
        np.array([[100.0, 5.0, 0.0], [200.0, 5.0, 0.0]])
    )


def test_a_head_shares_the_targets_of_the_laser():
    target = np.array([-100.0, 33.36, 150.0])
    found = shared_mm(
        VOLUME, 0, np.array([-99.95, 33.30, 33.41, 150.0, 222.15, 222.25]), target
    )
    assert found[:4] == pytest.approx([-100.0, 33.36, 33.36, 150.0])
    assert found[4] == found[5] == pytest.approx(222.2)


@pytest.mark.parametrize(
    ("low", "high", "stated"),
    [
        (0.0, 500.0001, (0.0, 500.0)),
        (0.0, 500.002, (0.0, 500.0)),
        (-0.004, 487.304, (0.0, 487.3)),
        (0.0, 123.45, (0.0, 123.45)),
        (-250.0, 254.03, (-250.0, 254.03)),
    ],
)
def test_edges_have_few_decimals_where_such_are_near(low, high, stated):
    share = np.tile(np.arange(6) / 5, 4)
    assert edges_mm(low + (high - low) * share, np.full(len(share), 5)) == stated


@given(st.integers(1, 20), st.integers(0, 1000))
@few(30)
def test_edges_of_stops_that_scatter(increments, seed):
    """Within a tenth of a millimetre each: a whole number of millimetres is found again, anything
    else within the scatter."""
    draw = np.random.default_rng(seed)
    share = np.tile(np.arange(increments + 1) / increments, 8)
    for high in (400.0, 400.37):
        position = high * share + draw.uniform(-1.0, 1.0, len(share)) * POSITION_TOLERANCE_MM
        low, found = edges_mm(position, np.full(len(share), increments))
        assert abs(low) <= POSITION_TOLERANCE_MM
        assert abs(found - high) <= POSITION_TOLERANCE_MM


def test_positions_of_no_equal_steps_give_their_extremes():
    assert edges_mm(np.array([0.0, 20.0, 70.0, 100.0]), np.full(4, 3)) == (0.0, 100.0)
    assert edges_mm(np.array([5.0, 5.02]), np.full(2, 3)) == (5.01, 5.01)


def test_moves_are_numbered_by_axis_and_a_standing_axis_has_none():
    position = np.array(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
    )
    passes = np.array([0, 0, 0, 1, 1])
    came = arrivals(position, passes, np.zeros(5, dtype=bool))
    assert np.all(came[:, 2] == -1)
    assert came[0, 0] != came[1, 0] == came[2, 0]
    assert came[2, 1] != came[1, 1] == came[0, 1]
    assert came[3, 1] == came[4, 1] == -1
    turned = arrivals(position, passes, np.array([False, False, False, True, False]))
    assert turned[3, 0] == turned[2, 0]
