"""Numbers in files: the last bits of a sum must not show."""

import math

from hypothesis import example, given
from hypothesis import strategies as st

from stepdiag.solver.result.rounding import steady


@given(st.integers(-(10**8), 10**8), st.integers(1, 6), st.integers(-20, 20))
def test_a_tie_goes_the_same_way_whatever_its_last_bits(halves, decimals, bits):
    """The middle between two neighbours, as a sum of another order would give it."""
    tie = (halves + 0.5) / 10**decimals
    assert steady(tie + bits * math.ulp(tie), decimals) == steady(tie, decimals)


@example(value=65536.244140625, decimals=8)
@given(value=st.floats(-1e6, 1e6), decimals=st.integers(0, 9))
def test_it_stays_within_half_a_unit_and_has_no_negative_zero(value, decimals):
    """Half a unit, half a unit three places further on from the first rounding, and the last bits of the number itself."""
    rounded = steady(value, decimals)
    assert abs(rounded - value) <= 0.5005 * 10**-decimals + 2 * math.ulp(value)
    assert math.copysign(1.0, rounded) == 1.0 or rounded < 0
