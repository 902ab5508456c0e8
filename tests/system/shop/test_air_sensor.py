"""Air from a sensor of its own, over a pty and over TCP: recorded, judged, replayed through a lost
line and a killed daemon."""

import json
import os
import signal
from contextlib import contextmanager

import numpy as np
import pytest

from stepdiag.daq.records.survey_folder import logs_in
from stepdiag.daq.replay import replay
from testkit.cli import stepdiag
from testkit.running.hall import daemon, hall, until
from testkit.running.survey_runs import drive_and_replay, until_told

pytestmark = pytest.mark.system

BENCH = """
[hall]
air_c = { start = 24.0 }
pressure_hpa = { start = 962.0 }
humidity_percent = { start = 61.0 }
material_c = { start = 22.5 }
[air]
"""
STOPS_ALONE = """
[plc.signals.stopped]
address = 2
type = "bit"
bit = 0
[plc.signals.stop_count]
address = 1
[plc.signals.setup]
address = 3
[plc.signals.running]
address = 2
type = "bit"
bit = 1
"""
PTU300 = 'format = "ptu300"\nbaud = 4800\npoll_s = 0.2\n'
"""Without parity: a pty has none."""
LOGGER = r"""format = "line"
pressure_unit = "kPa"
pattern = '(?P<air_temperature_c>[^;]+);(?P<air_pressure_hpa>[^;]+);(?P<relative_humidity_percent>[^;]+);(?P<material_temperature_c>.+)'
"""  # noqa: E501
SENSORS = {"ptu300": ("serial", PTU300), "logger": ("tcp", LOGGER)}
EXPECTED = {
    "air_temperature_c": 24.0,
    "air_pressure_hpa": 962.0,
    "relative_humidity_percent": 61.0,
}


@contextmanager
def sensed(folder, name, **options):
    """A hall whose air is told by a sensor of this kind, and by nobody else: the control has
    registers for stops alone."""
    wire, section = SENSORS[name]
    bench = f'{BENCH}format = "{name}"\nwire = "{wire}"\n'
    with hall(folder, bench=bench, signals=STOPS_ALONE, **options) as place:
        sensor = (
            '[environment]\nsource = "sensor"\n[environment.sensor]\nport = '
            f'"{place.ready["air_link"]}"\n{section}'
        )
        place.survey.write_text(place.survey.read_text() + sensor)
        yield place


def stops_of(place):
    """Return the stops in use of a survey, from its logs."""
    return [
        stop
        for each in replay(logs_in(place.round)).book.passes
        for stop in each.chosen().values()
    ]


@pytest.mark.parametrize("name", SENSORS)
def test_a_survey_takes_its_air_from_a_sensor_through_a_pulled_cable_and_a_killed_daemon(
    tmp_path, name
):
    """Checked first, as a person would."""
    with sensed(tmp_path, name, handshake=True, dwell=0.5, n=1) as place:
        code, out, said = stepdiag("check", place.survey, "--seconds", "2", "--json")
        assert code == 0, [
            each for each in json.loads(out)["findings"] if each["severity"] == "error"
        ] or said
        assert json.loads(out)["air"]["conditions"] == pytest.approx(
            {**EXPECTED, **({"material_temperature_c": 22.5} if name == "logger" else {})}
        )
        with daemon(place.survey, wait_for=("laser", "machine", "air")) as process:
            until_told(place, EXPECTED)
            place.start_setups(stop_after=1)
            until(process, "pass-ended")
            place.bench.say('fault {"kind": "air-unplug", "duration_s": 1.0}')
            until(process, "link-lost", link="air")
            until(process, "link-connected", link="air")
            os.kill(process.process.pid, signal.SIGKILL)
            process.process.wait()
        drive_and_replay(place, EXPECTED)
        stops = stops_of(place)
        for field, value in EXPECTED.items():
            assert np.array([getattr(stop, field) for stop in stops]) == pytest.approx(
                value, abs=0.06
            ), field
        assert all(stop.held == () for stop in stops)
