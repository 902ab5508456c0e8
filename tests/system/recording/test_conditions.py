"""Sensors that say what cannot be, and registers of another time, over real sockets and ptys."""

import json
import math

import pytest

from stepdiag.virtual.bench.building import build_machine
from stepdiag.virtual.bench.config import read_config
from testkit.cli import stepdiag
from testkit.running.hall import daemon, hall, until
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

COMPENSATED = {"laser_bench": "compensated = true\n", "laser_survey": "compensated = true\n"}
PACED = {"handshake": True, "dwell": 0.1, "n": 1}


def fault(**fields):
    return "[[fault]]\n" + "".join(
        f"{key} = {json.dumps(value)}\n" for key, value in fields.items()
    )


@pytest.mark.impatient
def test_a_sensor_that_fails_in_the_middle_is_held_and_named(tmp_path):
    """The result has the air of the hall, the report says at how many stops it was held; stated
    afterwards, other air counts."""
    wrong = {
        "ppp": ("air_pressure_hpa", 101.3),
        "npp": ("relative_humidity_percent", 100.3),
        "pnp": ("air_temperature_c", 0.0),
    }
    where = {"kind": "plc-sensor", "stop": 1, "phase": "move", "duration_s": 0.3}
    faults = [
        fault(**where, setup=setup, text=name, value=value)
        for setup, (name, value) in wrong.items()
    ]
    with hall(tmp_path, faults="\n".join(faults), **PACED) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "survey-complete")
        (tmp_path / "air.toml").write_text("[environment]\nair_pressure_hpa = 950.0\n")
        stated = json.loads(
            stepdiag(
                "solve", place.round, "--environment", tmp_path / "air.toml", "--json"
            ).out
        )
    texts = [
        each["text"]
        for each in said
        if each["event"] == "finding" and each["code"] == "conditions-held"
    ]
    assert len(texts) == 3
    for (setup, (name, value)), text in zip(wrong.items(), texts, strict=True):
        assert f"({setup}) out, stop 2 of 4: {name} reads {value:g}" in text
        assert "is used, u = " in text
    result = json.loads((place.round / "result.json").read_text())
    assert result["conditions"]["air_pressure_hpa"] == [1013.2, 1013.2]
    assert sum(each["code"] == "conditions-held" for each in result["findings"]) == 3
    assert stated["conditions"]["air_pressure_hpa"] == [950.0, 950.0]
    assert abs(stated["scale_sum_um"]["value"] - result["scale_sum_um"]["value"]) > 5.0, (
        "17 ppm of some 374 mm"
    )


@pytest.mark.impatient
def test_a_plc_without_sensors_leaves_the_survey_open_with_its_readings(tmp_path):
    """Its registers are zeros: readings are written, nothing is exported; with stated air the
    machine's own result."""
    zeros = fault(kind="plc-sensor", duration_s=1000.0)
    with hall(
        tmp_path, faults=zeros, bench="[hall]\npressure_hpa = { start = 950.0 }\n", **PACED
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            opened = until(process, "survey-open")[-1]
        assert opened["doubted"] == [f"{setup}/1/0" for setup in place.setups]
        assert "solve with --environment FILE" in opened["reason"]
        assert (place.round / "readings.csv").exists()
        assert not (place.round / "result.json").exists()
        (tmp_path / "air.toml").write_text(
            "air_temperature_c = 20.0\nair_pressure_hpa = 950.0\nrelative_humidity_percent = "
            "50.0\nmaterial_temperature_c = 20.0\n"
        )
        guessed = json.loads(stepdiag("solve", place.round, "--json").out)
        stated = json.loads(
            stepdiag(
                "solve", place.round, "--environment", tmp_path / "air.toml", "--json"
            ).out
        )
    assert [each["code"] for each in guessed["findings"] if each["severity"] == "error"] == [
        "air-unknown"
    ] * 4
    assert [each["code"] for each in stated["findings"] if each["severity"] == "error"] == []
    true = build_machine(read_config(tmp_path / "bench.toml")).truth(1).errors
    lengths_mm = {"EXX": 300.0, "EYY": 200.0, "EZZ": 100.0}
    sum_um = sum(length * true[name][-1] for name, length in lengths_mm.items()) / math.hypot(
        *lengths_mm.values()
    )
    assert stated["scale_sum_um"]["value"] == pytest.approx(sum_um, abs=0.15)
    assert guessed["scale_sum_um"]["value"] == pytest.approx(sum_um - 6.35, abs=0.15), (
        "63 hPa of 374 mm"
    )


@pytest.mark.impatient
def test_registers_that_stand_still_close_no_stop(tmp_path):
    """The machine drives on behind them: what they said meanwhile is believed of no stop."""
    frozen = fault(kind="plc-frozen", setup="ppp", stop=2, delay_s=0.35, duration_s=2.6)
    with hall(
        tmp_path, setups=("ppp",), n=2, dwell=5.0, faults=frozen, **COMPENSATED
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "pass-ended")
            live = stepdiag("status", place.survey, "--verbose").out
        nothing_silently_wrong(place)
    assert "heartbeat-still" in {each.get("code") for each in said}
    assert "(ppp): pass 1" in live
