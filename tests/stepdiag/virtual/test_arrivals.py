"""How the axes come to the stops: an axis that does not move keeps its place, and the registers
show what the encoders see."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.virtual.drive.registers import PositionRegisters
from stepdiag.virtual.drive.sequence import Box, driven_pass
from stepdiag.virtual.physics.error_functions import ErrorSet
from stepdiag.virtual.physics.machine import Machine
from testkit.ordinary.arrivals import Scatter, Standing, arrivals, standing_at_end
from testkit.ordinary.measured import Conditions, simulate_pass

BOX = Box(size_mm=(300.0, 200.0, 100.0), increments=4)
PERFECT = Machine(errors=ErrorSet(low_mm=BOX.origin_mm, size_mm=BOX.size_mm))
SCATTER = Scatter(arrival_um=(0.5, 1.0, 2.0), servo_um=(3.0, 0.0, 1.0))
SETUPS = st.sampled_from(["ppp", "npp", "pnp", "ppn", "linear-x", "linear-z"])
ORDERS = st.sampled_from(["xyz", "yzx", "zyx"])


def elsewhere():
    return Standing(
        np.array([-10.0, 500.0, 50.0]),
        np.ones(3),
        np.array([0.1, 0.2, 0.3]),
        np.array([1.1, 1.2, 1.3]),
    )


@given(
    setup=SETUPS,
    number=st.integers(1, 4),
    order=ORDERS,
    overrun=st.booleans(),
    seed=st.integers(0, 99),
)
def test_an_axis_that_does_not_move_keeps_its_place_and_its_side(
    setup, number, order, overrun, seed
):
    driven = driven_pass(BOX, setup, number, order)
    came = arrivals(
        driven, SCATTER, np.random.default_rng(seed), before=elsewhere(), overrun=overrun
    )
    moved = np.diff(driven.stop_mm, axis=0) != 0.0
    for values in (came.arrival_um, came.servo_um, came.side):
        assert np.all(np.diff(values, axis=0)[~moved] == 0.0)
    assert np.all(np.diff(came.arrival_um, axis=0)[moved] != 0.0)
    assert np.all(came.side[1:][moved] == np.sign(np.diff(driven.stop_mm, axis=0))[moved])


def test_the_errors_of_arrival_have_the_sizes_of_their_axes():
    driven = driven_pass(Box(size_mm=BOX.size_mm, increments=4000), "npp", 1)
    came = arrivals(driven, SCATTER, np.random.default_rng(1))
    moved = np.vstack([np.ones((1, 3), dtype=bool), np.diff(driven.stop_mm, axis=0) != 0.0])
    for axis in range(3):
        assert np.std(came.arrival_um[moved[:, axis], axis]) == pytest.approx(
            SCATTER.arrival_um[axis], rel=0.05
        )
        assert np.std(came.servo_um[moved[:, axis], axis]) == pytest.approx(
            SCATTER.servo_um[axis], rel=0.05
        )


def test_with_overrun_every_axis_comes_to_the_first_stop_in_the_direction_of_the_pass():
    came = arrivals(
        driven_pass(BOX, "npp", 1),
        SCATTER,
        np.random.default_rng(1),
        before=elsewhere(),
        overrun=True,
    )
    assert came.side[0].tolist() == [-1.0, 1.0, 1.0]
    assert not np.any(np.isin(came.arrival_um[0], elsewhere().arrival_um))


def test_without_overrun_the_axes_come_straight_from_where_they_stood():
    came = arrivals(
        driven_pass(BOX, "ppp", 1),
        SCATTER,
        np.random.default_rng(1),
        before=elsewhere(),
        overrun=False,
    )
    assert came.side[0].tolist() == [1.0, -1.0, -1.0]


def test_at_a_turn_without_overrun_nothing_moves():
    """The return pass begins where the outward pass ended: the same sides, the same errors, until
    each axis moves."""
    rng = np.random.default_rng(1)
    out, back = driven_pass(BOX, "ppp", 1), driven_pass(BOX, "ppp", 2)
    went = arrivals(out, SCATTER, rng, before=elsewhere())
    came = arrivals(back, SCATTER, rng, before=standing_at_end(out, went), overrun=False)
    for name in ("side", "arrival_um", "servo_um"):
        assert getattr(came, name)[0].tolist() == getattr(went, name)[-1].tolist()
    assert came.side[1:4].tolist() == [
        [1.0, 1.0, -1.0],
        [1.0, -1.0, -1.0],
        [-1.0, -1.0, -1.0],
    ]


def test_a_run_along_one_axis_leaves_the_others_where_they_are():
    first = driven_pass(BOX, "linear-y", 1)
    before = Standing(first.stop_mm[0], np.ones(3), np.array([0.1, 0.2, 0.3]), np.zeros(3))
    came = arrivals(first, SCATTER, np.random.default_rng(1), before=before, overrun=True)
    assert np.all(came.arrival_um[:, [0, 2]] == [0.1, 0.3])
    assert came.arrival_um[0, 1] != 0.2


@given(setup=SETUPS, seed=st.integers(0, 99))
def test_the_laser_sees_the_component_of_the_arrivals_along_the_beam(setup, seed):
    noisy = Conditions(scatter=SCATTER, seed=seed)
    taken, ideal = (
        simulate_pass(PERFECT, BOX, setup, conditions=how)
        for how in (noisy, Conditions(seed=seed))
    )
    came = arrivals(driven_pass(BOX, setup, 1), SCATTER, np.random.default_rng((seed, 1)))
    travel = ideal.position_mm[-1] - ideal.position_mm[0]
    along = came.off_mm @ (travel / np.linalg.norm(travel))
    assert taken.reading_mm - ideal.reading_mm == pytest.approx(along - along[0], abs=1e-9)


def test_commanded_registers_show_the_program_whatever_the_axes_do():
    taken = simulate_pass(PERFECT, BOX, "ppp", conditions=Conditions(scatter=SCATTER))
    assert taken.position_mm.tolist() == driven_pass(BOX, "ppp", 1).stop_mm.tolist()


def test_actual_registers_show_what_the_encoders_see_and_no_more():
    """The error at standstill is in the register and in the reading; what is beyond the encoder is
    in the reading alone."""
    seen = Conditions(
        scatter=Scatter(servo_um=(3.0, 3.0, 3.0)),
        registers=PositionRegisters(shows="actual"),
        seed=5,
    )
    taken = simulate_pass(PERFECT, BOX, "ppp", conditions=seen)
    off = taken.position_mm - driven_pass(BOX, "ppp", 1).stop_mm
    assert np.std(off) == pytest.approx(3e-3, rel=0.5)
    travel = np.array(BOX.size_mm) / np.linalg.norm(BOX.size_mm)
    shown = taken.position_mm @ travel
    assert taken.reading_mm == pytest.approx(shown - shown[0], abs=1e-9)
    unseen = Conditions(
        scatter=Scatter(arrival_um=(3.0, 3.0, 3.0)),
        registers=PositionRegisters(shows="actual"),
        seed=5,
    )
    assert (
        simulate_pass(PERFECT, BOX, "ppp", conditions=unseen).position_mm.tolist()
        == driven_pass(BOX, "ppp", 1).stop_mm.tolist()
    )


def test_registers_that_scatter_do_not_move_the_machine():
    how = Conditions(registers=PositionRegisters(shows="actual", scatter_um=2.0), seed=5)
    taken, ideal = (
        simulate_pass(PERFECT, BOX, "ppp", conditions=how),
        simulate_pass(PERFECT, BOX, "ppp"),
    )
    assert taken.reading_mm.tolist() == ideal.reading_mm.tolist()
    assert np.std(taken.position_mm - ideal.position_mm) == pytest.approx(2e-3, rel=0.4)


def test_registers_show_their_last_digit():
    shown = PositionRegisters(shows="actual", scatter_um=2.0, resolution_mm=1e-3).shown_mm(
        np.full((5, 3), 100.0), np.zeros((5, 3)), np.random.default_rng(1)
    )
    assert shown == pytest.approx(shown.round(3), abs=1e-12)
    assert len(np.unique(shown)) > 1


@pytest.mark.parametrize(("incremental", "end"), [(False, 500.0), (True, 500.01)])
def test_the_rounding_of_an_incremental_program_adds_up(incremental, end):
    """500 mm in 7 steps: 71.43 mm seven times is 500.01 mm."""
    box = Box(
        size_mm=(500.0, 350.0, 210.0), increments=7, decimals=2, incremental=incremental
    )
    out, back = driven_pass(box, "ppp", 1), driven_pass(box, "ppp", 2)
    assert out.stop_mm[-1] == pytest.approx([end, 350.0, 210.0])
    assert back.stop_mm.tolist() == out.stop_mm[::-1].tolist()
    assert driven_pass(box, "npp", 1).stop_mm[-1][0] == pytest.approx(500.0 - end)
