"""The factor for 95 % where the noise is known from few degrees of freedom."""

import pytest

from stepdiag.solver.methods.coverage import t_factor
from stepdiag.solver.methods.solve import solve
from testkit.exact.surveys import DIAGONALS, Bench


@pytest.mark.parametrize(
    ("freedom", "factor"),
    [(3, 3.31), (5, 2.65), (10, 2.28), (20, 2.13), (50, 2.05), (1e6, 2.0)],
)
def test_the_factor_is_that_of_the_table(freedom, factor):
    """GUM:1995, table G.2, column 95.45 %."""
    assert t_factor(freedom) == pytest.approx(factor, rel=0.02)


@pytest.mark.parametrize("states_u", [True, False])
def test_only_noise_that_nobody_stated_wants_another_factor(states_u):
    result = solve(Bench(increments=3, states_u=states_u).survey(DIAGONALS))
    assert (
        any(finding.code == "coverage-factor" for finding in result.findings) is not states_u
    )
    assert (result.coverage is not None) is not states_u
    for told in (result.coverage or {}).values():
        assert told.k > 2.1
