"""`line`: any ASCII line described by its configuration."""

import numpy as np
import pytest
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.instruments.line import LINE_CAP, LineDecoder, LineSettings
from stepdiag.daq.timing.samples import Flag
from testkit.decoder_contract import SteadyDecoderContract, fed_together
from testkit.streams import codes, feed_all

PATTERN = r"P=(?P<position>\S*) N=(?P<counter>\S+) S=(?P<beam>\S+)"


def decode(data, pattern=PATTERN, **told):
    return LineDecoder(LineSettings(pattern=pattern, **told)).feed(b"\n" + data, 1)


def test_named_groups_say_where_the_numbers_stand():
    samples = decode(b"P=+12.345 N=7 S=0.9\r\nP=-0.5 N=8 S=0.8\r\n")
    assert samples.position_mm.tolist() == [12.345, -0.5]
    assert samples.counter.tolist() == [7, 8]
    assert samples.beam.tolist() == [0.9, 0.8]
    assert not samples.flags.any()


@pytest.mark.parametrize(
    ("unit", "mm"),
    [("mm", 1.0), ("um", 1e-3), ("nm", 1e-6), ("inch", 25.4), ("counts", 632.991e-6 / 2)],
)
def test_every_unit_becomes_mm(unit, mm):
    samples = decode(b"P=100 N=1 S=1\n", unit=unit, scale=2.0, sign=-1)
    assert samples.position_mm[0] == pytest.approx(-200 * mm)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1.0),
        (".5", 0.5),
        ("-3.", -3.0),
        ("+2.5e-3", 0.0025),
        ("- 1.25", -1.25),
        ("  7 ", 7.0),
    ],
)
def test_numbers_are_read_as_instruments_write_them(text, value):
    assert decode(text.encode() + b"\n", pattern="(?P<position>.*)").position_mm[
        0
    ] == pytest.approx(value)


@pytest.mark.parametrize("text", ["ERR", "", "nan", "1_0", "1.2.3", "0x10"])
def test_a_position_that_is_no_number_is_a_sample_that_cannot_be_used(text):
    samples = decode(f"P={text} N=1 S=1\n".encode())
    assert np.isnan(samples.position_mm[0])
    assert samples.flags[0] == Flag.DEVICE_ERROR


@pytest.mark.parametrize(
    ("counts", "modulus"),
    [
        ((65535, 0, 1), 65536),
        ((32767, -32768, -32767), 65536),
        ((255, 0, 1), 256),
        ((9, 10, 11), None),
    ],
)
def test_a_counter_wraps_at_its_modulus_signed_or_not(counts, modulus):
    samples = decode(
        b"".join(b"P=1 N=%d S=1\n" % count for count in counts), counter_modulus=modulus
    )
    assert np.diff(samples.counter).tolist() == [1, 1]
    assert not samples.notices


def test_gaps_duplicates_and_restarts_of_the_counter_are_told():
    samples = decode(
        b"".join(b"P=1 N=%d S=1\n" % count for count in (40000, 40003, 40003, 0))
    )
    assert [(notice.code, notice.index) for notice in samples.notices] == [
        ("gap", 1),
        ("duplicate", 2),
        ("restart", 2),
    ]
    assert len(samples) == 3


def test_without_a_counter_the_lines_are_numbered():
    decoder = LineDecoder(LineSettings(pattern="(?P<position>.*)"))
    samples = decoder.feed(b"\n1\n2\n3\n", 0)
    assert samples.counter.tolist() == [0, 1, 2]
    assert not decoder.gaps_visible


def test_the_beam_is_a_share_of_the_full_one_and_judged():
    samples = decode(
        b"".join(b"P=1 N=%d S=%d\n" % (n, beam) for n, beam in enumerate([40, 20, 9, 999])),
        beam_full=50,
        beam_threshold=0.3,
    )
    assert samples.beam.tolist() == pytest.approx([0.8, 0.4, 0.18, 1.0])
    assert samples.flags.tolist() == [0, Flag.WEAK_BEAM, Flag.BEAM_LOST, 0]


def test_what_does_not_match_is_garbage_in_its_place():
    samples = decode(b"P=1 N=1 S=1\nhello\nP=1 N=two S=1\n\xff\xfe\n\r\nP=2 N=2 S=1\n")
    assert samples.counter.tolist() == [1, 2]
    assert [(notice.code, notice.index) for notice in samples.notices] == [("garbage", 1)] * 3


def test_lines_may_end_with_a_carriage_return_alone():
    decoder = LineDecoder(LineSettings(pattern="(?P<position>.*)", terminator="\r"))
    assert decoder.feed(b"\r1\r2\r", 0).position_mm.tolist() == [1, 2]


def test_the_first_line_may_be_cut_and_is_not_used():
    """123.456 cut in front is 3.456: it still matches."""
    samples = LineDecoder(LineSettings(pattern="(?P<position>.*)")).feed(
        b"3.456\n123.457\n", 0
    )
    assert samples.flags.tolist() == [Flag.OUT_OF_RANGE, 0]


def test_after_an_interruption_halves_of_two_lines_are_not_joined():
    decoder = LineDecoder(LineSettings(pattern="(?P<position>.*)"))
    decoder.feed(b"\n1.0\n12", 0)
    decoder.resync()
    assert decoder.feed(b"3.5\n4.0\n", 1).position_mm.tolist() == [4.0]


def test_an_endless_line_is_remarked_once_and_not_hoarded():
    decoder = LineDecoder(LineSettings(pattern="(?P<position>.*)"))
    samples = feed_all(decoder, [b"\n", *[b"1" * 1000] * 50, b"\n1\n"])
    assert codes(samples) == ["garbage"]
    assert samples.position_mm.tolist() == [1.0]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"pattern": "("}, "laser.line.pattern"),
        ({"pattern": "(?P<value>.*)"}, "laser.line.pattern"),
        ({"encoding": "klingon"}, "laser.line.encoding"),
        ({"encoding": "utf-16"}, "laser.line.encoding"),
        ({"counter_modulus": 1}, "laser.line.counter_modulus"),
        ({"beam_full": 0}, "laser.line.beam_full"),
        ({"beam_threshold": 1.0}, "laser.line.beam_threshold"),
        ({"rate_hz": 0}, "laser.line.rate_hz"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused_by_name(changes, field):
    with pytest.raises(UsageError, match=field):
        LineSettings(**{"pattern": PATTERN, **changes})


ROWS = st.builds(
    "P={} N={} S={}\r\n".format,
    st.floats(-1e3, 1e3) | st.just("ERR"),
    st.integers(-5, 70000) | st.just("x"),
    st.floats(0, 1.5),
).map(str.encode)
STREAMS = st.lists(
    ROWS | st.binary(max_size=20) | st.just(b"\n") | st.just(b"9" * (LINE_CAP + 2)),
    max_size=8,
).map(b"".join)


class TestLine(SteadyDecoderContract):
    streams = STREAMS

    def make(self):
        return LineDecoder(LineSettings(pattern=PATTERN))

    def plain(self, number):
        return b"P=%.6f N=%d S=0.9\r\n" % (number / 7, number)


class TestLineWithoutCounter(SteadyDecoderContract):
    streams = STREAMS

    def make(self):
        return LineDecoder(
            LineSettings(
                pattern=r"P=(?P<position>\S*) N=\S+ S=(?P<beam>\S+)",
                terminator="\r",
                beam_full=0.5,
            )
        )

    def plain(self, number):
        return b"P=%.6f N=1 S=0.4\n\r" % (number / 7)

    def test_plain_samples_are_really_taken_at_once(self):
        """Every line is the next one: none can be missing."""
        stream = b"".join(self.plain(number) for number in range(80))
        _, at_once = fed_together(
            self.make(), [(stream[at : at + 17], at) for at in range(0, len(stream), 17)], 5
        )
        assert at_once > 5


EVIL = (
    r"(?P<position>([0-9]+)+),x",
    r"((a|aa)+)(?P<position>.*)x",
    r"(?P<position>([0-9.]*)*),(.*)*=",
)


@pytest.mark.timeout(20)
@pytest.mark.parametrize("pattern", EVIL)
def test_a_line_that_lost_a_comma_costs_no_time(pattern: str) -> None:
    """Each of these takes a backtracking engine longer than the sun will shine; a thousand such
    lines are read here."""
    decoder = LineDecoder(LineSettings(pattern=pattern))
    samples = decoder.feed(b"\n" + (b"a1" * 1000 + b"1" * 2000 + b"\n") * 1000, 1)
    assert len(samples.position_mm) == 0
    assert sum(notice.code == "garbage" for notice in samples.notices) > 0


@pytest.mark.parametrize(
    "pattern",
    [
        r"(?P<position>\d+)(?=x)",
        r"(?P<position>(\d)\1)",
        "(?P<position>((x{900}){900}){900})",
        "(?P<position>[0-9",
    ],
)
def test_what_cannot_be_held_in_linear_time_is_refused_when_the_survey_is_read(
    pattern: str,
) -> None:
    """With the reason, and with what to do about the log of an older survey."""
    with pytest.raises(
        UsageError,
        match=r"laser\.line\.pattern: expected a regular expression of RE2.*replay --survey FILE",
    ):
        LineSettings(pattern=pattern)
