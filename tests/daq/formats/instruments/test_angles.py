"""Angular instruments: lines to angles, against what the papers say of the wire."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.instruments.angles import (
    ELCOMAT,
    ELCOMAT_GREETING,
    URAD,
    WYLER,
    AnglesDecoder,
    AnglesSettings,
    AskedAnglesDecoder,
)
from stepdiag.daq.timing.samples import Flag

ARCSEC = 4.84813681109536


def elcomat():
    decoder = AnglesDecoder(AnglesSettings(pattern=ELCOMAT, greeting=ELCOMAT_GREETING))
    decoder.feed(b"cut\r", 1)
    return decoder


def test_an_elcomat_tells_two_angles_in_arc_seconds():
    samples = elcomat().feed(b"3 003 4.500000 -2.300000\r", 1)
    assert samples.channels == pytest.approx(np.array([[4.5, -2.3]]) * ARCSEC)
    assert not samples.flags.any()
    assert elcomat().greeting == b"s\nA\n"


@pytest.mark.parametrize(
    ("status", "seen"),
    [
        ("000", (False, False)),
        ("001", (True, False)),
        ("002", (False, True)),
        ("003", (True, True)),
    ],
)
def test_an_axis_that_is_not_valid_is_no_number(status, seen):
    """Third digit of the status: 1 x, 2 y, 3 both."""
    samples = elcomat().feed(f"3 {status} 1.0 2.0\r".encode(), 1)
    assert tuple(np.isfinite(samples.channels[0])) == seen
    assert bool(samples.flags[0] & Flag.OUT_OF_RANGE) == (not all(seen))


@pytest.mark.parametrize(
    ("line", "arcsec"),
    [
        (b"3 003 -.5 .25\r", (-0.5, 0.25)),
        (b"3 003 1.25e-2 -3E+1\r", (0.0125, -30.0)),
        (b"3 0030 4.5 +2.\r", (4.5, 2.0)),
        (b"3 0031 4.5 2.3\r", (4.5, 2.3)),
    ],
)
def test_every_line_that_the_public_driver_reads_is_a_reading(line, arcsec):
    """Its parser takes the third digit of a status of any length and what strtod takes
    (elcomat3000.cpp, lines 330 to 361)."""
    assert elcomat().feed(line, 1).channels == pytest.approx(np.array([arcsec]) * ARCSEC)


NOT_ABSOLUTE = [
    b"1 103 1.0 2.0",
    b"2 103 1.0 2.0",
    b"4 003 1.0 2.0",
    b"8 423 12 1 2001 300",
    b"3 003 1.0",
    b"3 004 1 2",
    b"\xff" * 300,
]


@pytest.mark.parametrize("line", NOT_ABSOLUTE)
def test_what_is_no_absolute_reading_of_the_stream_is_garbage(line):
    """A relative reading has another origin: nobody could tell it from a turn of the machine."""
    samples = elcomat().feed(line + b"\r", 1)
    assert len(samples) == 0
    assert [notice.code for notice in samples.notices] == ["garbage"]


def test_the_first_line_after_an_interruption_may_be_cut_in_front():
    decoder = AnglesDecoder(AnglesSettings(pattern=ELCOMAT))
    assert len(decoder.feed(b"3 003 4.5 2.3\r3 003 4.5 2.3\r", 1)) == 1
    decoder.resync()
    assert len(decoder.feed(b"3 003 4.5 2.3\r", 1)) == 0


def test_a_level_is_asked_and_its_second_field_counts():
    decoder = AskedAnglesDecoder(AnglesSettings(pattern=WYLER, request="P", unit="urad"))
    assert (decoder.request, decoder.poll_interval_s) == (b"P", 0.1)
    for line in (b"1 +12.5 2 +20.50\r", b"a,12.5,b,20.5\r", b"a; 12.5\r"):
        assert decoder.feed(line, 1).channels == pytest.approx(np.array([[12.5]]))


def test_a_line_without_an_end_is_no_reading_however_it_begins():
    """Half an answer again and again: cut off at its limit it would still fit a pattern whose end
    is open."""
    decoder = AskedAnglesDecoder(AnglesSettings(pattern=WYLER, request="P", unit="urad"))
    batches = [decoder.feed(b"0 12.5 ", 1) for _ in range(200)]
    assert not any(map(len, batches))
    assert [notice.code for batch in batches for notice in batch.notices] == ["garbage"]


@pytest.mark.parametrize(
    ("unit", "urad"),
    [("arcsec", ARCSEC), ("urad", 1.0), ("mrad", 1e3), ("deg", np.pi / 180 * 1e6)],
)
def test_units(unit, urad):
    assert URAD[unit] == pytest.approx(urad)


LINES = st.lists(
    st.sampled_from(
        [
            b"3 003 1.5 -2.5\r",
            b"3 001 1.5 0\r",
            b"1 103 9 9\r",
            b"?\r",
            b"\r",
            b"3 003 99999999 0\r",
        ]
    ),
    max_size=12,
)


@given(LINES, st.lists(st.integers(0, 150), max_size=8))
def test_any_split_of_the_bytes_gives_the_same_readings(lines, cuts):
    data = b"".join(lines)
    whole, split = elcomat(), elcomat()
    expected = whole.feed(data, 1)
    edges = sorted({0, len(data), *(cut for cut in cuts if cut < len(data))})
    parts = [split.feed(data[first:last], 1) for first, last in pairwise(edges)]
    rows = [
        row.tolist() for part in parts if part.channels is not None for row in part.channels
    ]
    assert np.array_equal(
        np.array(rows).reshape(-1, 2),
        expected.channels if expected.channels is not None else np.zeros((0, 2)),
        equal_nan=True,
    )
    assert sum(len(part.notices) for part in parts) == len(expected.notices)


@pytest.mark.parametrize(
    "changed",
    [
        {"pattern": "x"},
        {"pattern": "(?P<first>a)(?P<third>b)"},
        {"pattern": "(?P<first>a)", "poll_hz": 0.0},
    ],
)
def test_settings_that_are_none_are_refused(changed):
    with pytest.raises(UsageError, match=r"head\.angles"):
        AnglesSettings(**changed)
