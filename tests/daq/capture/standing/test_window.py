"""The mean of a standing laser and how sure it is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.daq.capture.standing.window import summarise


def correlated(rng, count, sigma_um, memory):
    """Return first-order autoregressive noise with a standard deviation, um."""
    white = rng.normal(0.0, sigma_um * np.sqrt(1 - memory**2), count)
    out = np.empty(count)
    out[0] = rng.normal(0.0, sigma_um)
    for index in range(1, count):
        out[index] = memory * out[index - 1] + white[index]
    return out


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.98])
def test_stated_uncertainty_is_the_real_one(memory):
    """Over many windows the spread of the means agrees with the stated uncertainty, correlation or
    not."""
    rng = np.random.default_rng(4)
    time_s = np.arange(2000) / 1000.0
    windows = [
        summarise(time_s, 10.0 + correlated(rng, 2000, 0.3, memory) * 1e-3)
        for _ in range(120)
    ]
    spread = np.std([window.mean_mm * 1e3 for window in windows], ddof=1)
    stated = np.sqrt(np.mean([window.u_um**2 for window in windows]))
    assert 0.75 < stated / spread < 1.3


def test_wrong_lines_do_not_move_the_stop():
    rng = np.random.default_rng(5)
    position = 100.0 + rng.normal(0, 0.3e-3, 500)
    spoilt = position.copy()
    spoilt[[10, 200, 333]] += [5.0, -0.02, 250.0]
    clean, dirty = (
        summarise(np.arange(500) / 500, position),
        summarise(np.arange(500) / 500, spoilt),
    )
    assert dirty.rejected == 3
    assert abs(dirty.mean_mm - clean.mean_mm) * 1e3 < clean.u_um


def test_trend_is_seen_and_its_doubt_stated():
    rng = np.random.default_rng(6)
    time_s = np.arange(1000) / 1000.0
    window = summarise(time_s, 1.0 + 4e-3 * time_s + rng.normal(0, 0.3e-3, 1000))
    assert window.slope_um_s == pytest.approx(4.0, abs=4 * window.u_slope_um_s)
    assert window.u_slope_um_s < 0.2


def test_equal_samples_are_as_sure_as_the_resolution():
    """Where all samples agree the least step still limits the mean; a step of 79 nm (uMD homodyne)
    gives 23 nm."""
    still = summarise(np.arange(100) / 100, np.full(100, 12.5))
    assert 0 < still.u_um < 0.01
    stepped = summarise(np.arange(100) / 100, 12.5 + 79e-6 * (np.arange(100) % 2))
    assert stepped.u_um == pytest.approx(0.0228, rel=0.3)


@given(values=st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=60))
def test_never_fails_and_stays_within_the_samples(values):
    window = summarise(np.arange(len(values), dtype=float), np.array(values))
    assert min(values) - 1e-9 <= window.mean_mm <= max(values) + 1e-9
    assert np.isfinite([window.u_um, window.scatter_um, window.slope_um_s]).all()
    assert window.used + window.rejected == len(values)
