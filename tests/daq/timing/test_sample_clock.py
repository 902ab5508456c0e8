"""Sample times from arrivals that are late by chance."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.daq.timing.sample_clock import SampleClock, lower_line
from testkit.examples import few

START_NS = 5_000_000_000_000


def arrivals_of(rng, count, rate_hz, ppm, fixed_ms, mean_ms, timer_ms=0.0):
    """Return true sample times and arrivals (ns): fixed delay, exponential scheduling, 0.1 % stalls
    of 20 ms, optional USB timer."""
    true = START_NS + np.arange(count) * (1e9 / rate_hz) * (1 + ppm * 1e-6)
    delay = (
        fixed_ms * 1e6
        + rng.exponential(mean_ms * 1e6, count)
        + (rng.random(count) < 1e-3) * rng.exponential(20e6, count)
    )
    late = np.maximum.accumulate(true + delay)
    if timer_ms:
        late = np.ceil(late / (timer_ms * 1e6)) * timer_ms * 1e6
    return true, late.astype(np.int64)


def estimated(clock, true, late):
    """Feed samples in chunks that share an arrival; return the error of all sample times in ms."""
    for arrival in np.unique(late):
        clock.add(int(np.flatnonzero(late == arrival)[-1]), int(arrival))
    return (clock.times_ns(np.arange(len(true))) - true) * 1e-6


def test_reference_case_direct_arrival():
    """60 s at 1 kHz, 35 ppm, 1.2 ms fixed delay: bias 1.20 ms, the true fixed delay (instruments.md
    6.2, row 'direct')."""
    true, late = arrivals_of(np.random.default_rng(1), 60_000, 1000.0, 35.0, 1.2, 0.2)
    error = estimated(SampleClock(1000.0), true, late)
    assert abs(error.mean() - 1.2) < 0.02
    assert error.std() < 0.02


def test_reference_case_usb_timer():
    """Behind a 16 ms timer least squares is late by 9.9 ms; the lower line by 1.21 ms
    (instruments.md 6.2, row 'FTDI')."""
    true, late = arrivals_of(
        np.random.default_rng(2), 60_000, 1000.0, 35.0, 1.2, 0.2, timer_ms=16.0
    )
    error = estimated(SampleClock(1000.0), true, late)
    assert abs(error.mean() - 1.21) < 0.25


@few(15)
@given(
    seed=st.integers(0, 2**32 - 1),
    ppm=st.floats(-100, 100),
    fixed=st.floats(0, 5),
    known=st.booleans(),
)
def test_never_early_and_soon_right(seed, ppm, fixed, known):
    """A sample is never placed before it was taken by more than the rate's error over ten seconds,
    nor long after it arrived."""
    true, late = arrivals_of(np.random.default_rng(seed), 6_000, 244.1395, ppm, fixed, 0.2)
    error = estimated(SampleClock(244.1395 if known else None), true, late)
    assert error.min() > fixed - 1.1
    assert error.max() < fixed + 3.0


def test_latency_of_the_instrument_is_taken_off():
    clock = SampleClock(1000.0, latency_s=0.039)
    clock.add(0, START_NS)
    clock.add(1000, START_NS + 1_000_000_000)
    assert clock.times_ns(np.array([500]))[0] == START_NS + 500_000_000 - 39_000_000


def test_silent_skip_moves_the_line_by_one_period():
    """uMD0 drops a sample without counting it: later samples are one period (4.096 ms) later than
    the counter says."""
    rng = np.random.default_rng(3)
    period = 1e9 / 244.1395
    counters = np.arange(12_000)
    true = START_NS + counters * period + (counters >= 6_000) * period
    clock = SampleClock(244.1395, gaps_visible=False)
    kept = [
        clock.add(int(k), int(t + 1e6 + rng.exponential(2e5)))
        for k, t in zip(counters, true, strict=True)
    ]
    assert kept.count(False) == 1
    assert kept.index(False) > 6_000
    error = (clock.times_ns(counters[9_000:]) - true[9_000:]) * 1e-6
    assert np.abs(error - 1.0).max() < 0.3


@given(points=st.lists(st.floats(0, 1e6), min_size=2, max_size=50))
def test_lower_line_lies_under_all_points(points):
    counters = np.arange(len(points), dtype=float)
    arrivals = np.array(points)
    offset, slope = lower_line(counters, arrivals)
    assert np.all(arrivals >= offset + slope * counters - 1e-6 * (1 + np.abs(arrivals).max()))


@given(points=st.lists(st.integers(0, 1000), min_size=3, max_size=12))
def test_lower_line_is_the_nearest_one(points):
    """No other line under the points through two of them lies nearer on average."""
    counters = np.arange(len(points), dtype=float)
    arrivals = np.array(points, dtype=float)
    offset, slope = lower_line(counters, arrivals)
    distance = np.mean(arrivals - offset - slope * counters)
    for a in range(len(points)):
        for b in range(a + 1, len(points)):
            other = (arrivals[b] - arrivals[a]) / (b - a)
            gaps = arrivals - arrivals[a] - other * (counters - a)
            assert gaps.min() < -1e-9 or np.mean(gaps) >= distance - 1e-9
