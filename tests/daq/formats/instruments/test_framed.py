"""`frames`: binary frames as a survey file describes them; checksums by the check values of the CRC
catalogue."""

import struct

import numpy as np
import pytest
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.framing.checksums import CHECKSUMS
from stepdiag.daq.formats.instruments.framed import FramesDecoder, FramesSettings
from stepdiag.daq.timing.samples import Flag
from stepdiag.virtual.instruments.binary import modbus_crc
from testkit.decoder_contract import DecoderContract
from testkit.streams import codes

LAYOUT = ("counter u16", "position i32", "beam u16", "status u8")
TOLD = {
    "sync": "AA55",
    "layout": LAYOUT,
    "checksum": "crc-16/modbus",
    "unit": "nm",
    "beam_full": 1000.0,
    "lost_bits": 1,
    "error_bits": 6,
}


def frame(counter, nanometres, beam=1000, status=0, order="<"):
    body = b"\xaa\x55" + struct.pack(
        order + "HiHB", counter % 65536, nanometres, beam, status
    )
    return body + struct.pack("<H", modbus_crc(body))


def decode(data, **told):
    return FramesDecoder(FramesSettings(**{**TOLD, **told})).feed(data, 7)


@pytest.mark.parametrize(
    ("name", "check"),
    [
        ("none", 0),
        ("sum-8", 0xDD),
        ("xor-8", 0x31),
        ("crc-8", 0xF4),
        ("crc-8/maxim", 0xA1),
        ("crc-8/nrsc-5", 0xF7),
        ("crc-16/ccitt-false", 0x29B1),
        ("crc-16/xmodem", 0x31C3),
        ("crc-16/kermit", 0x2189),
        ("crc-16/modbus", 0x4B37),
        ("crc-16/arc", 0xBB3D),
    ],
)
def test_checksums_by_the_check_values_of_the_catalogue(name, check):
    """The value over the ASCII text 123456789 (reveng.sourceforge.io/crc-catalogue); sum and
    exclusive or by hand."""
    assert CHECKSUMS[name].of(b"123456789") == check


def test_every_checksum_is_known_by_a_check_value():
    marked = test_checksums_by_the_check_values_of_the_catalogue.pytestmark[0]
    assert {name for name, _ in marked.args[1]} == set(CHECKSUMS)


def test_numbers_are_read_where_they_are_said_to_stand():
    samples = decode(frame(65535, 1_234_567) + frame(0, -5, 500))
    assert samples.position_mm.tolist() == pytest.approx([1.234567, -0.000005])
    assert samples.counter.tolist() == [65535, 65536]
    assert samples.beam.tolist() == [1.0, 0.5]
    assert samples.flags.tolist() == [0, 0]
    assert samples.notices == ()
    assert decode(frame(1, 2000), sign=-1, scale=2.0).position_mm[0] == pytest.approx(-0.004)


def test_the_byte_order_is_that_of_the_numbers_and_the_checksum_may_have_its_own():
    big = frame(258, 1000, order=">")
    assert decode(big, byte_order="big", checksum_order="little").counter.tolist() == [258]
    assert not len(decode(big, byte_order="big"))


@pytest.mark.parametrize(
    ("kind", "packed", "value"),
    [
        ("u8", b"\xff", 255),
        ("i8", b"\xff", -1),
        ("i24", b"\xfe\xff\xff", -2),
        ("u24", b"\xfe\xff\xff", 0xFFFFFE),
        ("i40", struct.pack("<q", -(2**39))[:5], -(2**39)),
        ("i48", struct.pack("<q", -3)[:6], -3),
        ("i56", struct.pack("<q", 2**54)[:7], 2**54),
        ("i64", struct.pack("<q", -(2**62)), -(2**62)),
        ("f32", struct.pack("<f", 1.5), 1.5),
        ("f64", struct.pack("<d", -0.1), -0.1),
    ],
)
def test_numbers_of_every_width(kind, packed, value):
    for order, data in (("little", packed), ("big", packed[::-1])):
        told = {"sync": "01", "layout": (f"position {kind}",), "byte_order": order}
        assert FramesDecoder(FramesSettings(**told)).feed(b"\x01" + data, 1).position_mm[
            0
        ] == pytest.approx(value, rel=1e-12)


def test_status_bits_and_the_beam_tell_what_is_wrong():
    samples = decode(
        frame(1, 0, status=1)
        + frame(2, 0, status=4)
        + frame(3, 0, beam=100)
        + frame(4, 0, beam=300)
    )
    assert samples.flags.tolist() == [
        Flag.BEAM_LOST,
        Flag.DEVICE_ERROR,
        Flag.BEAM_LOST,
        Flag.WEAK_BEAM,
    ]
    good = {**TOLD, "error_bits": 0, "lost_bits": 0, "good_bits": 3}
    assert FramesDecoder(FramesSettings(**good)).feed(
        frame(1, 0, status=3) + frame(2, 0, status=1), 1
    ).flags.tolist() == [
        0,
        Flag.DEVICE_ERROR,
    ]


def test_a_wrong_checksum_costs_its_frame_and_shows_as_a_gap():
    spoilt = bytearray(frame(2, 7))
    spoilt[5] ^= 0x10
    samples = decode(frame(1, 0) + bytes(spoilt) + frame(3, 0))
    assert samples.counter.tolist() == [1, 3]
    assert codes(samples) == ["garbage", "gap"]
    assert "beginning with aa 55 02 00" in str(samples.notices[0].why)


def test_a_real_number_that_is_none_is_a_fault_of_the_instrument():
    told = {"sync": "01", "layout": ("position f32",)}
    samples = FramesDecoder(FramesSettings(**told)).feed(
        b"\x01" + struct.pack("<f", float("nan")), 1
    )
    assert np.isnan(samples.position_mm).all()
    assert samples.flags.tolist() == [Flag.DEVICE_ERROR]


def test_half_frames_for_ever_are_said_and_give_no_number():
    samples = decode(frame(1, 5)[:9] * 1000)
    assert not len(samples)
    assert set(codes(samples)) == {"garbage"}


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"sync": ""}, "laser.frames.sync"),
        ({"sync": "XY"}, "laser.frames.sync"),
        ({"layout": ("counter u8",)}, "laser.frames.layout"),
        ({"layout": ("position i12",)}, "laser.frames.layout"),
        ({"layout": ("position f16",)}, "laser.frames.layout"),
        ({"layout": ("position i8", "position i8")}, "laser.frames.layout"),
        ({"layout": ("position i8", "speed i8")}, "laser.frames.layout"),
        ({"layout": ("position i8", "counter f32", "status u8")}, "laser.frames.layout"),
        ({"layout": ("position i8", "skip 999", "skip 99")}, "laser.frames.layout"),
        ({"checksum": "crc-32"}, "laser.frames.checksum"),
        ({"checksum_from": 99}, "laser.frames.checksum_from"),
        ({"layout": ("position i8",)}, "laser.frames.lost_bits"),
        ({"scale": 0.0}, "laser.frames.scale"),
        ({"optics": 3}, "laser.optics"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused_by_name(changes, field):
    with pytest.raises(UsageError, match=field):
        FramesSettings(**{**TOLD, **changes})


ANY = st.binary(max_size=40)
FRAMES = st.builds(
    frame,
    st.integers(0, 70000),
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 2000),
    st.integers(0, 255),
)


class TestFrames(DecoderContract):
    streams = st.lists(
        FRAMES
        | st.sampled_from([b"\xaa", b"\x55", b"\xaa\x55", frame(9, 9)[:6]])
        | st.binary(max_size=40),
        max_size=30,
    ).map(b"".join)

    def make(self):
        return FramesDecoder(FramesSettings(**TOLD))
