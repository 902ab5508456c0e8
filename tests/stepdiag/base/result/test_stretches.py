"""Tables that help on the whole and harm on a stretch of one axis: the stretch is named, and no
other."""

import numpy as np
import pytest

from stepdiag.base.result import prediction
from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.stretches import _worse, harmed
from stepdiag.base.volume import anywhere_mm
from stepdiag.solver.methods.solve import solve
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench


@pytest.fixture(
    scope="module",
    params=[(*DIAGONALS, *LINEAR), DIAGONALS],
    ids=["with linear runs", "diagonals alone"],
)
def result(request):
    return solve(Bench(seed=3, angle_urad=10.0).survey(request.param))


def test_tables_of_what_was_found_harm_nowhere(result):
    points = anywhere_mm(result.volume)
    assert harmed(result, points, -error_field_um(result, points)) == []


def test_slab_by_slab_is_the_figure_of_the_volume_divided(result, monkeypatch):
    """All points together are the volume: of the same draws comes the same interval, before and
    after."""
    monkeypatch.setattr(prediction, "DRAWS", prediction.FOR_LARGEST)
    points = anywhere_mm(result.volume)
    correction = -error_field_um(result, points)
    whole = prediction.predicted(result, points, correction).without_rigid_motion
    for when, square_um2 in zip(
        ("before", "after"), prediction.squares_um2(result, points, correction), strict=True
    ):
        divided = prediction.interval_of(np.sqrt(np.mean(square_um2, axis=1)), known=True)
        assert ends_of(divided) == pytest.approx(ends_of(whole[when].rms_um), rel=1e-9)


def ends_of(interval):
    return (interval.low_um, interval.value_um, interval.high_um)


@pytest.mark.parametrize(("axis", "low", "high"), [(0, 300.0, 400.0), (2, 0.0, 60.0)])
def test_a_stretch_in_which_the_sign_is_turned_is_named_and_no_other(result, axis, low, high):
    points = anywhere_mm(result.volume)
    right = -error_field_um(result, points)
    turned = (points[:, axis] > low) & (points[:, axis] < high)
    (one,) = harmed(result, points, np.where(turned[:, None], -right, right))
    assert one.axis == "XYZ"[axis]
    assert (one.low_mm, one.high_mm) == pytest.approx((low, high))
    assert one.times > 1.5
    assert one.before.low_um is not None
    assert one.after.high_um is not None


@pytest.mark.parametrize(
    ("high_before", "high_after", "worse"),
    [
        (4.0, 6.0, True),
        (6.0, 6.0, False),
        (8.0, 6.0, False),
        (None, 6.0, True),
        (4.0, None, True),
    ],
)
def test_a_stretch_is_worse_only_where_it_reaches_further_than_before(
    high_before, high_after, worse
):
    before = Interval(value_um=2.0, low_um=1.0, high_um=high_before)
    assert _worse(before, Interval(value_um=5.0, low_um=4.0, high_um=high_after)) is worse
    assert not _worse(before, Interval(value_um=2.0, low_um=1.0, high_um=high_after))
