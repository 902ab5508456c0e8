"""Chains and Abbe arms (theory 2.2)."""

import numpy as np
import pytest

from stepdiag.base.errors import UsageError
from stepdiag.base.kinematics import abbe_mask, parse_chain

TABLE = {
    "FXYZ": ["0yz", "00z", "000"],
    "XFYZ": ["xyz", "00z", "000"],
    "XYFZ": ["xyz", "0yz", "000"],
    "XYZF": ["xyz", "0yz", "00z"],
    "[w b Y X Z t]": ["00z", "x0z", "000"],
    "[w Y' b X Z t]": ["00z", "xyz", "000"],
}
"""The arms r_x, r_y, r_z of theory 2.2, as printed there."""


@pytest.mark.parametrize("chain", TABLE)
def test_the_arms_are_those_of_the_theory(chain):
    expected = [[0 if letter == "0" else 1 for letter in arm] for arm in TABLE[chain]]
    assert abbe_mask(chain).tolist() == expected


@pytest.mark.parametrize(
    ("code", "iso"),
    [
        ("XYFZ", "[w X' Y' b Z t]"),
        ("XYFZ", "[w X Y b Z t]"),
        ("FXYZ", "[w b X Y Z t]"),
        ("XFYZ", " [w X’ b Y Z t] "),
    ],
)
def test_both_ways_of_writing_a_chain_agree(code, iso):
    assert np.array_equal(abbe_mask(code), abbe_mask(iso))
    assert parse_chain(code) == parse_chain(iso)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "XYZ",
        "FXYY",
        "FXYZZ",
        "fxyz",
        "[w X Y Z t]",
        "[X b Y Z]",
        "[w b X' Y Z t]",
        "[w X' Y b Z t]",
        "[t b X Y Z w]",
    ],
)
def test_what_is_no_chain_is_refused(text):
    with pytest.raises(UsageError, match="expected X, Y, Z and the bed once each"):
        parse_chain(text)
