"""Backlash and reversal from one unbroken count, against the exact machine."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.solver.methods.estimate import backlash_numbers, estimate
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench
from testkit.examples import spread

FULL = (*DIAGONALS, *LINEAR)
TRUE_UM = {"X": 8.0, "Y": 5.0, "Z": 3.0}


def constant(value):
    return lambda position_mm: np.full_like(position_mm, value, dtype=float)


PLAY = {"EXX": constant(8.0), "EYY": constant(5.0), "EZZ": constant(3.0)}


def remaining_um(bench, result):
    points = bench.lattice_mm()
    left = without_rigid_motion(
        result.volume, points, bench.machine.error_at(points) - error_field_um(result, points)
    )
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def test_constant_backlash_of_each_axis_is_found_within_its_uncertainty():
    """Truth 8 / 5 / 3 µm: of 24 values 90 % and more lie within U, and U says a micrometre."""
    inside = []
    for seed in spread(range(8), 2):
        found = backlash_numbers(
            estimate(
                lay_out(
                    Bench(seed=seed, increments=5, reversal=PLAY).survey(
                        passes=(1, 2), joined=True
                    )
                ),
                "FXYZ",
            )
        )
        numbers = {axis: getattr(found, axis) for axis in "XYZ"}
        inside += [
            abs(numbers[axis].value - true) <= 2 * numbers[axis].u
            for axis, true in TRUE_UM.items()
        ]
        assert max(number.u for number in numbers.values()) < 0.6
    assert np.mean(inside) >= 0.9


def test_the_reversal_functions_hold_their_value_and_say_that_it_is_known():
    reversal = solve(Bench(seed=3, reversal=PLAY).survey(passes=(1, 2), joined=True)).reversal
    for name, true in zip(("EXX", "EYY", "EZZ"), TRUE_UM.values(), strict=True):
        assert np.all(np.abs(reversal[name].value - true) < 3 * reversal[name].u)
        assert reversal[name].u[0] > 0.0
    # lateral: three diagonals' worth of sums, never one function by itself
    assert reversal["EYX"].u[0] == 0.0


def test_backlash_that_varies_is_followed():
    """2 µm at the low end, 6 at the high end: what reversal changes is found from the data, not
    held."""
    bench = Bench(seed=1, reversal={"EXX": lambda p: 2.0 + 4.0 * p / 500.0})
    result = solve(bench.survey(passes=(1, 2), joined=True))
    assert np.all(
        np.abs(result.reversal["EXX"].value - np.linspace(2, 6, 11))
        < 3 * result.reversal["EXX"].u
    )


def test_without_a_common_zero_there_is_no_backlash_number():
    result = solve(Bench(seed=1, reversal=PLAY).survey(passes=(1, 2)))
    assert result.backlash is None
    assert result.reversal["EXX"].value[0] == 0.0
    assert "iso230-plan.zero" in {finding.key for finding in result.findings}


def test_without_linear_runs_the_backlash_of_one_axis_is_not_guessed():
    """Each diagonal sees a sum over the axes."""
    assert (
        solve(
            Bench(seed=1, reversal=PLAY).survey(DIAGONALS, passes=(1, 2), joined=True)
        ).backlash
        is None
    )


def test_a_common_zero_does_not_change_a_machine_without_reversal():
    bench = Bench(seed=4, diagonal_noise_um=0.001, linear_noise_um=0.001)
    apart, joined = (solve(bench.survey(passes=(1, 2), joined=one)) for one in (False, True))
    for name, function in apart.errors.items():
        assert joined.errors[name].value == pytest.approx(function.value, abs=0.02)
    assert all(
        abs(number.value) < 0.02
        for number in (joined.backlash.X, joined.backlash.Y, joined.backlash.Z)
    )


def test_out_and_back_diagonals_beside_one_way_linear_runs_are_no_worse_than_one_way():
    """Four machines with 8 / 5 / 3 µm of backlash: more readings of the same machine bring no
    less."""
    benches = [Bench(seed=seed, increments=5, reversal=PLAY) for seed in range(4)]
    one_way = [remaining_um(bench, solve(bench.survey())) for bench in benches]
    both = [
        remaining_um(bench, solve(bench.survey(passes=(1, 2), linear_passes=(1,))))
        for bench in benches
    ]
    assert np.sqrt(np.mean(np.square(both))) <= np.sqrt(np.mean(np.square(one_way)))


def test_a_count_lost_in_the_middle_of_a_pass_costs_the_move_across_it_and_nothing_else():
    bench = Bench(seed=2)
    readings = bench.survey(passes=(1, 2), joined=True)
    lost = (np.array(readings.setup) == "npp") & (
        (readings.pass_number > 1) | (readings.stop > 12)
    )
    off = replace(
        readings,
        reading_mm=readings.reading_mm + np.where(lost, 7.0, 0.0),
        zero=np.where(lost, 2, readings.zero),
    )
    whole, broken = solve(readings), solve(off)
    assert remaining_um(bench, broken) < 1.2 * remaining_um(bench, whole)
    assert not [
        finding for finding in broken.findings if finding.key.startswith(("stop-", "step-"))
    ]


def test_readings_of_a_stretch_are_relative_to_its_first_row_whatever_that_reads():
    readings = Bench(seed=2).survey(passes=(1, 2), joined=True)
    shifted = replace(readings, reading_mm=readings.reading_mm + 123.456)
    assert lay_out(shifted).deviation_um == pytest.approx(
        lay_out(readings).deviation_um, abs=1e-6
    )


def read_in_joined_counts(bench, passes_of):
    """Return a survey of which each setup was driven ``passes_of(setup)`` times, each on one
    unbroken count."""
    readings = bench.survey(passes=(1, 2), joined=True)
    return readings.select(
        [
            row
            for row, (name, number) in enumerate(
                zip(readings.setup, readings.pass_number, strict=True)
            )
            if number <= passes_of(name)
        ]
    )


@pytest.mark.parametrize(
    "passes_of",
    [
        lambda name: 2 if name in LINEAR else 1,
        lambda name: 1 if name == "ppn" else 2,
        lambda name: 2 if name == "linear-x" else 0,
    ],
    ids=["runs both ways", "all but one both ways", "one run alone"],
)
def test_backlash_is_no_step_of_the_count_where_only_some_setups_were_driven_both_ways(
    passes_of,
):
    """Truth 8 / 5 / 3 µm in repeatable readings, that the count of no setup jumped by."""
    for seed in spread(range(4), 2):
        bench = Bench(seed=seed, increments=5, reversal=PLAY)
        result = solve(read_in_joined_counts(bench, passes_of))
        assert not [
            each
            for each in result.findings
            if each.severity == "error" or each.key in ("count-step", "stop-outlier")
        ]
        found = result.backlash.X
        assert abs(found.value - TRUE_UM["X"]) <= 2.5 * found.u


def begun_from_within(readings, backlash_um):
    """Return the readings of passes without overrun: each axis came to the first stop from the
    other side, until it moves."""
    reading = readings.reading_mm.copy()
    for rows in map(np.array, readings.passes().values()):
        position = readings.position_mm[rows]
        travel = position[-1] - position[0]
        moved = np.abs(position - position[0]) > 1.0
        reading[rows] -= (
            1e-3
            * backlash_um
            * np.sum(moved * np.abs(travel), axis=1)
            / np.linalg.norm(travel)
        )
    return replace(readings, reading_mm=reading)


@pytest.mark.parametrize("backlash_um", spread([20.0, 5.0], 2))
def test_backlash_at_first_stops_without_overrun_is_one_size_of_each_axis(backlash_um):
    """Driven once, the same 20 µm stand in the first stops of every pass: they are no chance, and
    cost the scales little."""
    left, without, inside = [], [], []
    for seed in spread(range(4), 2):
        bench = Bench(seed=seed)
        readings = bench.survey()
        result = solve(begun_from_within(readings, backlash_um))
        assert not [finding for finding in result.findings if finding.severity == "error"]
        left.append(remaining_um(bench, result))
        without.append(remaining_um(bench, solve(readings)))
        inside += [
            abs(result.scale[axis].value - bench.truth.scale_um_m[axis])
            <= 2.0 * result.scale[axis].u
            for axis in "XYZ"
        ]
    assert np.sqrt(np.mean(np.square(left))) < 1.5 * np.sqrt(np.mean(np.square(without)))
    assert np.mean(inside) >= 0.75
