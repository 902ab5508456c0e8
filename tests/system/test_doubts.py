"""One life of a finding, over real sockets and ptys: what is doubted keeps its pass open until it is driven again or accepted."""

import json

import pytest

from testkit.cli import stepdiag
from testkit.hall import daemon, hall, until
from testkit.steady import on_a_steady_computer
from testkit.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

QUICK = {
    "handshake": True,
    "dwell": 0.1,
    "n": 1,
    "laser_bench": "compensated = true\n",
    "laser_survey": "compensated = true\n",
    "exports": '[[export]]\ncontroller = "neutral"\nprofile = "neutral.toml"\n',
}
UNSIGNALLED = '[[fault]]\nkind = "stop-unsignalled"\nsetup = "npp"\nstop = 2\n'
"""Modbus does not show the stop; it is taken from the laser's plateau, and doubted."""


def drive_all(place, process):
    place.start_setups(stop_after=len(place.setups))
    return until(process, "survey-open", timeout_s=40.0)[-1]


@on_a_steady_computer
def test_a_doubt_keeps_the_survey_open_until_a_person_accepts_it(tmp_path):
    """No result before; the same words in journal and status, before and after a restart; accepted with name and time, shown, replayed."""
    options = {**QUICK, "exports": "", "handshake": False, "dwell": 5.0}
    with hall(tmp_path, faults=UNSIGNALLED, **options) as place:
        with daemon(place.survey) as process:
            opened = drive_all(place, process)
            assert opened["doubted"] == ["npp/1/2"]
            live = stepdiag("status", place.survey).out
        told = json.loads(stepdiag("status", place.survey, "--json").out)
        assert "it waits for: doubted: npp/1/2" in live
        assert "machine: connected" in live
        assert not (place.round / "result.json").exists()
        assert [(each["place"], each["code"]) for each in told["doubts"]] == [("npp/1/2", "stop-recovered")]
        assert [each["state"] for each in told["findings"] if each["place"] == "npp/1/2"][-1] == "open"
        refused = stepdiag("accept", place.survey, "ppp/1/2", "--reason", "why not")
        assert refused.code == 2
        assert "npp/1/2 (stop-recovered)" in refused.refusal
        with daemon(place.survey) as process:
            done = stepdiag("accept", place.survey, "npp/1/2", "--reason", "a hand on the cable", "--name", "Kim")
            assert done.code == 0, done.refusal
            assert until(process, "survey-complete", timeout_s=40.0)[-1]["exit_code"] == 0
        result = json.loads((place.round / "result.json").read_text())
        (found,) = [each for each in result["findings"] if each["code"] == "stop-recovered"]
        assert (found["severity"], found["setup"], found["stop"]) == ("warning", "npp", 2)
        assert "accepted by Kim at 2" in found["text"]
        assert "a hand on the cable" in found["text"]
        assert "a hand on the cable" in (place.round / "report.html").read_text()
        assert json.loads(stepdiag("replay", place.round, "--json").out)["different"] == []
    nothing_silently_wrong(place)
