"""Sensors of air and material: the maker's line, any line, any split, and what is no
measurement."""

from importlib.resources import files

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.instruments.air import (
    MEASURED,
    PTU300,
    AirDecoder,
    AirSettings,
    AskedAirDecoder,
)
from stepdiag.daq.timing.samples import Flag

ASKED = AirSettings(pattern=PTU300, request="SEND\r")
MANUAL = b"send\r\nP= 1033.7 hPa T= 22.2 'C RH= 38.3 %RH\r\n>"
"""The answer of the PTU300 User Manual, p. 103, behind the echo of the command."""


def told(decoder, *chunks):
    """Return what was told by name, the texts of what made no sense, and the samples' flags."""
    notices, flags = [], []
    for chunk in chunks:
        batch = decoder.feed(chunk, 1_000)
        notices += batch.notices
        flags += batch.flags.tolist()
    values = {each.name: each.value for each in notices if each.code == "environment"}
    return values, [str(each.why) for each in notices if each.code == "garbage"], flags


def test_the_line_of_the_makers_manual_is_read():
    expected = {
        "air_pressure_hpa": 1033.7,
        "air_temperature_c": 22.2,
        "relative_humidity_percent": 38.3,
    }
    assert told(AskedAirDecoder(ASKED), MANUAL) == (expected, [], [0])


@given(st.lists(st.integers(0, 3 * len(MANUAL)), max_size=20))
def test_any_split_of_the_bytes_gives_the_same(cuts):
    data, ends = MANUAL * 3, sorted(cuts)
    pieces = [data[a:b] for a, b in zip([0, *ends], [*ends, len(data)], strict=True)]
    assert told(AskedAirDecoder(ASKED), *pieces) == told(AskedAirDecoder(ASKED), data)


def test_a_quantity_that_fails_is_not_told_and_the_others_are():
    values, garbage, flags = told(
        AskedAirDecoder(ASKED), b"P= ***.* hPa T= 22.2 'C RH= 38.3 %RH\r\n"
    )
    assert values == {"air_temperature_c": 22.2, "relative_humidity_percent": 38.3}
    assert (garbage, flags) == ([], [0])


def test_a_line_without_a_number_is_a_sample_of_an_instrument_in_trouble():
    assert told(AskedAirDecoder(ASKED), b"P= **** hPa T= *** 'C RH= *** %RH\r\n") == (
        {},
        [],
        [Flag.DEVICE_ERROR],
    )


@pytest.mark.parametrize(
    "line",
    [
        b"Unknown command\r\n",
        b"P= 1033.7 hPa\r\n",
        b"P= 10T= 22.2 'C RH= 38.3 %RH\r\n",
        b"\xff\xfe\x00\n",
    ],
)
def test_what_is_no_measurement_is_named_and_tells_nothing(line):
    values, garbage, flags = told(AskedAirDecoder(ASKED), line)
    assert (values, flags, len(garbage)) == ({}, [], 1)


def test_a_line_without_an_end_is_no_measurement_however_it_begins():
    decoder = AirDecoder(AirSettings(pattern=r"(?P<air_temperature_c>[\d.]+);.*"))
    values, garbage, flags = told(decoder, b"cut\n", *[b"21.5;1;"] * 300)
    assert (values, flags, len(garbage)) == ({}, [], 1)


def test_other_units_are_brought_to_ours():
    pattern = (
        r"(?P<air_temperature_c>[\d.]+) (?P<material_temperature_c>[\d.]+) "
        r"(?P<air_pressure_hpa>[\d.]+)"
    )
    decoder = AskedAirDecoder(
        AirSettings(pattern=pattern, request="?", temperature_unit="F", pressure_unit="inHg")
    )
    values, _, _ = told(decoder, b"68.0 50.0 29.921\n")
    assert values == {
        "air_temperature_c": pytest.approx(20.0),
        "material_temperature_c": pytest.approx(10.0),
        "air_pressure_hpa": pytest.approx(1013.24, abs=0.01),
    }


def test_the_first_line_of_one_that_speaks_by_itself_may_be_cut_and_is_left_out():
    """`21.5` cut in front reads `1.5`, which a hall may well have."""
    decoder = AirDecoder(AirSettings(pattern=r"(?P<air_temperature_c>[\d.]+)"))
    assert told(decoder, b"1.5\n21.6\n")[0] == {"air_temperature_c": 21.6}
    decoder.resync()
    assert told(decoder, b"1.7\n21.8\n")[0] == {"air_temperature_c": 21.8}


def test_a_line_that_never_ends_is_bounded():
    decoder = AskedAirDecoder(ASKED)
    for _ in range(100):
        told(decoder, b"x" * 1000)
    assert told(decoder, b"\n" + MANUAL)[0]["air_temperature_c"] == 22.2


@pytest.mark.parametrize("pattern", ["(", r"\d+", r"(?P<position>\d+)"])
def test_a_pattern_that_tells_nothing_of_air_is_refused(pattern):
    with pytest.raises(UsageError, match=r"environment\.sensor\.pattern"):
        AirSettings(pattern=pattern)


def test_the_channels_are_in_the_order_of_the_names():
    batch = AskedAirDecoder(ASKED).feed(MANUAL, 1)
    assert (
        dict(zip(MEASURED, batch.channels[0].tolist(), strict=True))["air_pressure_hpa"]
        == 1033.7
    )


def test_a_sensor_is_asked_as_often_as_the_survey_template_says():
    template = (
        files("stepdiag.daq.survey").joinpath("template.toml").read_text(encoding="utf-8")
    )
    settings = AirSettings(pattern="(?P<air_temperature_c>.*)")
    assert (
        f"#poll_s = {settings.poll_s}\n"
        in template.partition("#greeting")[2].partition("[solver]")[0]
    )
