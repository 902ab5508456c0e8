"""Where a pass must stop, what the laser must read there, and what Modbus alone says of a
standstill."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.names import BODY_DIAGONALS
from stepdiag.base.volume import Volume
from stepdiag.daq.capture.naming.route import judge_step
from stepdiag.daq.capture.standing.dwell import DwellTracker, count_steps
from stepdiag.daq.capture.standing.window import find_plateaus
from stepdiag.daq.formats.signals import Signals
from testkit.routes import make_route

BOX = Volume(origin_mm=(-50.0, 10.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=10)


@pytest.mark.parametrize("setup", [*BODY_DIAGONALS, "ppp+2"])
def test_diagonal_route_reads_the_diagonal_and_comes_back(setup):
    """An outward pass has 3n+1 stops and ends at the length of the diagonal, 707.1 mm; the return
    pass mirrors it."""
    out = make_route(BOX, setup, "xyz", outward=True)
    back = make_route(BOX, setup, "xyz", outward=False)
    assert len(out) == len(back) == 31
    assert out.nominal_mm[-1] == pytest.approx(np.sqrt(500**2 + 400**2 + 300**2))
    np.testing.assert_array_equal(back.stops_mm, out.stops_mm[::-1])
    assert back.nominal_mm[-1] == pytest.approx(-out.nominal_mm[-1])
    assert [out.axis_to(stop) for stop in range(4)] == ["", "x", "y", "z"]
    assert [back.axis_to(stop) for stop in range(4)] == ["", "z", "y", "x"]


def test_linear_route_reads_along_its_axis():
    route = make_route(BOX, "linear-y", "xyz", outward=True)
    np.testing.assert_allclose(route.nominal_mm, np.arange(11) * 40.0)
    assert route.axis_to(3) == "y"


@pytest.mark.parametrize(
    ("measured", "absolute", "code"),
    [
        (35.355, 100.0, ""),
        (35.355 * 1.005, 100.0, ""),
        (-35.355, 100.0, "wrong-laser-sign"),
        (-12.728, 100.0, "wrong-direction"),
        (0.001, 100.0, "no-move"),
        (22.627, 100.0, "wrong-axis-order"),
        (35.355 + 22.627, 100.0, "stop-missing"),
        (-64.0, 0.004, "laser-reset"),
        (-64.0, 36.0, "step-mismatch"),
    ],
)
def test_a_step_is_judged_by_name(measured, absolute, code):
    """Steps of ppp on 500x400x300, n = 10: x 35.355 mm, y 22.627 mm, z 12.728 mm along the
    diagonal."""
    route = make_route(BOX, "ppp", "xyz", outward=True)
    wrong = judge_step(route, 0, 1, measured, absolute)
    assert (wrong.code if wrong else "") == code


def test_from_which_end_a_cube_is_driven_the_laser_alone_cannot_tell():
    cube = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(200.0, 200.0, 200.0), increments=2)
    wrong = judge_step(make_route(cube, "ppp", "xyz", outward=True), 0, 1, -57.735, 100.0)
    assert wrong is not None
    assert wrong.key == "wrong-laser-sign.or-end"


def poll(tracker, k, *, stopped, count=None):
    """Feed poll k: asked at 20k ms, answered 5 ms later."""
    return tracker.poll(
        Signals(stopped=stopped, stop_count=count), k * 20_000_000, k * 20_000_000 + 5_000_000
    )


def test_only_between_first_answer_and_last_request_is_certain():
    tracker = DwellTracker()
    closed = [poll(tracker, k, stopped=3 <= k <= 7, count=1) for k in range(9)]
    (dwell,) = [each for each in closed if each]
    assert (dwell.from_ns, dwell.to_ns) == (65_000_000, 140_000_000)
    assert dwell.not_before_ns == 40_000_000


def test_a_new_count_is_a_new_stop_even_when_no_move_was_seen():
    tracker = DwellTracker()
    closed = [poll(tracker, k, stopped=True, count=1 + (k >= 5)) for k in range(8)]
    (first,) = [each for each in closed if each]
    assert first.signals.stop_count == 1
    assert tracker.open.from_ns == 105_000_000


def test_silence_in_a_dwell_is_bridged_by_the_same_count():
    tracker = DwellTracker()
    for k in range(3):
        poll(tracker, k, stopped=True, count=4)
    poll(tracker, 9, stopped=True, count=4)
    closed = poll(tracker, 10, stopped=False, count=4)
    assert closed.to_ns == 180_000_000


@given(before=st.integers(0, 65535), steps=st.integers(0, 65535))
def test_counter_wraps(before, steps):
    assert count_steps(before, (before + steps) % 65536) == steps


@given(
    levels=st.lists(st.integers(0, 40), min_size=1, max_size=8, unique=True),
    seed=st.integers(0, 1000),
)
def test_plateaus_are_the_standstills(levels, seed):
    """A staircase with ramps of 0.4 s between treads of 0.6 s shows every tread, at its level."""
    rng = np.random.default_rng(seed)
    position = []
    for level, following in zip(levels, [*levels[1:], levels[-1] + 50], strict=True):
        position.append(np.full(600, float(level)))
        position.append(np.linspace(level, following, 400))
    values = np.concatenate(position) + rng.normal(0, 0.3e-3, 1000 * len(levels))
    found = find_plateaus(np.arange(len(values)) * 1e6, values, 0.4)
    assert [round(each.level_mm) for each in found] == levels
    assert all(
        abs(each.level_mm - level) < 1e-3 for each, level in zip(found, levels, strict=True)
    )
