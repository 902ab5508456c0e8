"""The sizes of the causes: where the search for them ends."""

import numpy as np
import pytest

from stepdiag.solver.linear.components import _prior_slope, _slope
from stepdiag.solver.methods.estimate import estimate, spread_of
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import Bench


@pytest.mark.parametrize(("angle_urad", "seed"), [(0.0, 1), (20.0, 2)])
def test_the_search_ends_where_the_likelihood_is_flat(angle_urad, seed):
    """A machine without angles: there the search once went to and fro between a fifth and a half of
    the usual size. No explanation is left open in these surveys: one would stand beside the sizes.
    """
    done = estimate(
        lay_out(Bench(seed=seed, angle_urad=angle_urad, increments=8).survey()), "FXYZ"
    )
    sizes = done.adjustment.sizes
    free = np.flatnonzero(sizes.sought)
    group = spread_of(done.adjustment).group
    gradient, _, _ = _slope(done.adjustment.fit, (group[:, None] == free).astype(float))
    first, _ = _prior_slope(np.log(sizes.factor[free]))
    assert gradient + first == pytest.approx(0.0, abs=0.001)
