"""IDS3010, HPI-3D (uLine F1) and quDIS by bytes written from their public descriptions (reference:
docs/lasers.md)."""

import json
import struct

import numpy as np
import pytest
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.instruments.ids3010 import Ids3010Decoder, Ids3010Settings
from stepdiag.daq.formats.instruments.lasertex import (
    LasertexDecoder,
    LasertexSettings,
    command,
)
from stepdiag.daq.formats.instruments.qudis import QudisDecoder, QudisSettings
from stepdiag.daq.formats.recognise import recognise
from stepdiag.daq.timing.samples import Flag
from stepdiag.virtual.instruments.interferometers import lasertex_crc
from testkit.decoder_contract import DecoderContract
from testkit.streams import codes


def weather(samples):
    return {
        notice.name: notice.value
        for notice in samples.notices
        if notice.code == "environment"
    }


def ids(number, *result, **more):
    return (
        json.dumps({"jsonrpc": "2.0", "result": list(result), "id": number} | more).encode()
        + b"\r\n"
    )


def ids_decode(data, **told):
    return Ids3010Decoder(Ids3010Settings(**told)).feed(data, 5)


def test_an_ids_is_asked_for_displacement_contrast_and_air():
    decoder = Ids3010Decoder(Ids3010Settings(axis=2, interface="sen", air=True, poll_hz=100))
    asked = json.loads(decoder.request)
    assert asked == {
        "jsonrpc": "2.0",
        "method": "com.attocube.sen.displacement.getAxesDisplacement",
        "id": 1,
        "api": 2,
    }
    others = [json.loads(request) for request, _ in decoder.others]
    assert others[0]["method"] == "com.attocube.sen.displacement.getAxisSignalQuality"
    assert others[0]["params"] == [1]
    assert [each["method"].rpartition(".")[2] for each in others[1:]] == [
        "getTemperatureInDegrees",
        "getPressureInHPa",
        "getHumidityInPercent",
    ]
    assert decoder.poll_interval_s == pytest.approx(0.01)


def test_an_ids_answers_in_picometres_with_contrast_and_air():
    samples = ids_decode(
        ids(2, 0, 640, 500)
        + ids(3, 0, 21.5)
        + ids(4, 0, 987.25)
        + ids(5, 0, 44.0)
        + ids(1, 0, 1, 1_234_567_890, 3),
        axis=2,
    )
    assert samples.position_mm.tolist() == pytest.approx([1.23456789])
    assert samples.beam.tolist() == [0.64]
    assert weather(samples) == {
        "air_temperature_c": 21.5,
        "air_pressure_hpa": 987.25,
        "relative_humidity_percent": 44.0,
    }
    assert ids_decode(ids(1, 0, -2_000_000, 0, 0), sign=-1).position_mm[0] == pytest.approx(
        0.002
    )


@pytest.mark.parametrize(
    ("warning", "axis", "flag"),
    [
        (2, 2, Flag.BEAM_LOST),
        (2, 1, 0),
        (7, 3, Flag.BEAM_LOST),
        (8, 1, Flag.SATURATED),
        (99, 1, Flag.DEVICE_ERROR),
    ],
)
def test_a_warning_of_an_ids_is_a_mask_of_axes(warning, axis, flag):
    assert ids_decode(ids(1, warning, 1, 2, 3), axis=axis).flags.tolist() == [flag]


def test_an_error_of_an_ids_and_another_product_on_the_port_give_no_number():
    refused = ids_decode(
        b'{"jsonrpc":"2.0","error":{"code":-32601,"message":"Method not found"},"id":1}\r\n'
    )
    assert np.isnan(refused.position_mm).all()
    assert refused.flags.tolist() == [Flag.DEVICE_ERROR]
    assert "Method not found" in str(refused.notices[0].why)
    other = ids_decode(b"HTTP/1.1 400 Bad Request\r\nServer: x\r\n\r\n")
    assert not len(other)
    assert set(codes(other)) == {"garbage"}
    assert not len(ids_decode(ids(2, 0, 5)))


def lasertex_frame(code, data):
    frame = b"\xaa" + code.to_bytes(2, "big") + data.ljust(12, b"\0")
    return frame + bytes((lasertex_crc(frame),))


def distance(steps, speed=0, state=0x09, level=90):
    return lasertex_frame(
        0xB015, steps.to_bytes(7, "big", signed=True) + bytes((0, 0, speed, state, level))
    )


def lasertex(data, **told):
    return LasertexDecoder(LasertexSettings(**told)).feed(data, 5)


def test_a_lasertex_counts_in_tenths_of_a_nanometre():
    samples = lasertex(distance(12_345_678) + distance(-1))
    assert samples.position_mm.tolist() == pytest.approx([1.2345678, -0.0000001])
    assert samples.counter.tolist() == [0, 1]
    assert samples.beam.tolist() == [0.9, 0.9]
    assert samples.flags.tolist() == [0, 0]


def test_a_command_is_eight_bytes_with_a_checksum():
    """AA, B0 32, four zeros, CRC-8 of polynomial 31h from FFh."""
    assert command(0xB032) == bytes.fromhex("aab03200000000") + bytes(
        (lasertex_crc(bytes.fromhex("aab03200000000")),)
    )
    assert LasertexDecoder.greeting.count(b"\xaa\xb0") == 5


def test_the_flags_of_a_lasertex_are_held_until_they_are_dropped_and_dropped_once_heard():
    lost = distance(5, state=0x01)
    samples = lasertex(
        lost + distance(6, speed=8) + distance(7, state=0x08) + distance(8, level=5)
    )
    assert samples.flags.tolist() == [
        Flag.BEAM_LOST,
        Flag.SLEW,
        Flag.HEAD_ERROR,
        Flag.BEAM_LOST,
    ]
    respond = LasertexDecoder(LasertexSettings()).responder()
    assert respond(distance(1)) == b""
    assert respond(lost[:9]) == b""
    assert respond(lost[9:]) == command(0xB03D)
    assert respond(distance(6, speed=8)) == command(0xB03F)


def test_the_sensors_of_a_lasertex_fill_the_environment():
    air = lasertex_frame(0xB00A, struct.pack(">BhBBBh", 0, 2153, 47, 90, 80, 10132))
    cold, warm = (
        lasertex_frame(0xB00A, struct.pack(">BhBBBh", sensor, value, 0, 9, 9, 0))
        for sensor, value in ((1, -150), (2, 450))
    )
    told = weather(lasertex(air + cold + warm))
    assert told == pytest.approx(
        {
            "air_temperature_c": 21.53,
            "relative_humidity_percent": 47.0,
            "air_pressure_hpa": 1013.2,
            "material_temperature_c": 1.5,
        }
    )


def test_acknowledgements_and_speeds_are_passed_over_and_a_wrong_checksum_is_garbage():
    assert (
        lasertex(lasertex_frame(0xB032, b"") + lasertex_frame(0xB016, b"\x01")).notices == ()
    )
    spoilt = distance(1)[:-1] + b"\x00"
    assert codes(lasertex(spoilt + distance(2))) == ["garbage"]


def tell(index, *readings, address=0x0F00):
    words = []
    for picometres, edges in readings:
        whole = picometres & (1 << 48) - 1
        words += [
            whole & 0xFFFFFF | (edges & 0x7F) << 24,
            whole >> 24 | edges >> 7 << 24 | 1 << 31,
        ]
    return struct.pack(f"<5i{len(words)}I", 16 + 4 * len(words), 4, address, index, 0, *words)


def state(value):
    return struct.pack("<6i", 20, 4, 0x0773, 0, 0, value)


def qudis(data, **told):
    return QudisDecoder(QudisSettings(**told)).feed(data, 5)


def test_a_qudis_sends_halves_of_a_position_and_of_its_marker():
    samples = qudis(tell(10, (1_500_000_000_000, 1), (-1, 300)) + tell(12, (7, 16383)))
    assert samples.position_mm.tolist() == pytest.approx([1500.0, -1e-9, 7e-9])
    assert samples.counter.tolist() == [10, 11, 12]
    assert samples.channels[:, 0].tolist() == [1, 300, 16383]
    assert not samples.notices


def test_a_qudis_that_counts_on_shows_what_is_missing():
    samples = qudis(tell(0, (0, 0)) + tell(5, (1, 0)))
    assert codes(samples) == ["gap"]
    assert samples.notices[0].value == 4


def test_positions_before_the_wavelength_is_controlled_are_not_used():
    samples = qudis(state(0) + tell(0, (5, 0)) + state(1) + tell(1, (6, 0)))
    assert samples.flags.tolist() == [Flag.DEVICE_ERROR, 0]
    assert "still being prepared" in str(samples.notices[0].why)


def test_a_refusal_of_a_qudis_names_the_address():
    samples = qudis(struct.pack("<7i", 24, 3, 0x0031, 0, 1, 2, 0))
    assert "refuses address 0031: value out of range" in str(samples.notices[0].why)


def test_words_that_are_no_pairs_and_what_is_no_telegram_are_garbage():
    odd = struct.pack("<5i3I", 28, 4, 0x0F00, 0, 0, 1, 1 << 31, 1)
    assert codes(qudis(odd)) == ["garbage"]
    assert codes(qudis(b"\xff" * 11 + tell(0, (1, 0)))) == ["garbage"]


def test_a_qudis_that_goes_on_with_another_axis_gives_no_reading_of_it():
    """Told to send axis 3, which it has not, it sends axis 1: asked for what it sends, it says
    so."""
    answer = struct.pack("<7i", 24, 3, 0x0031, 0, 1, 0, 1)
    samples = qudis(answer + tell(0, (5, 0)), axis=3)
    assert samples.flags.tolist() == [Flag.DEVICE_ERROR]
    assert "source 1 instead of the requested source 5" in str(samples.notices[0].why)
    right = qudis(struct.pack("<7i", 24, 3, 0x0031, 0, 1, 0, 5) + tell(0, (5, 0)), axis=3)
    assert (right.flags.tolist(), right.notices) == ([0], ())
    assert len(qudis(struct.pack("<7i", 24, 4, 0x0F01, 0, 0, 5, -(1 << 31)))) == 0


def test_the_greeting_of_a_qudis_switches_one_channel_on():
    words = [
        struct.unpack_from("<4i", QudisDecoder(QudisSettings(axis=3)).greeting, at)
        for at in range(0, 16 * 24, 24)
    ]
    assert {(opcode, address) for _, opcode, address, _ in words} == {(0, 0x30)}
    rest = QudisDecoder(QudisSettings(axis=3)).greeting[16 * 24 :]
    assert struct.pack("<2i", 0, 5) in rest
    assert QudisDecoder(QudisSettings(average=5)).nominal_rate_hz == pytest.approx(781.25)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Ids3010Settings(axis=4), "laser.ids3010.axis"),
        (lambda: Ids3010Settings(poll_hz=500), "laser.ids3010.poll_hz"),
        (lambda: LasertexSettings(level_full=0), "laser.lasertex.level_full"),
        (lambda: QudisSettings(average=17), "laser.qudis.average"),
        (lambda: QudisSettings(sign=0), "laser.sign"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused_by_name(make, field):
    with pytest.raises(UsageError, match=field):
        make()


@pytest.mark.parametrize(
    ("name", "heard"),
    [
        ("lasertex", distance(1)[5:] + distance(2) + distance(3)),
        ("qudis", tell(0, (1, 0), (2, 0)) + tell(2, (3, 0))),
        ("ids3010", ids(1, 0, 5, 6, 7) * 2),
        (
            "umd",
            b"20000 20000 5 0 3 1 0 0\r\n20000 20000 5 0 3 2 0 0\r\n20000 20000 5 0 3 3 0 0\r\n",
        ),
        ("nd", b"\x02+000010000\r\n\x02+000010001\r\n"),
        ("", b"$GPGGA,1,2*33\r\n" * 9),
        ("", bytes(range(256)) * 9),
        ("", b""),
    ],
)
def test_an_instrument_is_recognised_by_what_it_says(name, heard):
    assert recognise(heard) == name


IDS_ANSWERS = [
    ids(1, 0, 1, 2, 3),
    ids(2, 0, 700, 1),
    ids(4, 0, 990.5),
    ids(1, 2, 1, 1, 1),
    b"{}\r\n",
    b"\r\n",
]
TELLS = st.builds(
    tell,
    st.integers(-(2**31), 2**31 - 1),
    st.tuples(st.integers(-(2**47), 2**47 - 1), st.integers(0, 16383)),
)
WILD = st.binary(max_size=40)
STEPS = st.integers(-(2**55), 2**55 - 1)
BYTE = st.integers(0, 255)


class TestIds3010(DecoderContract):
    streams = st.lists(st.sampled_from(IDS_ANSWERS) | WILD, max_size=15).map(b"".join)

    def make(self):
        return Ids3010Decoder(Ids3010Settings())


class TestLasertex(DecoderContract):
    streams = st.lists(
        st.builds(distance, STEPS, BYTE, BYTE, BYTE)
        | st.sampled_from([command(0xB032), lasertex_frame(0xB00A, b"\1\2"), b"\xaa"])
        | WILD,
        max_size=15,
    ).map(b"".join)

    def make(self):
        return LasertexDecoder(LasertexSettings())


class TestQudis(DecoderContract):
    streams = st.lists(TELLS | st.sampled_from([state(0), state(1)]) | WILD, max_size=15).map(
        b"".join
    )

    def make(self):
        return QudisDecoder(QudisSettings())
