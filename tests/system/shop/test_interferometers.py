"""Whole small surveys with the lasers that have a public interface, each virtual instrument written
from its maker's papers."""

import json

import pytest

from testkit.cli import stepdiag
from testkit.examples import spread
from testkit.running.hall import hall
from testkit.running.survey_runs import drive_and_replay, drive_one_and_kill
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

TCP = 'wire = "tcp"\n'
LASERS = {
    "ids3010": (
        TCP,
        "[laser.ids3010]\npoll_hz = 100\ncontrast_full = 800\n[environment]\nsource = 'laser'\n",
        {"air_temperature_c": 21.0},
    ),
    "qudis": (TCP, "", {}),
    "lasertex": (
        "",
        "[environment]\nsource = 'laser'\n",
        {"air_temperature_c": 21.0, "material_temperature_c": 23.0},
    ),
}
"""The qudis, of which `test_no_signals` records a pass, takes its turn in `make explore`."""
HALL = "[hall]\nair_c = { start = 21.0 }\nmaterial_c = { start = 23.0 }\n"


@pytest.mark.parametrize("laser", spread(list(LASERS), 2))
@pytest.mark.impatient
def test_a_survey_is_recorded_through_a_killed_daemon_solved_and_replayed_to_the_same_bytes(
    tmp_path, laser
):
    """Checked first as a person would; air and material are those that the instrument itself
    tells."""
    bench, survey, air = LASERS[laser]
    with hall(
        tmp_path,
        laser=laser,
        laser_bench=bench,
        laser_survey=survey,
        faults=HALL,
        handshake=True,
        dwell=0.5,
        n=1,
        window=0.2,
    ) as place:
        code, out, said = stepdiag("check", place.survey, "--seconds", "3", "--json")
        assert code == 0, said
        seen = json.loads(out)["laser"]
        assert seen["samples"] > 50
        assert seen["garbage"] == 0
        assert {name: seen["conditions"].get(name) for name in air} == pytest.approx(air)
        drive_one_and_kill(place, told=air)
        drive_and_replay(place, air)
        nothing_silently_wrong(place)
        readings = (place.round / "readings.csv").read_text()
        if "material_temperature_c" in air:
            assert ",23" in readings


def test_check_names_the_instrument_that_really_stands_there(tmp_path):
    with hall(tmp_path, laser="lasertex") as place:
        place.survey.write_text(
            place.survey.read_text().replace('format = "lasertex"', 'format = "nd"')
        )
        code, out, _ = stepdiag("check", place.survey, "--seconds", "2", "--json")
    found = {each["code"]: each["text"] for each in json.loads(out)["findings"]}
    assert code == 4
    assert set(found) & {"bytes-garbled", "laser-silent"}
