"""Numbers in files: the last bits of a sum must not show."""

import math

from hypothesis import example, given
from hypothesis import strategies as st

from stepdiag.base.result.rounding import same_but_for_rounding, steady


@given(st.integers(-(10**8), 10**8), st.integers(1, 6), st.integers(-20, 20))
def test_a_tie_goes_the_same_way_whatever_its_last_bits(halves, decimals, bits):
    """The middle between two neighbours, as a sum of another order would give it."""
    tie = (halves + 0.5) / 10**decimals
    assert steady(tie + bits * math.ulp(tie), decimals) == steady(tie, decimals)


@example(value=65536.244140625, decimals=8)
@given(value=st.floats(-1e6, 1e6), decimals=st.integers(0, 9))
def test_it_stays_within_half_a_unit_and_has_no_negative_zero(value, decimals):
    """Half a unit, half a unit three places further on from the first rounding, and the last bits
    of the number itself."""
    rounded = steady(value, decimals)
    assert abs(rounded - value) <= 0.5005 * 10**-decimals + 2 * math.ulp(value)
    assert math.copysign(1.0, rounded) == 1.0 or rounded < 0


def test_a_tenth_of_a_nanometre_may_be_another_processors_and_nothing_else():
    value = {"a": [0.28991, None, "x"], "b": 3}
    assert same_but_for_rounding(value, {"a": [0.289915, None, "x"], "b": 3}, 6)
    assert not same_but_for_rounding(value, {"a": [0.290011, None, "x"], "b": 3}, 6)
    assert not same_but_for_rounding(value, {"a": [0.28991, None, "y"], "b": 3}, 6)
    assert not same_but_for_rounding(value, {"a": [0.28991, None, "x"], "b": 4}, 6)
    assert not same_but_for_rounding(value, {"a": [0.28991, 0.0, "x"], "b": 3}, 6)
    assert not same_but_for_rounding(value, {"a": [0.28991, None], "b": 3}, 6)
    assert not same_but_for_rounding(value, {"a": [0.28991, None, "x"]}, 6)
