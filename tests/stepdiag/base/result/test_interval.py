"""A predicted figure as it is written: outwards, with two digits, and nothing where nobody states
how sure it is."""

import pytest

from stepdiag.base.result.interval import Interval, decimals_of
from stepdiag.base.result.json_tree import Node
from stepdiag.base.result.typed import read, read_or_none, written


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (1.31, 2.61, ("1.3", "2.7")),
        (
            1.3,
            2.6,
            ("1.3", "2.6"),
        ),  # what is written exactly stays, whatever the last bit of it
        (0.1 + 0.2, 3 * 1.1, ("0.3", "3.3")),
        (9.31, 12.01, ("9", "13")),
        (9.99, 10.0, ("9", "10")),
        (0.0, 9.94, ("0.0", "10.0")),
        (0.0, 9.95, ("0", "10")),
    ],
)
def test_rounding_never_promises_more(low, high, shown):
    """The high end says how many decimals both have: a tenth below 9.95 µm, none from there on."""
    assert Interval(value_um=low, low_um=low, high_um=high).shown() == shown
    assert (
        str(Interval(value_um=low, low_um=low, high_um=high).words())
        == f"{shown[0]} to {shown[1]}"
    )


def test_without_an_interval_the_value_is_a_bound_from_below():
    for half in ({}, {"low_um": 1.0}, {"high_um": 3.0}):
        alone = Interval(value_um=2.04, **half)
        assert alone.shown() == ("", "")
        assert str(alone.words()) == "2.0 or more"
    assert Interval(value_um=12.6).best() == "13"


@pytest.mark.parametrize(
    ("um", "decimals"), [(9.94, 1), (9.95, 0), (-9.95, 0), (-0.3, 1), (0.0, 1)]
)
def test_two_digits_are_what_a_figure_is_worth(um, decimals):
    assert decimals_of(um) == decimals


def test_an_interval_is_read_as_it_is_written():
    """Contract 4: value, low and high; one that is no interval is refused, whatever a stranger may
    have written."""
    whole = Interval(value_um=2.0, low_um=1.0, high_um=3.0)
    assert read(Node(written(whole), "r", "rms_um", strict=True), Interval) == whole
    assert read(
        Node({"value": 2.0, "high": 3.0, "low": "one"}, "r", ""), Interval
    ) == Interval(value_um=2.0, high_um=3.0)
    assert [
        read_or_none(Node(strange, "r", ""), Interval)
        for strange in (2, True, None, "2", {}, {"value": "2"}, [2.0])
    ] == [None] * 7
