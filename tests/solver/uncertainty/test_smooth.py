"""The nine displacement functions as smooth random effects."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.readings.readings import Readings
from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.solver.methods.estimate import estimate, spread_of
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.uncertainty.smooth import BENDS, falling_power
from testkit.exact.surveys import DIAGONALS, Bench


def test_the_short_waves_of_noise_leave_the_functions():
    """The shorter half of the half waves of 20 increments, where guideways have little."""
    number = np.arange(1, 20)
    short = np.sin(np.pi * np.outer(number[9:], number) / 20)
    squares = np.zeros(2)
    for seed in range(4):
        bench = Bench(seed=seed, increments=20)
        done = estimate(lay_out(bench.survey()), "FXYZ")
        for name in DISPLACEMENTS:
            true = bench.truth.errors[name]
            wanted = true[1:-1] - true[-1] * number / 20
            shape = done.quantities.select(done.quantities.of(name)).combination
            for place, fit in enumerate((done.spread.fit, spread_of(done.adjustment).fit)):
                squares[place] += np.sum((short @ (shape.times(fit.unknowns) - wanted)) ** 2)
    assert np.sqrt(squares[0] / squares[1]) < 0.7


@given(
    squares=st.lists(st.floats(0.0, 100.0), min_size=1, max_size=30),
    noise=st.floats(1e-3, 10.0),
)
def test_no_power_denies_what_the_readings_show(squares, noise):
    amount = np.sqrt(squares)
    power = falling_power(amount, np.full(len(amount), noise))
    assert np.all(power >= np.sqrt(2.0 / len(amount)) * noise * (1.0 - 1e-12))
    # the last wave that is large keeps all longer ones
    assert np.sum(power) >= np.sum(amount**2 - noise)


def test_noise_alone_has_powers_below_its_variance():
    amount = np.random.default_rng(0).normal(size=(400, 19))
    power = np.mean([np.mean(falling_power(each, np.ones(19))) for each in amount])
    assert power < 1.0


def stepped(bench: Bench, um: float) -> Readings:
    """Return the survey of a machine whose Y steps by ``um`` where X passes its middle."""
    plain = bench.survey()
    signs = np.array(
        [
            [0.0] * 3
            if name.startswith("linear")
            else [1.0 - 2.0 * (at == "n") for at in name]
            for name in plain.setup
        ]
    )
    sight = signs * bench.size_mm / np.linalg.norm(bench.size_mm)
    beyond = plain.position_mm[:, 0] > 0.55 * bench.size_mm[0]
    return replace(plain, reading_mm=plain.reading_mm + 1e-3 * um * beyond * sight[:, 1])


def test_a_step_of_a_guideway_stays_in_its_function():
    bench = Bench()
    plain, with_step = (solve(each).errors for each in (bench.survey(), stepped(bench, 4.0)))
    share = np.arange(11) / 10
    for name in DISPLACEMENTS:
        change, u = with_step[name].value - plain[name].value, with_step[name].u
        step_um = 4.0 * ((share > 0.55) - share) if name == "EYX" else 0.0 * share
        assert np.all(np.abs(change - step_um)[1:-1] <= 2.0 * u[1:-1]), name


def test_functions_that_the_readings_do_not_identify_stay_unidentified():
    """One diagonal alone: no function is known, whatever its smoothness."""
    layout = lay_out(Bench().survey(DIAGONALS[:1]))
    done = estimate(layout, "FXYZ")
    assert BENDS not in done.spread.names
    assert not any(done.known[name] for name in DISPLACEMENTS)


def test_what_is_smooth_is_known_better_and_never_worse():
    done = estimate(lay_out(Bench(angle_urad=0.0).survey()), "FXYZ")
    before = spread_of(done.adjustment)
    rows = np.concatenate([done.quantities.of(name) for name in DISPLACEMENTS])
    shape = done.quantities.select(rows).combination

    def variance(spread):
        alone = np.sum(shape.dense() * spread.fit.inverse.solve(shape.dense().T).T, axis=1)
        return alone + spread.variance(spread.moved(shape))

    ratio = variance(done.spread) / variance(before)
    assert np.max(ratio) < 1.0 + 1e-6
    assert np.mean(ratio) == pytest.approx(0.8, abs=0.15)
