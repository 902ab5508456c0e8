"""A pass that goes on from the log before: what its first stops are held against."""

import pytest

from stepdiag.base.volume import Volume
from stepdiag.daq.capture.naming.walk import Path, Walk
from testkit.routes import make_route

ROUTE = make_route(
    Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(300.0, 200.0, 100.0), increments=2),
    "ppp",
    "xyz",
    outward=True,
)


@pytest.mark.parametrize("stop", [1, 3, 6])
def test_a_pass_that_goes_on_is_held_against_the_reading_before_it(stop):
    goes_on = Walk((ROUTE,), Path(stop=stop - 1, left_mm=12.0))
    expected_mm = goes_on.expected_reading_mm(stop)
    assert expected_mm == pytest.approx(12.0 + ROUTE.step_mm(stop - 1, stop))
    assert goes_on.judge(stop, expected_mm) is None
    assert goes_on.judge(stop, expected_mm + 5.0) is not None
