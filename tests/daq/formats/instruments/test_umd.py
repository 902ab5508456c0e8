"""`umd` lines: every trap of the real boards (reference: instruments 1.A)."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.instruments.umd.decoder import UmdDecoder, UmdSettings
from stepdiag.daq.formats.instruments.umd.rows import LINE_CAP
from stepdiag.daq.timing.samples import Flag
from testkit.decoder_contract import SteadyDecoderContract
from testkit.streams import codes, feed_all

REAL_BOARD = Path(__file__).parents[3] / "data" / "umd0.raw"
RULE = 632.991e-6 / 2  # mm a count: half a wavelength, single pass
GREETING = b"\nMinimalist Homodyne Test:\r\n"


def line(seq, displacement=0, *, ref=2000, meas=2000, phase=0, code=0, data=0, more=""):
    return f"{ref} {meas} {displacement} 0 {phase} {seq} {code} {data}{more}\r\n".encode()


def lines(*rows):
    return b"\n" + b"".join(rows)


def decode(data, **told):
    return UmdDecoder(UmdSettings(**told)).feed(data, 1)


def test_a_real_board_decodes_with_no_line_lost():
    """15 050 lines of uMD0 firmware v0.9, quadrature driven: all there, numbered without a hole, 4
    counts a cycle.

    244.1395 lines/s arrived (instruments 1.A); the board tells 244.14.
    """
    decoder = UmdDecoder(UmdSettings(optics=1))
    raw = REAL_BOARD.read_bytes()
    samples = decoder.feed(raw, 0)
    assert len(samples) == raw.count(b"\n") - 2 == 15050
    np.testing.assert_array_equal(samples.counter, np.arange(15050))
    assert decoder.nominal_rate_hz == pytest.approx(244.1395, abs=0.001)
    assert not decoder.gaps_visible  # uMD0 counts the lines it sends
    assert codes(samples) == ["banner", "device", "rate", "device"]
    assert not samples.flags[13:].any()
    displacement = int(raw.splitlines()[-1].split()[2])
    assert samples.position_mm[-1] == pytest.approx(
        displacement / 4 * 632.991e-6 / 2, rel=1e-12
    )


def test_the_scale_of_a_silent_head_is_not_guessed():
    """REF = 0 is a head without light or a homodyne board: until code 20 tells, there is no
    position."""
    samples = decode(
        lines(line(1, 8, ref=0, meas=0), line(2, 8, ref=0, meas=0, code=20, data=4 * 256 + 1))
    )
    assert samples.flags.tolist() == [Flag.HEAD_ERROR | Flag.BEAM_LOST, 0]
    assert np.isnan(samples.position_mm[0])
    assert samples.position_mm[1] == pytest.approx(2 * RULE)


def test_a_board_that_is_not_homodyne_is_told_so():
    samples = decode(lines(line(1, 8, code=20, data=0), line(2, 8, ref=0)))
    assert samples.flags.tolist() == [0, Flag.HEAD_ERROR]
    assert samples.position_mm[1] == pytest.approx(8 * RULE)


@pytest.mark.parametrize(("optics", "sign"), [(1, 1), (2, -1), (4, 1)])
def test_a_count_is_half_a_wavelength_by_the_fold_of_the_optics(optics, sign):
    samples = decode(lines(line(1, 1000)), optics=optics, sign=sign, wavelength_nm=633.0)
    assert samples.position_mm[0] == pytest.approx(sign * 1000 * 316.5e-6 / optics)


def test_the_sequence_number_of_umd0_wraps_at_16_bits_with_sign():
    """Bytes measured on the firmware: 32767 is followed by -32768."""
    samples = decode(
        b"\n0 0 26173 0 0 32767 0 0\r\n0 0 26171 0 0 -32768 0 0\r\n0 0 26171 0 0 -32767 0 0\r\n"
    )
    assert np.diff(samples.counter).tolist() == [1, 1]
    assert not samples.notices


@pytest.mark.parametrize(("last", "first"), [(2**31 - 1, -(2**31)), (2**32 - 1, 0)])
def test_the_sequence_number_of_the_others_wraps_at_32_bits(last, first):
    samples = decode(lines(line(last), line(first), line(first + 1)))
    assert np.diff(samples.counter).tolist() == [1, 1]
    assert not samples.notices


def test_a_wrap_may_hide_a_gap():
    samples = decode(lines(line(32767), line(-32766)))
    assert np.diff(samples.counter).tolist() == [3]
    assert [(notice.code, notice.index, notice.value) for notice in samples.notices] == [
        ("gap", 1, 2)
    ]


def test_missing_samples_are_counted():
    samples = decode(lines(line(5), line(6), line(10)))
    assert samples.counter.tolist() == [5, 6, 10]
    assert [(notice.code, notice.index, notice.value) for notice in samples.notices] == [
        ("gap", 2, 3)
    ]


def test_a_sample_sent_twice_is_used_once_and_a_run_of_them_remarked_once():
    """The first lines of a uMD1 after its reset all carry sequence number 0."""
    samples = decode(lines(line(0), line(0), line(0), line(1), line(2), line(2), line(3)))
    assert samples.counter.tolist() == [0, 1, 2, 3]
    assert [(notice.code, notice.index) for notice in samples.notices] == [
        ("duplicate", 1),
        ("duplicate", 3),
    ]


@pytest.mark.parametrize("last", [100, 30000, -20000])
def test_a_board_that_greets_and_counts_from_0_began_anew(last):
    samples = decode(lines(line(last, 500), GREETING, line(0), line(1)))
    assert codes(samples) == ["banner", "restart"]
    assert samples.notices[1].index == 1
    assert np.diff(samples.counter).tolist() == [1, 1]


def test_a_count_that_goes_back_without_a_greeting_is_a_restart_too():
    assert codes(decode(lines(line(30000), line(0), line(1)))) == ["restart"]


def test_text_in_between_is_no_restart_where_the_count_goes_on():
    assert codes(decode(lines(line(7), GREETING, line(8)))) == ["banner"]


def test_debug_lines_are_handed_on():
    samples = decode(lines(line(7), b"!overflow at 12\r\n", line(8)))
    assert [(notice.code, notice.index, notice.why) for notice in samples.notices] == [
        ("debug", 1, "overflow at 12")
    ]
    assert len(samples) == 2


def test_sixteen_fields_hold_three_axes_and_may_end_with_a_blank():
    """uMD2 v2.47r prints a blank after field 15, on which a reader that splits at single blanks
    fails."""
    row = line(9, 10, more=" 2000 20 0 0 2000 30 0 0 ")
    assert row.endswith(b" 0 \r\n")
    for axis, counts in ((1, 10), (2, 20), (3, 30)):
        samples = decode(lines(row * 20), axis=axis)
        assert samples.position_mm[0] == pytest.approx(counts * RULE)
        assert not samples.flags.any()


def test_an_axis_that_is_not_sent_is_no_sample_to_use():
    samples = decode(lines(line(1), line(2)), axis=3)
    assert np.isnan(samples.position_mm).all()
    assert samples.flags.tolist() == [Flag.DEVICE_ERROR] * 2
    assert codes(samples) == ["device"]


def test_a_rate_change_is_told_at_its_line():
    """A uMD1 changes its rate by itself when the REF frequency asks for it; only code 8 tells."""
    decoder = UmdDecoder(UmdSettings())
    rows = [
        line(1, code=8, data=61035),
        line(2),
        line(3, code=8, data=73242),
        line(4, code=8, data=73242),
    ]
    samples = decoder.feed(lines(*rows), 0)
    assert [(notice.code, notice.index, notice.value) for notice in samples.notices] == [
        ("rate", 0, 610.35),
        ("rate", 2, 732.42),
    ]
    assert decoder.nominal_rate_hz == 732.42
    assert decoder.gaps_visible


def test_sensors_of_the_board_are_handed_on():
    told = [(3, 2012), (4, 1987), (5, 101325), (6, 503)]
    samples = decode(
        lines(*(line(n, code=code, data=data) for n, (code, data) in enumerate(told)))
    )
    assert {notice.name: notice.value for notice in samples.notices} == pytest.approx(
        {
            "temperature_1_c": 20.12,
            "temperature_2_c": 19.87,
            "pressure_hpa": 1013.25,
            "relative_humidity_percent": 50.3,
        }
    )


def test_the_phase_is_subtracted():
    """The display's own program and the author of the firmware subtract; another public decoder
    adds."""
    samples = decode(
        lines(line(1, code=10, data=247), line(2, 100, phase=64), line(3, 100, phase=-64))
    )
    assert samples.position_mm[1:] == pytest.approx([99.75 * RULE, 100.25 * RULE])


@pytest.mark.parametrize("bit", [0x200, 0x400, 0x800, 0x1000, 0x2000, 0x4000])
def test_error_bits_of_the_phase_are_flagged(bit):
    samples = decode(lines(line(1, code=10, data=247), line(2, 100, phase=bit | 7)))
    assert samples.flags.tolist() == [0, Flag.PHASE_ERROR]
    assert samples.position_mm[1] == pytest.approx(100 * RULE)


def test_firmware_264_tells_the_width_of_its_phase():
    """Version in the low, sub-version in the high 16 bits; code 112 without its bit 1 means 16
    bits."""
    version = line(1, code=10, data=(7 << 16) | 264)
    wide = decode(
        lines(
            version,
            line(2, code=112, data=4),
            line(3, 100, phase=0x4000),
            line(4, 100, phase=-0x4000),
        )
    )
    assert wide.position_mm[2:] == pytest.approx([99.75 * RULE, 100.25 * RULE])
    narrow = decode(lines(version, line(2, code=112, data=6), line(3, 100, phase=64)))
    assert narrow.position_mm[2] == pytest.approx(99.75 * RULE)
    assert not np.concatenate([wide.flags, narrow.flags]).any()


def test_a_phase_of_unknown_width_is_not_guessed():
    samples = decode(
        lines(
            line(1),
            line(2, 100, phase=64),
            line(3, code=10, data=247),
            line(4, 100, phase=64),
        )
    )
    assert samples.flags.tolist() == [0, Flag.PHASE_ERROR, 0, 0]
    assert [
        notice.index for notice in samples.notices if "phase_bits" in str(notice.why)
    ] == [1]
    told = decode(lines(line(1), line(2, 100, phase=64)), phase_bits=8)
    assert told.position_mm[1] == pytest.approx(99.75 * RULE)
    assert not told.flags.any()


def test_firmware_315_is_read_without_its_wrong_phase():
    """Its 8-bit split is a whole count wrong for about half of the values (DERIVED from its
    source)."""
    samples = decode(lines(line(1, code=10, data=315), line(2, 100, phase=200)))
    assert samples.position_mm[1] == pytest.approx(100 * RULE)
    assert "computed from the count alone" in str(samples.notices[0].why)


def test_a_greeting_at_the_end_of_a_steady_stream_is_over_with_the_next_line():
    """The count goes on behind it: what is missing later is missing samples, not a board that began
    anew."""
    decoder = UmdDecoder(UmdSettings())
    decoder.feed(lines(line(5), line(6)) + GREETING, 1)
    goes_on = (line(7) + line(8), 2)
    assert decoder.feed_steady([goes_on]) is None
    decoder.feed(*goes_on)
    assert codes(decoder.feed(line(12), 3)) == ["gap"]


def test_a_greeting_within_a_count_that_goes_on_is_no_restart():
    """Three samples after the greeting, each one on: nothing began anew."""
    decoder = UmdDecoder(UmdSettings())
    decoder.feed(lines(line(5), line(6)), 1)
    samples = decoder.feed(GREETING + line(7) + line(8) + line(9), 2)
    assert samples.counter.tolist() == [7, 8, 9]
    assert "restart" not in codes(samples)


def test_a_sample_rate_below_zero_is_told_as_the_board_said_it():
    """Code 8 is the rate in hundredths of a hertz (instruments 1.A)."""
    samples = decode(lines(line(1, code=8, data=-250)))
    assert [str(notice.why) for notice in samples.notices] == [
        "the board reports a sample rate of -2.5 Hz, which is not used"
    ]


@pytest.mark.parametrize("spare", [0, 5])
@pytest.mark.parametrize(
    ("count", "held"), [(10**18 - 1, 1), (1 - 10**18, 1), (10**18, 0), (-(10**18), 0)]
)
def test_a_number_that_no_counter_holds_is_no_sample(count, held, spare):
    """Alone and among many: what 64 bits could not multiply is garbage, never a position."""
    samples = decode(lines(line(1, count), *(line(2 + more) for more in range(spare))))
    assert len(samples) == held + spare
    assert [notice.code for notice in samples.notices] == ["garbage"] * (1 - held)


def test_firmware_60_of_the_umd1_is_not_taken_for_264():
    samples = decode(lines(line(1, code=10, data=6000), line(2, 100, phase=64)))
    assert samples.position_mm[1] == pytest.approx(99.75 * RULE)


@pytest.mark.parametrize(
    ("ref", "meas", "flag"),
    [
        (0, 2000, Flag.HEAD_ERROR),
        (2000, 0, Flag.BEAM_LOST),
        (2000, 99, Flag.SLEW),
        (2000, 3901, Flag.SLEW),
        (2000, 100, 0),
        (2000, 3900, 0),
    ],
)
def test_the_beam_is_judged_by_ref_and_meas(ref, meas, flag):
    """At 1000 Hz a margin of 0.1 MHz is 100 counts a sample."""
    samples = decode(lines(line(1, code=8, data=100000), line(2, ref=ref, meas=meas)))
    assert samples.flags[1] == flag


def test_a_first_line_may_be_cut_and_is_not_used():
    samples = decode(line(5) + line(6))
    assert samples.flags.tolist() == [Flag.OUT_OF_RANGE, 0]


def test_after_an_interruption_the_rest_of_a_line_is_passed_over():
    """The halves of two lines are not put together; what was lost shows as a gap, what was told
    stays known."""
    decoder = UmdDecoder(UmdSettings())
    decoder.feed(lines(line(1, code=8, data=100000), line(2), line(3)[:9]), 0)
    decoder.resync()
    samples = decoder.feed(line(7)[6:] + line(8), 1)
    assert samples.counter.tolist() == [8]
    assert [(notice.code, notice.value) for notice in samples.notices] == [("gap", 5)]
    assert decoder.nominal_rate_hz == 1000.0


@pytest.mark.parametrize(
    "text",
    [
        b"1 2 3",
        b"1 2 3 4 5 6 7 8 9",
        b"1 2 3 4 5 6 7 x",
        b"1 2 3 4 5 6 7 8.0",
        b"1 2 3 4 5 6 7 --8",
        b"1 2 3 4 5-6 7 8",
        b"1 2 3 4 5 6 7 -",
        b"1 2 3 4 5 6 7 " + b"9" * 19,
        b"\xff\x00\xfe",
        b"0" * (LINE_CAP + 1),
    ],
)
def test_what_is_no_line_is_garbage_wherever_it_stands(text):
    block = (
        b"".join(line(n) for n in range(40))
        + text
        + b"\r\n"
        + b"".join(line(n) for n in range(40, 80))
    )
    samples = decode(b"\n" + block)
    assert len(samples) == 80
    assert [(notice.code, notice.index) for notice in samples.notices] == [("garbage", 40)]


def test_endless_garbage_is_remarked_and_not_hoarded():
    decoder = UmdDecoder(UmdSettings())
    samples = feed_all(decoder, [b"\xf0\x0f" * 500] * 1000 + [b"\n", line(1)])
    assert codes(samples) == ["garbage"]
    assert len(samples) == 1


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"axis": 4}, "laser.umd.axis"),
        ({"optics": 3}, "laser.optics"),
        ({"sign": 0}, "laser.sign"),
        ({"wavelength_nm": 0.6}, "wavelength_nm"),
        ({"phase_bits": 12}, "laser.umd.phase_bits"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused_by_name(changes, field):
    with pytest.raises(UsageError, match=field):
        UmdSettings(**changes)


ROWS = st.builds(
    line,
    st.integers(0, 40) | st.sampled_from([32767, -32768, 2**31 - 1, -(2**31)]),
    st.integers(-(10**9), 10**9),
    ref=st.sampled_from([0, 2000]),
    meas=st.sampled_from([0, 50, 2000]),
    phase=st.integers(-600, 0x7FFF),
    code=st.sampled_from([0, 0, 0, 3, 8, 10, 20, 112]),
    data=st.sampled_from([0, 6, 100, 264, 315, 1025, 61035, 73242]),
    more=st.sampled_from(["", "", " ", " 1 2 3 4 5 6 7 8", " 1 2 3 4 5 6 7 8 "]),
)
ODD = st.sampled_from(
    [
        b"\r\n",
        b"!note\r\n",
        GREETING,
        b"1 2 3\r\n",
        b"1  2 3 4 5 6 7 8\n",
        b"1 2 3 4 5 6 7 -\r\n",
        b"\xff\n",
    ]
)
PLAIN = st.integers(0, 30000).map(
    lambda first: b"".join(line(first + n, 3 * n, phase=n % 200) for n in range(12))
)
STREAMS = st.lists(ROWS | ODD | PLAIN | st.binary(max_size=30), max_size=25).map(b"".join)


class TestUmd(SteadyDecoderContract):
    streams = STREAMS

    def plain(self, number):
        return line(number, 10 * number)

    def make(self):
        return UmdDecoder(UmdSettings())
