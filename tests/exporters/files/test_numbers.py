"""Numbers as controls read them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.exporters.files.numbers import fixed, shortest

numbers = st.floats(-1e5, 1e5)


@given(numbers, st.integers(0, 6))
def test_fixed_is_the_rounded_number_without_a_negative_zero(value, decimals):
    text = fixed(value, decimals)
    assert abs(float(text) - value) <= 0.5000001 * 10.0**-decimals
    assert not (text.startswith("-") and float(text) == 0.0)
    assert len(text.partition(".")[2]) == decimals


@given(numbers)
def test_shortest_keeps_nine_decimals_and_drops_zeros_but_one(value):
    text = shortest(value)
    assert float(text) == pytest.approx(value, abs=1e-9)
    assert "e" not in text
    assert text.endswith(".0") or not text.endswith("0")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (-200, "-200.0"),
        (6.25, "6.25"),
        (-0.0, "0.0"),
        (-1e-12, "0.0"),
        (400 / 7, "57.142857143"),
    ],
)
def test_shortest_by_example(value, text):
    assert shortest(value) == text
