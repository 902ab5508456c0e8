"""Monte Carlo against distributions with known intervals (JCGM 101)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.solver.uncertainty.budget import Source, budget
from stepdiag.solver.uncertainty.monte_carlo import confirms, monte_carlo, shortest_interval

ONE = np.array([[1.0]])


def source(pattern, distribution="normal"):
    return Source(name="s", text="", pattern_um=np.asarray(pattern, dtype=float), distribution=distribution)


def test_sum_of_four_normals_is_the_example_of_the_guide():
    """JCGM 101, 9.2.2: four standard normals: u = 2.0, shortest 95 % interval [-3.92, 3.92]."""
    found = monte_carlo(np.ones((1, 4)), [source(np.ones(4))])
    assert found.u == pytest.approx([2.0], abs=0.01)
    assert (found.low[0], found.high[0]) == pytest.approx((-3.92, 3.92), abs=0.05)
    assert confirms(found, np.array([2.0])).tolist() == [True]


def test_sum_of_four_rectangular_is_the_example_of_the_guide():
    """JCGM 101, 9.2.3: four rectangular of unit standard deviation: 95 % interval [-3.88, 3.88], not 3.92."""
    found = monte_carlo(np.ones((1, 4)), [source(np.ones(4), "rectangular")])
    assert found.u == pytest.approx([2.0], abs=0.01)
    assert (found.low[0], found.high[0]) == pytest.approx((-3.88, 3.88), abs=0.05)


def test_effect_of_known_sign_gives_a_lopsided_interval():
    """Uniform from 0 with rms 1 um: 0 to sqrt 3; the budget counts its root mean square about zero."""
    found = monte_carlo(ONE, [source([1.0], "one-sided")])
    assert found.mean == pytest.approx([np.sqrt(3) / 2], abs=0.01)
    assert (found.high - found.low)[0] == pytest.approx(0.95 * np.sqrt(3), abs=0.01)
    assert found.low[0] >= 0.0
    assert not confirms(found, np.array([1.0]))[0]


@given(st.integers(0, 2**32 - 1))
def test_many_causes_spread_as_the_budget_says(seed):
    """Normal sources are drawn as one; their spread must not notice."""
    rng = np.random.default_rng(seed)
    gain = rng.normal(size=(3, 5))
    sources = [
        source(rng.uniform(0.1, 1, 5)),
        source(rng.uniform(0.1, 1, 5)),
        source(rng.normal(size=(5, 9))),
        source(rng.normal(size=(5, 2)), "rectangular"),
    ]
    found = monte_carlo(gain, sources, trials=20_000, seed=seed)
    assert found.u == pytest.approx(budget(gain, sources).combined, rel=0.04)


def test_same_seed_same_interval():
    first, second = (monte_carlo(ONE, [source([1.0])], trials=1000, seed=3) for _ in range(2))
    assert (first.low, first.high) == (second.low, second.high)


def brute_force(samples, probability):
    ordered = np.sort(samples)
    kept = int(np.ceil(probability * len(ordered)))
    widths = ordered[kept - 1 :] - ordered[: len(ordered) - kept + 1]
    best = int(np.argmin(widths))
    return ordered[best], ordered[best + kept - 1]


@given(st.integers(0, 2**32 - 1), st.integers(20, 400), st.sampled_from([0.5, 0.9, 0.95]))
def test_shortest_interval_is_the_shortest(seed, count, probability):
    samples = np.random.default_rng(seed).exponential(size=(2, count))
    low, high = shortest_interval(samples, probability)
    for row in range(2):
        assert (low[row], high[row]) == brute_force(samples[row], probability)
