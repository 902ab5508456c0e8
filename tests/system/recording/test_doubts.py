"""One life of a finding, over real sockets and ptys: what is doubted keeps its pass open until it
is driven again or accepted."""

import json

import pytest

from testkit.cli import stepdiag
from testkit.running.hall import daemon, hall, until
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

QUICK = {
    "handshake": True,
    "dwell": 0.1,
    "n": 1,
    "laser_bench": "compensated = true\n",
    "laser_survey": "compensated = true\n",
    "exports": '[[export]]\ncontroller = "neutral"\nprofile = "neutral.toml"\n',
}


def fault(**fields):
    return "[[fault]]\n" + "".join(
        f"{key} = {json.dumps(value)}\n" for key, value in fields.items()
    )


UNSIGNALLED = fault(kind="stop-unsignalled", setup="npp", stop=2) + fault(
    kind="dwell-longer", setup="npp", stop=2, duration_s=2.5
)
"""Modbus does not show the stop; it is taken from the laser's plateau, half a second long, and
doubted."""


def drive_all(place, process):
    place.start_setups(stop_after=len(place.setups))
    return until(process, "survey-open")[-1]


@pytest.mark.impatient
def test_a_doubt_keeps_the_survey_open_until_a_person_accepts_it(tmp_path):
    """Readings, no result before; the same words in journal and status, before and after a restart;
    accepted by name, shown, replayed."""
    options = {**QUICK, "exports": "", "handshake": False, "dwell": 2.5}
    with hall(tmp_path, faults=UNSIGNALLED, **options) as place:
        with daemon(place.survey) as process:
            opened = drive_all(place, process)
            assert opened["doubted"] == ["npp/1/2"]
            readings = (place.round / "readings.csv").read_text()
            live = stepdiag("status", place.survey, "--verbose").out
        told = json.loads(stepdiag("status", place.survey, "--json").out)
        assert "state: doubted: diagonal X+Y-Z- to X-Y+Z+ (npp), pass 1 out, stop 3" in live
        assert "machine: connected" in live
        assert not (place.round / "result.json").exists()
        assert [(each["place"], each["code"]) for each in told["doubts"]] == [
            ("npp/1/2", "stop-recovered")
        ]
        assert [each["state"] for each in told["findings"] if each["place"] == "npp/1/2"][
            -1
        ] == "open"
        refused = stepdiag("accept", place.survey, "ppp/1/2", "--reason", "why not")
        assert refused.code == 2
        assert "npp/1/2 (stop-recovered)" in refused.refusal
        with daemon(place.survey) as process:
            done = stepdiag(
                "accept",
                place.survey,
                "npp/1/2",
                "--reason",
                "a hand on the cable",
                "--name",
                "Kim",
            )
            assert done.code == 0, done.refusal
            assert until(process, "survey-complete")[-1]["exit_code"] == 0
        assert (place.round / "readings.csv").read_text() == readings
        result = json.loads((place.round / "result.json").read_text())
        (found,) = [each for each in result["findings"] if each["code"] == "stop-recovered"]
        assert (found["severity"], found["setup"], found["stop"]) == ("warning", "npp", 2)
        assert "accepted by Kim at 2" in found["text"]
        assert "a hand on the cable" in found["text"]
        assert "a hand on the cable" in (place.round / "report.html").read_text()
        assert json.loads(stepdiag("replay", place.round, "--json").out)["different"] == []
    nothing_silently_wrong(place)


def drive_again(place):
    """Write the survey file of a hall whose machine drives some setups twice: the plan names each
    once."""
    text = place.survey.read_text()
    named = ", ".join(f'"{setup}"' for setup in place.setups)
    planned = ", ".join(f'"{setup}"' for setup in dict.fromkeys(place.setups))
    place.survey.write_text(text.replace(f"setups = [{named}]", f"setups = [{planned}]"))


@pytest.mark.impatient
def test_a_hand_through_the_beam_and_a_recovered_stop_are_cured_by_driving_again(tmp_path):
    """Afterwards nothing of them hinders: result and files are there, what happened stands in the
    annex."""
    faults = UNSIGNALLED + fault(
        kind="beam-lost", setup="ppp", stop=2, phase="move", duration_s=0.05
    )
    options = {
        **QUICK,
        "exports": "",
        "handshake": False,
        "dwell": 2.5,
        "setups": ("ppp", "npp", "pnp", "ppn", "ppp", "npp"),
    }
    with hall(tmp_path, faults=faults, **options) as place:
        drive_again(place)
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "survey-complete")
        book = nothing_silently_wrong(place)
    assert {"beam-lost", "stop-recovered"} <= {each.get("code") for each in said}
    assert book.doubts() == ()
    result = json.loads((place.round / "result.json").read_text())
    assert not {"beam-lost", "stop-recovered", "stop-lost"} & {
        each["code"] for each in result["findings"]
    }
    assert not [each for each in result["findings"] if each["severity"] == "error"]
    assert {"beam-lost", "stop-recovered"} <= {each["code"] for each in result["history"]}
    assert "Annex: events during the recording" in (place.round / "report.html").read_text()


@pytest.mark.impatient
def test_a_survey_that_cannot_be_solved_stays_open(tmp_path):
    """The same reason in journal, status and page; the readings are written; the next daemon goes
    on with it, and begins nothing new."""
    (tmp_path / "angles.csv").write_text(
        "axis,position_mm,EA_urad,EB_urad,EC_urad\nx,0,1,1,1\nx,100,nonsense,1,1\n"
    )
    options = {
        **QUICK,
        "exports": '[solver]\nangles = "angles.csv"\n',
        "setups": ("ppp", "npp"),
    }
    with hall(tmp_path, **options) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            opened = until(process, "survey-open")[-1]
            live = stepdiag("status", place.survey, "--verbose").out
        assert "angles.csv" in opened["reason"]
        told = json.loads(stepdiag("status", place.survey, "--json").out)
        assert told["unsolved"] in opened["reason"]
        assert "nonsense" in told["unsolved"]
        assert "every pass is recorded, but there is no result: angles.csv" in live.replace(
            "\n", " "
        )
        assert (place.round / "readings.csv").exists()
        with daemon(place.survey) as process:
            assert until(process, "survey-open")[-1]["reason"] == opened["reason"]
        assert [each.name for each in (tmp_path / "hall").iterdir() if each.is_dir()] == [
            "0001"
        ]
