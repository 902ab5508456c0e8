"""The budget by hand-worked propagation, and its parts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.solver.uncertainty.budget import Source, budget, covariance, with_tilt_share

DIFFERENCE_AND_MEAN = np.array([[1.0, -1.0], [0.5, 0.5]])
NOISE = Source(name="reading", text="", pattern_um=np.array([3.0, 4.0]))
SHIFT = Source(name="air", text="", pattern_um=np.array([[2.0], [2.0]]))


def test_two_readings_by_hand():
    """Noise 3 and 4 um: difference 5, mean 2.5; a common 2 um: difference 0, mean 2 (GUM 5.1 and 5.2)."""
    spent = budget(DIFFERENCE_AND_MEAN, [NOISE, SHIFT])
    assert spent.u == pytest.approx(np.array([[5.0, 2.5], [0.0, 2.0]]))
    assert spent.combined == pytest.approx([5.0, np.hypot(2.5, 2.0)])
    assert spent.expanded == pytest.approx(2 * spent.combined)
    assert [spent.dominant(quantity) for quantity in (0, 1)] == ["reading", "reading"]


@given(st.integers(0, 2**32 - 1))
def test_budget_is_the_diagonal_of_the_covariance(seed):
    rng = np.random.default_rng(seed)
    gain = rng.normal(size=(4, 7))
    sources = [
        Source(name="reading", text="", pattern_um=rng.uniform(0, 1, 7)),
        Source(name="drift", text="", pattern_um=rng.normal(size=(7, 3)), distribution="rectangular"),
    ]
    spent, full = budget(gain, sources), covariance(gain, sources)
    assert spent.combined**2 == pytest.approx(np.diag(full))
    assert np.linalg.eigvalsh(full).min() > -1e-9


def test_price_of_the_tilts_is_what_is_missing_in_the_squares():
    split = with_tilt_share(budget(DIFFERENCE_AND_MEAN, [NOISE, SHIFT]), np.array([4.0, 2.5]))
    assert split.names == ("reading", "tilt estimation", "air")
    assert split.u == pytest.approx(np.array([[4.0, 2.5], [3.0, 0.0], [0.0, 2.0]]))
    assert split.combined == pytest.approx([5.0, np.hypot(2.5, 2.0)])
