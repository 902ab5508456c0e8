"""Air and material that no hall can have, and values that jump: held, named, doubted; never
believed in silence."""

import math

import pytest

from stepdiag.daq.capture.conditions import (
    STALE_NS,
    Conditions,
    Credible,
    believed_before,
    with_air,
)
from stepdiag.daq.capture.noise import LEAST_SAMPLES
from stepdiag.daq.capture.remarks.unchecked import assumed, unchecked
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.formats import air_decoder, laser_decoder
from stepdiag.daq.timing.stream import StreamBuffer
from testkit.running.survey_files import SMALLEST
from testkit.timeline import survey_text

GOOD = {
    "material_temperature_c": 20.1,
    "air_temperature_c": 21.5,
    "air_pressure_hpa": 1013.2,
    "relative_humidity_percent": 45.5,
}
UNCOMPENSATED = survey_text().replace("compensated = true\n", "")


def judge(*stops, text=UNCOMPENSATED, every_s=10.0):
    """Return what becomes of the conditions at stop after stop."""
    conditions = Conditions(parse_survey(text, "survey.toml"), {})
    return [
        conditions.judge(Signals(**{**GOOD, **stop}), number * every_s)
        for number, stop in enumerate(stops)
    ]


def test_what_a_hall_has_is_believed_as_it_is():
    for judged in judge({}, {"air_temperature_c": 22.0}, {"air_pressure_hpa": 1012.0}):
        assert (judged.held, judged.remarks, judged.doubted) == ((), [], [])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("air_temperature_c", 0.0),
        ("air_pressure_hpa", 500.0),
        ("air_pressure_hpa", 101.3),
        ("relative_humidity_percent", 100.3),
        ("material_temperature_c", -100.0),
        ("air_temperature_c", 29.0),
        ("air_pressure_hpa", 980.0),
    ],
)
def test_one_wrong_value_is_held_and_named(name, value):
    """The stop keeps the last credible value, says so with its uncertainty, and the next stop is as
    before."""
    _, wrong, after = judge({}, {name: value}, {})
    assert getattr(wrong.signals, name) == GOOD[name]
    assert wrong.held == (name,)
    (said,) = wrong.remarks
    assert said.code in ("conditions-held", "sensor-jump")
    assert f"{GOOD[name]:g}" in str(said)
    assert "u = " in str(said)
    assert wrong.doubted == []
    assert (after.held, after.remarks) == ((), [])


@pytest.mark.parametrize("name", [*GOOD])
def test_a_register_that_nobody_writes_is_not_believed_from_the_first_stop_on(name):
    """It says 0, where no hall is; and where it is as dry or as cold as can be, it is believed."""
    (nothing,), (least,) = (
        judge({name: 0.0}),
        judge({name: {"air_pressure_hpa": 600.1}.get(name, 0.1)}),
    )
    assert getattr(nothing.signals, name) is None
    assert getattr(least.signals, name) == pytest.approx(
        0.1 if name != "air_pressure_hpa" else 600.1
    )


def test_a_plc_without_sensors_gives_none_and_a_doubt_where_the_reading_depends_on_it():
    zeros = dict.fromkeys(GOOD, 0.0)
    first, second = judge(zeros, zeros)
    assert first.signals == Signals(**dict.fromkeys(GOOD))
    assert [each.code for each in first.remarks] == ["conditions-held"] * 4
    assert [each.code for each in first.doubted] == ["air-unknown"] * 3
    assert (second.remarks, second.doubted) == ([], [])
    (compensated,) = judge(zeros, text=survey_text())
    assert compensated.doubted == []


def test_what_the_survey_file_fixes_is_not_judged():
    fixed = UNCOMPENSATED + '[environment]\nsource = "fixed"\n'
    (judged,) = judge(dict.fromkeys(GOOD, 0.0), text=fixed)
    assert (judged.remarks, judged.doubted) == ([], [])


def test_a_jump_that_lasts_is_believed_in_the_end_and_doubted():
    """Both are possible, before and after: which of them is right a person must say."""
    *held, believed, after = judge(
        {}, *[{"air_pressure_hpa": 980.0}] * LEAST_SAMPLES, {"air_pressure_hpa": 980.0}
    )
    assert all(judged.signals.air_pressure_hpa == 1013.2 for judged in held)
    assert believed.signals.air_pressure_hpa == 980.0
    assert [each.code for each in believed.doubted] == ["sensor-jump"]
    assert (after.held, after.remarks, after.doubted) == ((), [], [])


def test_a_hall_that_warms_slowly_is_followed():
    warming = [{"air_temperature_c": 20.0 + 0.1 * minute} for minute in range(100)]
    assert not any(judged.held for judged in judge(*warming, every_s=60.0))


SENSOR = (
    f'{UNCOMPENSATED}[environment]\nsource = "sensor"\n[environment.sensor]\nport = '
    '"/dev/air"\nformat = "line"\n'
    "pattern = '(?P<air_temperature_c>.+)'\n"
)


def test_a_sensor_that_falls_silent_is_held_within_a_minute_and_named_after_it():
    """NaN is what stands for a sensor that tells nothing; a measurement before the log began is one
    like any other."""
    _, soon, late, again, back = judge(
        {}, *[{"air_temperature_c": math.nan}] * 3, {}, text=SENSOR, every_s=35.0
    )
    assert (soon.signals.air_temperature_c, soon.held, soon.remarks) == (
        GOOD["air_temperature_c"],
        (),
        [],
    )
    assert (late.signals.air_temperature_c, late.held) == (
        GOOD["air_temperature_c"],
        ("air_temperature_c",),
    )
    assert [each.code for each in late.remarks] == ["conditions-held"]
    assert (again.held, again.remarks) == (("air_temperature_c",), [])
    assert (back.held, back.remarks) == ((), [])


def test_a_sensor_that_never_spoke_is_a_doubt():
    (judged,) = judge({"air_temperature_c": math.nan}, text=SENSOR)
    assert judged.signals.air_temperature_c is None
    assert [each.code for each in judged.doubted] == ["air-unknown"]
    assert "was never received" in str(judged.remarks[0])


def test_only_what_the_pattern_names_is_the_sensors():
    survey = parse_survey(SENSOR, "survey.toml")
    stream = StreamBuffer(air_decoder(survey))
    stream.feed(b"cut\n22.5\n", 1_000)
    signals = Signals(**{**GOOD, "air_temperature_c": 3.0})
    assert with_air(survey, signals, stream, 2_000) == Signals(
        **{**GOOD, "air_temperature_c": 22.5}
    )
    stale = with_air(survey, signals, stream, 2_000 + STALE_NS, silent=math.nan)
    assert math.isnan(stale.air_temperature_c)
    assert stale.air_pressure_hpa == GOOD["air_pressure_hpa"]


@pytest.mark.parametrize(
    ("line", "age_ns", "begins_with"),
    [
        (b"22.5", 20_000_000_000, Credible(value=22.5, time_s=900.0)),
        (b"35.0", 20_000_000_000, Credible(value=21.5, time_s=0.0)),
        (b"99.0", 20_000_000_000, Credible(value=21.5, time_s=0.0)),
        (b"22.5", 2 * STALE_NS, Credible(value=21.5, time_s=0.0)),
    ],
)
def test_a_log_begins_with_what_a_sensor_told_since_the_log_before_as_far_as_it_is_believed(
    line, age_ns, begins_with
):
    """A quarter of an hour lies between: the value of then would be held, and the sensor called
    silent, until it speaks again."""
    survey, now_ns = parse_survey(SENSOR, "survey.toml"), 900_000_000_000
    stream = StreamBuffer(air_decoder(survey))
    stream.feed(b"cut\n" + line + b"\n", now_ns - age_ns)
    before = {
        "air_temperature_c": Credible(value=21.5, time_s=0.0),
        "air_pressure_hpa": Credible(value=1000.0, time_s=0.0),
    }
    assert believed_before(survey, stream, now_ns, 0, before) == {
        **before,
        "air_temperature_c": begins_with,
    }


STOPPED = '[plc.signals.stopped]\naddress = 2\ntype = "bit"\n'
OWN_AIR = {"ids3010": 3, "lasertex": 4}
"""Lasers with sensors of their own, and how many conditions these tell."""


def of_laser(name, more="", *, source="laser", compensated=False):
    """Return a survey whose control tells of stops alone, and whose air the laser is to tell."""
    laser = f'format = "{name}"\nport = "socket://laser:9090"\n'
    laser += f"compensated = {str(compensated).lower()}"
    text = SMALLEST.replace('format = "umd"\nport = "/dev/ttyUSB0"', laser)
    return parse_survey(f'{text}\n{STOPPED}{more}[environment]\nsource = "{source}"\n', "s")


@pytest.mark.parametrize("name", OWN_AIR)
def test_a_laser_without_the_sensors_that_its_kind_has_is_a_doubt_and_not_20_c(name):
    """An IDS3010 without its environmental unit: nobody knows the air, and nobody is left to
    believe that somebody does."""
    survey = of_laser(name)
    stream = StreamBuffer(laser_decoder(survey))
    felt = with_air(survey, Signals(stopped=True), stream, 1, silent=math.nan)
    judged = Conditions(survey, {}).judge(felt, 0.0)
    assert judged.signals.air_temperature_c is None
    assert [each.code for each in judged.remarks] == ["conditions-held"] * OWN_AIR[name]
    assert [each.code for each in judged.doubted] == ["air-unknown"] * 3


def test_what_the_control_tells_is_not_waited_for_from_the_laser():
    survey = of_laser(
        "lasertex",
        '[plc.signals.material_temperature_c]\naddress = 10\ntype = "int16"\nscale = 0.01\n',
    )
    felt = with_air(
        survey,
        Signals(material_temperature_c=22.0),
        StreamBuffer(laser_decoder(survey)),
        1,
        silent=math.nan,
    )
    assert felt.material_temperature_c == 22.0
    assert math.isnan(felt.air_temperature_c)


def test_conditions_that_nobody_measures_are_said():
    """Before, during and after the survey; a person who states them is believed, a compensated
    laser needs none."""
    ((code, text),) = [
        (each.code, each.text) for each in assumed(of_laser("umd", source="plc"))
    ]
    assert code == "air-unknown"
    assert (
        "air_temperature_c 20, air_pressure_hpa 1013.25, relative_humidity_percent 50" in text
    )
    (rest,) = assumed(of_laser("umd", source="plc"), ["air_pressure_hpa"])
    assert "pressure" not in rest.text
    assert "air_temperature_c 20" in rest.text
    assert assumed(of_laser("umd", source="fixed")) == ()
    assert assumed(of_laser("umd", source="plc", compensated=True)) == ()
    assert assumed(of_laser("ids3010")) == ()
    assert [each.code for each in unchecked(of_laser("umd", source="plc"))][
        -1
    ] == "air-unknown"
