"""A window against itself: steps, frozen values and too many outliers are named, noise and drift
are not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.daq.capture.standing.window import (
    against_itself,
    on_the_way,
    step_in_um,
    summarise,
)


def doubts(values_um, resolution_um=0.001):
    """Return the codes that a window of these readings earns; a thousand samples a second."""
    values = 500.0 + np.asarray(values_um) * 1e-3
    return [
        doubt.code
        for doubt in against_itself(
            values, summarise(np.arange(len(values)) / 1e3, values), resolution_um
        )
    ]


@given(
    size=st.sampled_from([-200.0, -20.0, -5.0, -2.0, 2.0, 5.0, 20.0, 200.0]),
    at=st.floats(0.15, 0.85),
    count=st.integers(60, 1500),
    seed=st.integers(0, 99),
)
def test_a_step_inside_the_dwell_is_found_with_its_size(size, at, count, seed):
    values = np.random.default_rng(seed).normal(0, 0.2, count) + size * (
        np.arange(count) >= at * count
    )
    assert step_in_um(values * 1e-3) == pytest.approx(size, abs=0.4)
    assert doubts(values) == ["window-step"]


def test_a_step_near_the_end_shows_as_samples_thrown_away():
    values = np.random.default_rng(1).normal(0, 0.2, 500) + 20.0 * (np.arange(500) >= 460)
    assert doubts(values) == ["window-step"]


@given(seed=st.integers(0, 300), count=st.integers(30, 1500))
def test_noise_drift_and_vibration_are_no_step(seed, count):
    rng = np.random.default_rng(seed)
    time_s = np.arange(count) / 1e3
    noise = rng.normal(0, 0.2, count)
    assert doubts(noise) == []
    assert doubts(noise + rng.uniform(-5, 5) * time_s) == []
    assert (
        step_in_um(
            1e-3
            * (
                noise
                + 3.0 * np.sin(2 * np.pi * rng.uniform(8, 60) * time_s + rng.uniform(0, 6))
            )
        )
        == 0.0
    )


def test_a_few_wrong_lines_are_no_doubt_and_many_are():
    values = np.random.default_rng(2).normal(0, 0.2, 600)
    values[[5, 99, 300]] += [40.0, -7.0, 3000.0]
    assert doubts(values) == []
    values[::20] += 30.0
    assert doubts(values) == ["window-step"]


def test_a_frozen_value_is_named_where_the_instrument_never_rests():
    """A display of 0.1 µm may well stand still; an interferometer that resolves nanometres never
    does."""
    frozen = np.full(300, 12.5)
    assert doubts(frozen, resolution_um=0.0012) == ["laser-frozen"]
    assert doubts(frozen, resolution_um=0.1) == []
    assert doubts(frozen, resolution_um=np.inf) == [], "it has not moved yet: nobody knows"


def test_equal_samples_are_as_sure_as_the_instruments_resolution():
    """0.1 µm / sqrt(12), the standard uncertainty of a rectangular distribution (GUM 4.3.7)."""
    still = summarise(np.arange(40) / 40, np.full(40, 12.5), 0.1)
    assert still.u_um == pytest.approx(0.0289, abs=1e-4)


def test_a_machine_that_leaves_in_the_last_scan_of_its_plc_is_no_doubt():
    """The PLC says up to a scan too long that the machine stands: seven samples of 190 that go
    further and further away."""
    quiet = np.random.default_rng(3).normal(0, 0.3, 190)
    leaves, jumps, gone = quiet.copy(), quiet.copy(), quiet.copy()
    leaves[-7:] += [78.1, 326.5, 744.1, 1332.0, 2088.5, 3015.3, 4113.0]
    jumps[-7:] += 78.0
    gone[-40:] += 50.0 * np.arange(1, 41)
    assert doubts(leaves) == []
    assert doubts(jumps) == ["window-step"], "it jumps and stays: a slip of the count"
    assert doubts(gone) == ["window-step"], "a fifth of the window is no scan of a PLC"


@given(
    step_um=st.sampled_from([-5000.0, -300.0, -30.0, 30.0, 300.0, 5000.0]),
    move=st.integers(3, 60),
    scan=st.integers(4, 19),
    sigma_um=st.sampled_from([0.02, 0.2]),
    seed=st.integers(0, 1000),
)
def test_who_has_left_and_stands_elsewhere_within_a_scan_is_no_doubt_and_a_slip_is(
    step_um, move, scan, sigma_um, seed
):
    """A short move is over before the PLC looks again: 8 of 467 samples of a move of 2 mm were
    taken for a step."""
    quiet = np.random.default_rng(seed).normal(0, sigma_um, 200)
    moved, slipped = quiet.copy(), quiet.copy()
    done = np.clip(np.arange(1, scan + 1) / move, 0.0, 1.0)
    moved[-scan:] += step_um * done**2 * (3.0 - 2.0 * done)
    slipped[-scan:] += step_um
    assert doubts(moved) == []
    assert scan <= 5 or doubts(slipped) == ["window-step"], (
        "fewer are single wrong lines, thrown away without a word"
    )


@pytest.mark.parametrize(
    ("first_um", "moves"), [((-900, -400, -60, 8), True), ((5,) * 4, False)]
)
def test_an_arrival_is_told_from_a_slip_near_the_begin(first_um, moves):
    """A slip of the count leaves its samples on a level of their own."""
    position_mm = np.random.default_rng(3).normal(0, 2e-4, 90)
    position_mm[:4] += 1e-3 * np.array(first_um)
    assert on_the_way(position_mm) is moves
