"""The names of setups: what each says, which are none, and the order of tables."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.base.names import SETUP_NUMBERS
from stepdiag.base.setups import (
    DRIVEN_SETUPS,
    SETUP_NAMES,
    setup_code,
    setup_of,
    setups_meant,
)


def test_the_numbers_of_the_register_are_those_of_the_contract():
    """Contract 2, register 3: a number that moved would name another setup in every survey."""
    diagonals = [(1, "ppp"), (2, "npp"), (3, "pnp"), (4, "ppn")]
    lines = [
        (11, "linear-x"),
        (12, "linear-y"),
        (13, "linear-z"),
        (21, "fourdof-x"),
        (22, "fourdof-y"),
        (23, "fourdof-z"),
    ]
    assert list(SETUP_NUMBERS.items()) == diagonals + lines


@pytest.mark.parametrize(
    ("name", "kind", "signs", "shift"),
    [
        ("npp", "step", (-1, 1, 1), 0),
        ("ppn+1", "step", (1, 1, -1), 1),
        ("face-xz-np", "face", (-1, 0, 1), 0),
        ("face-yz-pp", "face", (0, 1, 1), 0),
        ("body-pnp", "body", (1, -1, 1), 0),
        ("linear-y+10", "linear", (0, 1, 0), 10),
        ("ppp+99999", "step", (1, 1, 1), 99999),
    ],
)
def test_a_name_says_what_moves(name, kind, signs, shift):
    """Contract 1: p starts at the low end, n at the high end; the number behind + only tells
    alignments apart."""
    found = setup_of(name)
    assert (found.name, found.kind, found.signs, found.shift) == (name, kind, signs, shift)


@pytest.mark.parametrize(
    "name",
    [
        "",
        "nnn",
        "ppp+",
        "ppp+0",
        "ppp+01",
        "ppp+-1",
        "ppp+1.0",
        "ppp+²",
        "ppp+100000",
        "ppp+1+1",
        "PPP",
    ],
)
def test_what_is_no_name_is_refused(name):
    with pytest.raises(UsageError, match="expected one of ppp, npp"):
        setup_of(name)


def test_the_nearest_name_is_offered():
    with pytest.raises(UsageError, match="did you mean 'linear-x'"):
        setup_of("linearx")


def test_tables_list_variants_behind_their_setup():
    names = ["linear-x", "npp+10", "npp+2", "ppp+1", "ppp"]
    assert sorted(names, key=lambda name: setup_of(name).order) == [
        "ppp",
        "ppp+1",
        "npp+2",
        "npp+10",
        "linear-x",
    ]
    assert [setup_of(name).name for name in SETUP_NAMES] == list(SETUP_NAMES)


@given(st.sampled_from(DRIVEN_SETUPS), st.integers(0, 99_999))
def test_a_setup_is_read_back_from_its_name(base, shift):
    setup = setup_of(setup_of(base).shifted(shift))
    assert (setup.base, setup.shift) == (base, shift)
    assert setup.axis == (base[-1] if setup.kind in ("linear", "fourdof") else "")
    assert (setup.is_diagonal, setup.is_fourdof) == (
        setup.kind == "step",
        base.startswith("fourdof"),
    )
    assert sum(map(bool, setup.signs)) == (
        1 if setup.axis else 2 if setup.kind == "face" else 3
    )


PLANNED = (
    "face-xy-pp",
    "ppp",
    "ppp+1",
    "linear-x",
    "linear-x+1",
    "fourdof-y",
    "face-xy-pp+1",
)


def test_a_setup_without_a_number_of_its_own_has_that_of_its_place():
    """Contract 2: 100 + k is the k-th setup of the plan; a shifted beam drives what its diagonal
    does."""
    assert [setup_code(name, PLANNED) for name in PLANNED] == [101, 1, 1, 11, 105, 22, 107]


@given(
    st.lists(st.sampled_from(DRIVEN_SETUPS), min_size=1, max_size=6),
    st.randoms(use_true_random=False),
)
def test_a_number_means_the_setup_that_shows_it(bases, random):
    planned = [
        setup_of(base).shifted(bases[:place].count(base)) for place, base in enumerate(bases)
    ]
    random.shuffle(planned)
    for name in planned:
        meant = setups_meant(setup_code(name, planned), planned)
        assert name in meant
        # where it means several, they are beams on one diagonal
        assert len(meant) == 1 or {setup_of(one).base for one in meant} == {
            setup_of(name).base
        }
        assert len(meant) == 1 or setup_of(name).is_diagonal
    assert all(
        setups_meant(101 + place, planned) == [name] for place, name in enumerate(planned)
    ), "any setup may be coded so"
    assert setups_meant(101 + len(planned), planned) == setups_meant(None, planned) == []
