"""Slips of the count in whole surveys of exact machines: put right, or the pass is named; never
worse than before without a word."""

from functools import cache

import pytest

from testkit.exact.surveyed import Slip, survey_of

OUT_AND_BACK = [
    pytest.param(Slip("npp", 1, 5, 2.0), id="2 µm"),
    pytest.param(Slip("ppn", 2, 8, -5.0), id="-5 µm on the way back"),
    pytest.param(Slip("ppp", 1, 2, 20.0), id="20 µm"),
    pytest.param(Slip("ppp", 2, 1, 7.0), id="7 µm on the first step after the turn"),
    pytest.param(Slip("pnp", 2, 9, 200.0), id="200 µm on the way back"),
]
ONE_WAY = [
    pytest.param(Slip("npp", 1, 10, 5.0), id="5 µm"),
    pytest.param(Slip("ppn", 1, 8, -20.0), id="-20 µm"),
    pytest.param(Slip("ppp", 1, 4, 200.0), id="200 µm"),
]


@cache
def clean(*, back, n=4, ideal=False):
    found = survey_of(back=back, n=n, ideal=ideal)
    assert not found.doubted
    assert found.after_um < 0.2 * found.before_um
    return found


def assert_right_or_named(found, slip, good):
    """The volume is nearly that of the clean survey, or the pass is named; where nothing is doubted
    it is better than before."""
    place = f"{slip.setup}/{slip.pass_number}"
    assert found.after_um <= 1.3 * good.after_um or place in found.doubted, (found, good)
    assert found.after_um < found.before_um or found.doubted


@pytest.mark.parametrize("slip", OUT_AND_BACK)
def test_out_and_back_a_slip_is_put_right_or_named(slip):
    found = survey_of(slip, back=True)
    assert_right_or_named(found, slip, clean(back=True))
    assert f"{slip.setup}/{slip.pass_number}" in found.named | found.doubted


@pytest.mark.parametrize("slip", ONE_WAY)
def test_one_way_a_slip_of_a_machine_that_is_said_to_repeat_is_put_right_or_named(slip):
    assert_right_or_named(survey_of(slip, ideal=True), slip, clean(back=False, ideal=True))


@pytest.mark.parametrize("slip", ONE_WAY[1:])
def test_one_way_a_slip_of_an_ordinary_machine_is_put_right_or_named(slip):
    """From 20 µm on: four increments driven once cannot tell less from how such a machine repeats
    and turns (`slip-hidden` of the plan)."""
    assert_right_or_named(survey_of(slip), slip, clean(back=False))


@pytest.mark.parametrize("size_um", [5.0, 12.0])
def test_one_way_a_slip_that_an_ordinary_machine_hides_does_not_make_it_worse(size_um):
    """5 µm leave 2.5 of 6.3 µm, 12 µm 5.8 um."""
    found = survey_of(Slip("npp", 1, 10, size_um))
    assert found.after_um < found.before_um


@pytest.mark.parametrize("stop", [1, 4])
def test_two_increments_one_way_and_200_um(stop):
    """So few stops do not tell which pass is wrong: all that it may be are named, and nothing is
    exported."""
    found = survey_of(Slip("npp", 1, stop, 200.0), n=2)
    assert "npp/1" in found.doubted


def test_a_wrong_first_stop_that_may_be_another_is_no_mere_warning():
    """Left open as widely as it is large, a stop leaves most of the machine's error in the files:
    5.8 µm where 0.2 were reached."""
    found = survey_of(Slip("ppn", 1, 1, -20.0), n=2, seed=2)
    assert "ppn/1" in found.doubted
