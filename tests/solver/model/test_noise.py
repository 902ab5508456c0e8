"""How large the noise of some readings is beside what their weights say."""

import numpy as np
import pytest

from stepdiag.solver.linear.elimination import order_blocks
from stepdiag.solver.linear.fit import fit
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.noise import variance_scale

SIZE_UM = 0.4
VALUES_UM = SIZE_UM * np.random.default_rng(2).normal(size=400)


def mean_of(values_um, weight):
    """Return the fit of one number to values."""
    rows = Rows(
        np.zeros((len(values_um), 1), dtype=np.int64), np.ones((len(values_um), 1)), 1
    )
    return fit(rows, order_blocks(np.full(1, -1)), values_um, weight)


def test_the_scale_is_that_of_the_scatter_about_the_mean():
    found, every = mean_of(VALUES_UM, np.ones(400)), np.arange(400)
    assert variance_scale(found, every) == pytest.approx(np.std(VALUES_UM, ddof=1))


def test_rows_that_are_left_out_tell_nothing_of_it():
    """A hundred of 500 have no weight: neither their residuals nor their number count."""
    weight = np.append(np.full(400, 4.0), np.zeros(100))
    found = mean_of(np.append(VALUES_UM, np.full(100, 50.0)), weight)
    assert variance_scale(found, np.arange(500)) == pytest.approx(
        variance_scale(mean_of(VALUES_UM, np.full(400, 4.0)), np.arange(400))
    )
    assert variance_scale(found, np.arange(400, 500)) is None
