"""What a fit leaves of the readings of every unbroken count, against the definition."""

import numpy as np

from stepdiag.solver.adjustment.adjustment import adjust
from stepdiag.solver.adjustment.counts import counts, walk_of
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import DIAGONALS, Bench


def test_counts_of_repeats_that_share_their_rows_are_as_by_the_definition():
    """W - W A C A' W, worked out row by row: three repeats share their rows but for zero and
    drift."""
    layout = lay_out(Bench(increments=3).survey(DIAGONALS, passes=(1, 3, 5)))
    fixed = adjust(layout, "FXYZ").fit.fixed
    found = counts(fixed, layout).single
    assert len(found) == 12
    for count in found:
        rows, weight = fixed.rows.select(count.rows).dense(), fixed.weight[count.rows]
        left = (
            np.diag(weight) - weight[:, None] * (rows @ fixed.inverse.solve(rows.T)) * weight
        )
        steps = np.tril(np.ones((len(left), len(left))))
        scale = 1e-9 * np.max(weight)
        np.testing.assert_allclose(count.stop, np.diag(left), atol=scale)
        np.testing.assert_allclose(
            count.step, np.diag(steps.T @ left @ steps), atol=len(left) * scale
        )
        np.testing.assert_allclose(
            count.walked, count.walk.T @ left @ count.walk, atol=len(left) ** 2 * scale
        )


def test_the_components_of_a_walk_make_its_covariance():
    """Of a walk of 1 µm a step readings i and j have min(i, j) steps in common; with as many
    components as steps nothing is left out."""
    walk = walk_of(12)
    np.testing.assert_allclose(
        walk @ walk.T, np.minimum.outer(np.arange(12), np.arange(12)), atol=1e-12
    )
