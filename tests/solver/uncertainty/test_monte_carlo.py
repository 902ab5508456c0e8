"""Monte Carlo through the estimator (JCGM 101) beside the law of propagation, and its shortest
intervals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.result.typed import written
from stepdiag.solver.methods.estimate import estimate
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.uncertainty.monte_carlo import monte_carlo, shortest_interval
from testkit.exact.surveys import Bench


def test_drawn_surveys_scatter_as_the_result_states():
    """Within 10 % for every number and every function (rms): noise, causes, and that their sizes
    are not known."""
    done = estimate(lay_out(Bench(angle_urad=10.0, increments=5).survey()), "FXYZ")
    drawn = monte_carlo(done.spread, done.quantities.combination, trials=20_000)
    for name in done.quantities.groups:
        rows = done.quantities.of(name)
        assert np.sqrt(np.mean(drawn.u[rows] ** 2)) == pytest.approx(
            np.sqrt(np.mean(done.u[rows] ** 2)), rel=0.1
        ), name


def test_a_result_says_how_drawn_surveys_scatter_beside_its_own_u():
    """JCGM 101, 5.3.4 and 7.9: the shortest 95 % interval of a number; a function has one figure,
    the rms over its nodes."""
    told = written(solve(Bench(increments=3).survey(), monte_carlo=4000).monte_carlo)
    assert told["trials"] == 4000
    assert told["EYX"].keys() == {"u", "u_stated"}
    for name in ("EYX", "C0Y", "X"):
        assert told[name]["u"] == pytest.approx(told[name]["u_stated"], rel=0.1), name
    for name in ("C0Y", "X"):
        assert told[name]["low"] < 0 < told[name]["high"]
        assert told[name]["high"] - told[name]["low"] == pytest.approx(
            2 * 1.96 * told[name]["u_stated"], rel=0.2
        )
    assert solve(Bench(increments=3).survey()).monte_carlo is None


def test_the_same_seed_gives_the_same_intervals():
    done = estimate(lay_out(Bench(increments=3).survey()), "FXYZ")
    one, other = (
        monte_carlo(done.spread, done.quantities.combination, trials=500, seed=3)
        for _ in range(2)
    )
    assert np.array_equal(one.low, other.low)
    assert np.array_equal(one.high, other.high)


@given(st.integers(20, 400), st.floats(0.5, 0.99), st.integers(0, 1000))
def test_shortest_interval_holds_its_share_and_no_shorter_one_does(count, probability, seed):
    samples = np.random.default_rng(seed).standard_exponential(count)
    low, high = shortest_interval(samples[None, :], probability)
    kept = int(np.ceil(probability * count))
    assert np.count_nonzero((samples >= low[0]) & (samples <= high[0])) >= kept
    ordered = np.sort(samples)
    assert high[0] - low[0] == pytest.approx(
        np.min(ordered[kept - 1 :] - ordered[: count - kept + 1])
    )
