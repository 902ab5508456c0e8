"""A survey goes on with setups that its plan did not have: written by hand, or taken from what the
daemon states after each setup."""

import json

import pytest

from testkit.cli import stepdiag
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.system

SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x")
SIZES = 'compensation = "off"\n[uncertainty]\nbetween_um = 0.0\nshape_um = 0.1\n'
"""Of what four coarse diagonals leave between their targets nothing is assumed: so a further setup
gains."""


def gain_of_round(process):
    """Return the last gain of a round that is complete. It is worked out beside the solving, and
    ends before or after it."""
    gains = [each for each in until(process, "survey-complete") if each["event"] == "ahead"]
    return gains[-1] if gains else until(process, "ahead")[-1]


def test_a_survey_goes_on_with_further_setups_and_keeps_its_logs(tmp_path):
    driven = {"back": True, "handshake": True, "dwell": 0.5}
    with hall(tmp_path, setups=SETUPS, propose=True, machine=SIZES, **driven) as place:
        planned = place.survey.read_text()
        place.survey.write_text(planned.replace(', "linear-x"]', "]"))
        with daemon(place.survey) as process:
            place.start_setups(stop_after=1)
            ahead = until(process, "ahead")[-1]
            assert "the error decreases from" in ahead["what"]
            assert ahead["setup"]
            place.start_setups(stop_after=3)
            gain_of_round(process)
            place.survey.write_text(planned)
            assert until(process, "survey-goes-on")[-1]["setups"] == list(SETUPS)
            place.bench.say("start")
            assert gain_of_round(process)["further"]
            code, _, refusal = stepdiag("next", place.survey, "--take")
            assert code == 0, refusal
            went_on = until(process, "survey-goes-on")[-1]
        assert len(went_on["setups"]) == len(SETUPS) + 1
        rounds = [place.folder / "hall" / name for name in ("0001", "0002", "0003")]
        assert [(each / "result.json").exists() for each in rounds] == [True, True, False]
        assert [len(list(each.glob("*.mcap"))) for each in rounds] == [8, 10, 10]
        scales = [
            json.loads((each / "result.json").read_text())["scale"]["X"]["identified"]
            for each in rounds[:2]
        ]
        assert scales == [False, True]
        code, out, refusal = stepdiag(
            "replay", rounds[1], "--out", tmp_path / "again", "--json"
        )
        assert code == 0, refusal
        assert json.loads(out)["different"] == []
        code, out, refusal = stepdiag("status", place.survey, "--json")
        assert code == 0, refusal
        standing = json.loads(out)
        assert standing["round"] == "0003"
        assert [drive["setup"] for drive in standing["to_drive"]] == [
            went_on["setups"][-1]
        ] * 2
