"""`nd`: Heidenhain position displays, by the strings of their manuals (reference: instruments
1.B)."""

import numpy as np
import pytest
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.instruments.nd import ANSWER_CAP, NdDecoder, NdSettings
from stepdiag.daq.timing.samples import Flag
from testkit.decoder_contract import DecoderContract
from testkit.streams import codes

CURRENT = b"\x02+123456789\r\n"
DISPLAYED = b"\x02-12345.6789\r\n"


def decode(data, **told):
    return NdDecoder(NdSettings(**told)).feed(data, 5)


def test_the_current_value_is_nine_digits_of_the_configured_step():
    samples = decode(CURRENT)
    assert samples.position_mm[0] == pytest.approx(12345.6789)
    assert decode(CURRENT, resolution_mm=0.00001, sign=-1).position_mm[0] == pytest.approx(
        -1234.56789
    )
    assert samples.arrival_ns.tolist() == [5]


def test_the_displayed_value_has_a_point_and_a_unit():
    assert decode(DISPLAYED, value="displayed").position_mm[0] == pytest.approx(-12345.6789)
    assert decode(b"\x02+1.5\r\n", value="displayed", unit="inch").position_mm[
        0
    ] == pytest.approx(38.1)


@pytest.mark.parametrize(
    ("value", "request_"), [("current", b"\x1bA0200\r"), ("displayed", b"\x1bA0100\r")]
)
def test_the_request_is_that_of_the_manual(value, request_):
    decoder = NdDecoder(NdSettings(value=value, poll_hz=10))
    assert decoder.request == request_
    assert decoder.poll_interval_s == pytest.approx(0.1)


def test_a_display_of_several_axes_sends_a_line_for_each():
    """ND 720 and 760: one STX, then one line an axis."""
    answer = b"\x02+000010000\r\n-000020000\r\n+000030000\r\n" * 2
    for axis, mm in ((1, 1.0), (2, -2.0), (3, 3.0)):
        samples = decode(answer, axis=axis)
        assert samples.position_mm.tolist() == pytest.approx([mm, mm])
        assert samples.counter.tolist() == [0, 1]
        assert not samples.notices


@pytest.mark.parametrize(
    "answer", [b"\x15", b"\x02ERROR 03\r\n", DISPLAYED, b"\x02+12345\x15"]
)
def test_a_refusal_or_a_text_is_a_sample_that_cannot_be_used(answer):
    samples = decode(answer)
    assert np.isnan(samples.position_mm).all()
    assert samples.flags.tolist() == [Flag.DEVICE_ERROR]
    assert codes(samples) == ["device"]


def test_ack_is_passed_over():
    assert decode(b"\x06" + CURRENT + b"\x06").notices == ()


def test_an_answer_that_ends_early_is_told_and_the_next_is_right():
    samples = decode(b"\x02+0000" + CURRENT)
    assert codes(samples) == ["device"]
    assert samples.position_mm.tolist() == pytest.approx([12345.6789])
    missing = decode(CURRENT + CURRENT, axis=2)
    assert codes(missing) == ["device"]
    assert not len(missing)


def test_what_is_outside_of_an_answer_is_garbage():
    assert codes(decode(b"+123456789\r\n")) == ["garbage"]
    assert codes(decode(b"\xf0" * (3 * ANSWER_CAP))) == ["garbage"] * 2


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"axis": 0}, "laser.nd.axis"),
        ({"resolution_mm": 0}, "laser.nd.resolution_mm"),
        ({"poll_hz": 0}, "laser.nd.poll_hz"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused_by_name(changes, field):
    with pytest.raises(UsageError, match=field):
        NdSettings(**changes)


STREAMS = st.lists(
    st.sampled_from(
        [CURRENT, DISPLAYED, b"\x15", b"\x06", b"\x02", b"\r\n", b"+000001234\r\n"]
    )
    | st.binary(max_size=300),
    max_size=15,
).map(b"".join)


class TestNd(DecoderContract):
    streams = STREAMS

    def make(self):
        return NdDecoder(NdSettings(axis=2))
