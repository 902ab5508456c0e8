"""`fourdof` frames by their document, `tqd` answers by the APT protocol."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.instruments.fourdof import (
    FRAME_SIZE,
    FourdofDecoder,
    FourdofSettings,
    crc16,
)
from stepdiag.daq.formats.instruments.tqd import TqdDecoder, TqdSettings
from stepdiag.daq.formats.instruments.umd.decoder import UmdSettings
from stepdiag.daq.formats.registry import HEAD_FORMATS, LASER_FORMATS, make_decoder
from stepdiag.daq.timing.samples import Flag
from testkit.decoder_contract import DecoderContract
from testkit.streams import codes, feed_all

VALUES = (1200, -340, 50000, 11, -12, 40000, 21, -22, 30000)
DOCUMENT = Path(__file__).parents[4] / "docs" / "fourdof-frames.md"


def frame(counter, values=VALUES, status=0, kind="i"):
    body = struct.pack(f"<cBI9{kind}", kind.encode(), status, counter, *values)
    return b"\xf4\xd0" + body + struct.pack("<H", crc16(body))


def line(counter, values=VALUES, status=0):
    body = f"4D,{counter},{status}," + ",".join(str(value) for value in values)
    return f"${body}*{crc16(body.encode()):04X}\r\n".encode()


def decode(data, **told):
    return FourdofDecoder(FourdofSettings(**told)).feed(data, 1)


def test_the_crc_gives_the_check_value_of_its_definition():
    """CRC-16/CCITT-FALSE: 0x29B1 for the nine digits."""
    assert crc16(b"123456789") == 0x29B1


def test_a_frame_has_46_bytes_and_250_fit_a_second():
    assert len(frame(1)) == FRAME_SIZE == 46
    assert 115200 / 10 / FRAME_SIZE > 250


def test_the_document_for_the_builder_of_a_head_is_true():
    """Its examples are decoded as it says."""
    text = DOCUMENT.read_text(encoding="utf-8")
    binary = bytes.fromhex(re.search(r"```hex\n(.*?)```", text, re.DOTALL)[1])
    ascii_line = re.search(r"```text\n(.*?)\n```", text, re.DOTALL)[1].encode() + b"\r\n"
    for samples in (decode(binary), decode(ascii_line, encoding="ascii")):
        assert samples.counter.tolist() == [1000]
        np.testing.assert_array_equal(samples.channels, [VALUES])
        assert not samples.notices


@pytest.mark.parametrize("kind", ["i", "f"])
def test_whole_and_floating_numbers_are_nine_channels(kind):
    samples = decode(frame(7, kind=kind) + frame(8, kind=kind))
    assert samples.channels.shape == (2, 9)
    np.testing.assert_array_equal(samples.channels[1], VALUES)
    assert samples.counter.tolist() == [7, 8]
    assert np.isnan(samples.position_mm).all()
    assert np.isnan(samples.beam).all()


def test_the_ascii_form_says_the_same():
    samples = decode(line(7) + line(8, [0.5, -1.25e-3, *VALUES[2:]]), encoding="ascii")
    assert samples.counter.tolist() == [7, 8]
    assert samples.channels[1, :2].tolist() == [0.5, -0.00125]


def test_status_bits_and_impossible_values_are_flagged():
    samples = decode(
        frame(1, status=2) + frame(2, status=0x80) + frame(3, [np.nan, *VALUES[1:]], kind="f")
    )
    assert samples.flags.tolist() == [Flag.SATURATED, Flag.DEVICE_ERROR, Flag.DEVICE_ERROR]
    assert np.isnan(samples.channels[2, 0])


def test_the_weakest_sum_is_the_beam():
    samples = decode(
        frame(1) + frame(2, (0, 0, 5000, 0, 0, 40000, 0, 0, 30000)),
        full_sum=(100000, 50000, 50000),
    )
    assert samples.beam.tolist() == pytest.approx([0.5, 0.05])
    assert samples.flags.tolist() == [0, Flag.BEAM_LOST]


def test_the_counter_wraps_at_32_bits_and_shows_gaps():
    samples = decode(frame(2**32 - 1) + frame(0) + frame(3))
    assert np.diff(samples.counter).tolist() == [1, 3]
    assert [(notice.code, notice.value) for notice in samples.notices] == [("gap", 2)]


def test_a_damaged_frame_is_garbage_and_costs_no_other():
    damaged = bytearray(frame(2))
    damaged[20] ^= 1
    samples = decode(frame(1) + bytes(damaged) + frame(3))
    assert samples.counter.tolist() == [1, 3]
    assert codes(samples) == ["garbage", "gap"]
    assert codes(decode(line(1).replace(b"1200", b"1201"), encoding="ascii")) == ["garbage"]


def test_a_sync_inside_the_values_does_not_lose_the_frames_behind():
    tricky = struct.unpack("<i", b"\xf4\xd0\xf4\xd0")[0]
    samples = decode(frame(1)[5:] + frame(2, [tricky] * 9) + frame(3, [tricky] * 9))
    assert samples.counter.tolist() == [2, 3]


def test_endless_garbage_is_remarked_by_portions():
    assert (
        codes(feed_all(FourdofDecoder(FourdofSettings()), [b"\x55" * 1000] * 10))
        == ["garbage"] * 2
    )


def test_after_an_interruption_half_a_frame_is_forgotten():
    decoder = FourdofDecoder(FourdofSettings())
    decoder.feed(frame(1)[:30], 0)
    decoder.resync()
    samples = decoder.feed(frame(2), 1)
    assert samples.counter.tolist() == [2]
    assert not samples.notices


ANSWER = struct.pack("<HHBBHhhHhh", 0x0872, 12, 0x81, 0x50, 3, -16384, 8192, 30000, 1, 2)


def test_the_request_of_the_quadrant_detector_is_an_apt_message():
    decoder = TqdDecoder(TqdSettings(poll_hz=25))
    assert decoder.request == bytes.fromhex("710803005001")
    assert decoder.poll_interval_s == pytest.approx(0.04)


def test_an_answer_of_the_quadrant_detector_is_three_voltages():
    """Raw over 32767 times 10 V, the sum twice that (pylablib, which was made by measuring)."""
    samples = TqdDecoder(TqdSettings(full_sum_v=20)).feed(ANSWER + ANSWER, 1)
    assert samples.channels.shape == (2, 3)
    np.testing.assert_allclose(
        samples.channels[0], [-16384 / 3276.7, 8192 / 3276.7, 30000 / 1638.35]
    )
    assert samples.beam[0] == pytest.approx(30000 / 32767)
    assert samples.counter.tolist() == [0, 1]
    assert not samples.flags.any()


def test_a_quadrant_detector_at_its_end_or_in_the_dark_is_flagged():
    full = ANSWER[:8] + struct.pack("<hhHhh", 32767, 0, 30000, 0, 0)
    dark = ANSWER[:8] + struct.pack("<hhHhh", 0, 0, 100, 0, 0)
    assert TqdDecoder(TqdSettings()).feed(full + dark, 1).flags.tolist() == [
        Flag.SATURATED,
        Flag.BEAM_LOST,
    ]


def test_other_messages_of_the_unit_are_garbage_without_harm():
    samples = TqdDecoder(TqdSettings()).feed(bytes.fromhex("840000000150") + ANSWER, 1)
    assert len(samples) == 1
    assert codes(samples) == ["garbage"]


def test_decoders_are_made_by_name():
    assert isinstance(make_decoder("fourdof", FourdofSettings()), FourdofDecoder)
    assert {*LASER_FORMATS} == {"umd", "nd", "line", "frames", "ids3010", "lasertex", "qudis"}
    assert {*HEAD_FORMATS} == {"fourdof", "tqd", "elcomat", "wyler"}
    for name, other in (("tqd", UmdSettings()), ("lddm", UmdSettings())):
        with pytest.raises(UsageError, match="one of umd"):
            make_decoder(name, other)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: FourdofSettings(full_sum=(1, 0, 1)), "head.full_sum"),
        (lambda: FourdofSettings(beam_threshold=1), "head.beam_threshold"),
        (lambda: FourdofSettings(rate_hz=-1), "head.rate_hz"),
        (lambda: TqdSettings(poll_hz=0), "head.poll_hz"),
        (lambda: TqdSettings(full_sum_v=0), "head.full_sum_v"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused_by_name(make, field):
    with pytest.raises(UsageError, match=field):
        make()


PARTS = (
    st.integers(0, 5).map(frame)
    | st.integers(0, 5).map(line)
    | st.just(ANSWER)
    | st.binary(max_size=60)
)
STREAMS = st.lists(
    PARTS | st.sampled_from([b"\xf4", b"\xf4\xd0", b"\x72\x08", b"\x55" * 4200]), max_size=6
).map(b"".join)


class TestFourdofFrames(DecoderContract):
    streams = STREAMS

    def make(self):
        return FourdofDecoder(FourdofSettings(full_sum=(1e5, 1e5, 1e5)))


class TestFourdofLines(DecoderContract):
    streams = STREAMS

    def make(self):
        return FourdofDecoder(FourdofSettings(encoding="ascii"))


class TestTqd(DecoderContract):
    streams = STREAMS

    def make(self):
        return TqdDecoder(TqdSettings())
