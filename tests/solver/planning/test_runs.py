"""Stops, readings and minutes of a planned survey."""

import numpy as np
import pytest

from stepdiag.base.errors import UsageError
from stepdiag.base.names import BODY_DIAGONALS
from stepdiag.base.readings.runs import (
    Pace,
    Plan,
    Run,
    order_of,
    perfect_readings,
    plan_minutes,
    run_minutes,
    run_stops_mm,
)
from stepdiag.base.setups import SETUP_NAMES
from stepdiag.base.volume import (
    BESIDE_EVEN,
    CLOSEST_MM,
    Volume,
    irregular_mm,
)
from stepdiag.solver.model.layout import lay_out
from testkit.stops import diagonal_stops_mm, linear_stops_mm

BOX = Volume(origin_mm=(10.0, -20.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=10)
DIAGONALS = tuple(Run(setup=name) for name in BODY_DIAGONALS)


def plan(*runs, **changes):
    return Plan(volume=BOX, runs=runs, **changes)


@pytest.mark.parametrize("setup", BODY_DIAGONALS)
@pytest.mark.parametrize("order", ["xyz", "yzx"])
def test_step_diagonals_are_those_of_the_geometry(setup, order):
    stops = run_stops_mm(plan(axis_order=order), Run(setup=setup))
    assert stops.tolist() == diagonal_stops_mm(BOX, setup, order).tolist()


def test_a_shift_of_what_does_not_stand_is_a_setup():
    shifted = Run(setup="ppp+1", beam_offset_mm=(50.0, 0.0, 0.0))
    assert run_minutes(plan(shifted), shifted) == run_minutes(
        plan(Run(setup="ppp")), Run(setup="ppp")
    )


@pytest.mark.parametrize(
    ("setup", "repeats", "driven"),
    [
        ("ppp", 1, ("xyz",)),
        ("npp+1", 2, ("xyz", "zxy")),
        ("face-xy-pp", 4, ("xyz", "zxy")),
        ("linear-x", 2, ()),
        ("fourdof-x", 2, ()),
    ],
)
def test_orders_that_no_repeat_drives_are_not_named(setup, repeats, driven):
    run = Run(setup=setup, repeats=repeats, axis_orders=("xyz", "zxy"))
    assert run.driven_orders == driven


@pytest.mark.parametrize(
    ("setup", "first"),
    [
        ("ppp", "xyz"),
        ("ppp+2", "xyz"),
        ("npp", "yzx"),
        ("pnp", "zxy"),
        ("ppn", "xyz"),
        ("linear-x", "xyz"),
        ("fourdof-x", "xyz"),
    ],
)
def test_setups_begin_with_orders_of_their_own(setup, first):
    """By their names: a survey that goes on with further setups drives the others as before."""
    orders = ("xyz", "yzx", "zxy")
    run = Run(setup=setup, repeats=3, axis_orders=orders, alternate=True)
    driven = [order_of(plan(run), run, number) for number in run.pass_numbers[::2]]
    place = orders.index(first)
    assert driven == [*orders[place:], *orders[:place]]
    assert Run(setup=setup, alternate=True).orders == ()


def test_repeats_move_their_axes_in_orders_of_their_own():
    run = Run(setup="ppp", repeats=3, axis_orders=("xyz", "zxy"))
    survey = plan(run)
    orders = [order_of(survey, run, number) for number in run.pass_numbers]
    assert orders == ["xyz", "xyz", "zxy", "zxy", "xyz", "xyz"]
    for number, order in zip(run.pass_numbers, orders, strict=True):
        outward = diagonal_stops_mm(BOX, "ppp", order)
        assert (
            run_stops_mm(survey, run, number).tolist()
            == (outward if number % 2 else outward[::-1]).tolist()
        )


def test_a_line_beside_the_usual_one_is_where_its_axes_stand():
    run = Run(setup="linear-y+1", beam_offset_mm=(500.0, 0.0, 300.0))
    stops = run_stops_mm(plan(run), run)
    assert np.ptp(stops, axis=0).tolist() == [0.0, 400.0, 0.0]
    assert stops[0].tolist() == [510.0, -20.0, 300.0]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("count", [1, 11, 40, 200])
def test_irregular_targets_are_in_step_with_nothing(axis, count):
    """The nodes are among them; between them the distances differ, and a wave of any pitch is met
    in all of its places."""
    targets = irregular_mm(BOX, axis, count)
    assert set(BOX.nodes_mm(axis)) <= set(targets)
    assert np.all(np.diff(targets) >= CLOSEST_MM * (1.0 - 2.0 * BESIDE_EVEN))
    assert np.allclose(np.round(targets, 2), targets)
    if count >= 40:
        assert len(targets) == pytest.approx(count, abs=10)
        for pitch in (5.0, 10.0, 20.0):
            place = np.sort(np.mod(targets, pitch) / pitch)
            assert np.max(np.diff(place, append=place[0] + 1.0)) < 0.5


@pytest.mark.parametrize("axis", "xyz")
def test_linear_and_fourdof_runs_go_along_one_edge(axis):
    for kind in ("linear", "fourdof"):
        assert (
            run_stops_mm(plan(), Run(setup=f"{kind}-{axis}")).tolist()
            == linear_stops_mm(BOX, f"linear-{axis}").tolist()
        )


def test_every_setup_the_solver_knows_can_be_planned():
    """The layout's own checks (route, ends, sign and unit of the laser) accept each perfect run,
    out and back."""
    runs = [Run(setup=name, repeats=2) for name in SETUP_NAMES]
    layout = lay_out(perfect_readings(plan(*runs), 0.3))
    assert len(layout.passes) == 4 * len(SETUP_NAMES)
    assert np.abs(layout.deviation_um).max() < 1e-6
    assert layout.volume == BOX


def test_shifted_beam_shifts_the_spot():
    """The part of the shift across the beam is what moves the spot."""
    here, there = (
        lay_out(perfect_readings(plan(Run(setup="ppp", beam_offset_mm=shift)), 0.3))
        for shift in ((0.0, 0.0, 0.0), (0.0, 0.0, 50.0))
    )
    along = here.direction[0]
    assert there.spot_mm - here.spot_mm == pytest.approx(
        np.tile([0, 0, 50.0] - 50.0 * along[2] * along, (62, 1))
    )


def test_minutes_by_hand():
    """X run of 500 mm out and back: 20 min to set up, 2 (500 + 20) mm at 2000 mm/min, 22 dwells of
    2 s."""
    run = Run(setup="linear-x")
    assert run_minutes(plan(run), run) == pytest.approx(20 + 2 * 520 / 2000 + 22 * 2 / 60)
    once = Run(setup="linear-x", return_pass=False, repeats=2)
    assert run_minutes(plan(once), once) == pytest.approx(
        20 + 2 * 520 / 2000 + 500 / 2000 + 22 * 2 / 60
    )


def test_four_diagonals_take_what_is_published():
    """Wang's article: 2 to 4 hours for four diagonals of one cubic metre."""
    cube = Volume(origin_mm=(0, 0, 0), size_mm=(1000, 1000, 1000), increments=20)
    assert 2.0 < plan_minutes(Plan(volume=cube, runs=DIAGONALS)) / 60 < 4.0


def test_shift_of_the_beam_is_cheaper_than_a_setup():
    pace = Pace()
    plain, shifted = Run(setup="ppp"), Run(setup="ppp+1", beam_offset_mm=(50.0, 0.0, 0.0))
    saved = run_minutes(plan(plain), plain) - run_minutes(plan(plain, shifted), shifted)
    assert saved == pytest.approx(pace.diagonal_setup_min - pace.beam_shift_min)


def test_second_run_of_a_setup_gets_the_next_number():
    grown = plan(*DIAGONALS).with_runs(
        Run(setup="ppp"), Run(setup="ppp"), Run(setup="linear-x")
    )
    assert [run.setup for run in grown.runs[4:]] == ["ppp+1", "ppp+2", "linear-x"]


def test_a_plan_of_one_run_takes_the_same_run_again():
    box = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(100.0, 100.0, 100.0), increments=2)
    again = Plan(volume=box, runs=(Run(setup="ppp"),)).with_runs(
        Run(setup="ppp"), Run(setup="ppp+1")
    )
    assert [run.setup for run in again.runs] == ["ppp", "ppp+1", "ppp+2"]


def test_plan_without_laser_is_refused():
    with pytest.raises(UsageError, match="at least one run of the laser"):
        perfect_readings(plan(Run(setup="fourdof-x")), 0.3)


def test_unknown_setup_is_refused_by_name():
    with pytest.raises(UsageError, match="pqp"):
        run_stops_mm(plan(), Run(setup="pqp"))
