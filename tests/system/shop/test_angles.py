"""An autocollimator and a level recorded at the same stops by the same daemon: pitch, yaw and roll
reach the estimator."""

import json

import numpy as np
import pytest

from stepdiag.virtual.bench.building import build_machine
from stepdiag.virtual.bench.config import read_config
from testkit.cli import stepdiag
from testkit.examples import spread
from testkit.running.hall import daemon, hall, until
from testkit.running.survey_runs import drive_one_and_kill

pytestmark = pytest.mark.system

SETUPS = (
    "ppp",
    "npp",
    "pnp",
    "ppn",
    "linear-x",
    "linear-y",
    "linear-z",
    "fourdof-x",
    "fourdof-y",
)
BENCH = '[machine]\nangle_urad = 20.0\n[head]\nformat = "{}"\n'
SURVEY = """
[head]
format = "{format}"
port = "{port}"
baud = 9600
[head.angles]
{turns}
u_urad = 0.2
[environment]
source = "plc"
"""
INSTRUMENTS = {
    "elcomat": ('x = ["+C", "+B"]\ny = ["+C", "+A"]', ("ECX", "EBX", "ECY", "EAY")),
    "wyler": ('x = ["+A"]\ny = ["+B"]', ("EAX", "EBY")),
}


@pytest.mark.parametrize("name", spread(list(INSTRUMENTS), 2))
@pytest.mark.impatient
def test_angles_are_recorded_through_a_killed_daemon_identified_and_replayed_to_the_same_bytes(
    tmp_path, name
):
    turns, told = INSTRUMENTS[name]
    survey = SURVEY.format(format=name, port=tmp_path / "devices" / "head", turns=turns)
    options = {
        "laser_bench": BENCH.format(name),
        "laser_survey": survey,
        "handshake": True,
        "dwell": 3.0,
    }
    with hall(tmp_path, setups=SETUPS, **options) as place:
        truth = build_machine(read_config(tmp_path / "bench.toml")).truth(2)
        drive_one_and_kill(place, links=("laser", "machine", "head"))
        with daemon(place.survey, wait_for=("laser", "machine", "head")) as process:
            place.start_setups()
            said = until(process, "survey-complete")
        assert said[-1]["exit_code"] == 0, said[-1]
        result = json.loads((place.round / "result.json").read_text())
        for each in told:
            value = np.array(result["errors"][each]["value"])
            expected = np.array(truth.errors[each])
            assert value - value[0] == pytest.approx(expected - expected[0], abs=1.0), each
        code, out, refusal = stepdiag(
            "replay", place.round, "--out", tmp_path / "again", "--json"
        )
        assert code == 0, refusal
        assert json.loads(out)["different"] == []
