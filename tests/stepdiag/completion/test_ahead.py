"""What to drive next by the last survey of the machine, and a further setup put into the survey
file."""

import json
from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import rendered
from stepdiag.base.readings.readings import render_readings
from stepdiag.base.readings.runs import Run
from stepdiag.base.result.members import Facts
from stepdiag.completion.ahead import in_words, known_before, look_ahead, take
from stepdiag.completion.foreseen import circumstances
from stepdiag.daq.records.survey_folder import machine_folder
from stepdiag.daq.survey.file import load_survey
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.planning.sequel import Sequel
from testkit.cli import stepdiag
from testkit.rates import designs
from testkit.rates.sequels import SEVEN
from testkit.running.survey_files import SMALLEST

EMPTY = Sequel(
    runs=(),
    end=True,
    now_um=1.2,
    then_um=1.15,
    minutes=40.0,
    at_most_um=0.14,
    angles_urad=None,
)
SHIFTED = Run(setup="ppp+1", beam_offset_mm=(0.0, 0.0, 150.0))


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "survey.toml"
    path.write_text(
        SMALLEST.lstrip()
        + '[plan]\nsetups = ["ppp", "npp", "pnp", "ppn"]\n[uncertainty]\nrepeatability_um = 0.0\n'
    )
    return path


def before(file, machine, urad=45.0, folder="last year/0001", ended="2025-11-03"):
    """Leave a finished survey of a machine with angles of so many urad in a folder beside."""
    readings = designs.drive(SEVEN, designs.machine_of(urad, 911), np.random.default_rng(1))
    result = replace(
        solve(readings, chain="FXYZ", assumed=designs.about(15.0).assumed),
        survey=Facts(machine=machine, date=ended),
    )
    folder = file.parent / folder
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(result.to_json())
    (folder / "readings.csv").write_text(render_readings(readings))


def test_the_last_survey_of_the_machine_shows_how_large_its_angles_are(file):
    """Before anything is driven: four diagonals leave more of a machine that turned by 45 urad last
    year. Another machine's is left."""
    before(file, "another one")
    usual = look_ahead(file)[2]
    before_name = file.parent / "last year"
    before_name.rename(file.parent / "of another")
    before(file, load_survey(file).identity.machine)
    known = look_ahead(file)[2]
    assert known.then_um > 1.15 * usual.then_um
    assert known.angles_urad is None, "nothing of this survey shows them yet"


def test_the_store_counts_as_a_folder_beside(file):
    """The newest survey of this machine, wherever it stands and whenever it was copied."""
    machine = load_survey(file).identity.machine
    file.write_text(file.read_text().replace("[survey]\n", '[survey]\narchive = "works"\n'))
    with pytest.raises(UsageError, match=r"survey\.archive"):
        look_ahead(file)
    before(
        file,
        machine,
        60.0,
        f"works/{machine_folder(machine)}/year=2026/0123456789abcdef",
        "2026-02-01",
    )
    before(file, machine, 8.0)
    ahead = ("plan", str(file), "--minutes", "160", "--json")
    survey = load_survey(file)
    assert known_before(file, survey, circumstances(survey))[1].name == "0123456789abcdef"
    found = stepdiag(*ahead)
    file.write_text(file.read_text().replace('archive = "works"\n', ""))
    usual, small = (
        json.loads(each.out)["forecast"]["left_um"]["value"]
        for each in (found, stepdiag(*ahead))
    )
    assert small < 0.8 * usual


def test_a_taken_setup_stands_in_the_survey_file(file):
    ahead = replace(EMPTY, runs=(SHIFTED,), end=False)
    status = in_words(ahead, load_survey(file))
    assert (status.setup, status.further) == ("ppp+1", True)
    assert (
        rendered(status.words, "de")
        == "Den größten Gewinn bringt Diagonale X-Y-Z- nach X+Y+Z+ (ppp) auf einer Linie, "
        "verschoben um 150 mm in z: die Abweichung sinkt von 1,2 auf 1,1 µm, in 40 min."
    )
    assert take(file, load_survey(file), ahead) == SHIFTED
    survey = load_survey(file)
    assert survey.plan.all_setups == ("ppp", "ppp+1", "npp", "pnp", "ppn")
    assert survey.planned.run_of("ppp+1").beam_offset_mm == (0.0, 0.0, 150.0)


@pytest.mark.parametrize(
    "ahead",
    [EMPTY, replace(EMPTY, runs=(Run(setup="npp"),), end=False)],
    ids=["at its end", "planned"],
)
def test_nothing_is_taken_where_nothing_further_is_worth_it(file, ahead):
    text = file.read_text()
    with pytest.raises(UsageError, match="a setup outside the plan"):
        take(file, load_survey(file), ahead)
    assert file.read_text() == text
    assert not in_words(ahead, load_survey(file)).further


def test_what_follows_the_next_setup_is_counted(file):
    """One setup is taken at a time; a list of short names names no place."""
    ahead = replace(EMPTY, runs=(SHIFTED, Run(setup="npp"), Run(setup="ppn")), end=False)
    told = str(in_words(ahead, load_survey(file)).words)
    assert (
        "together with 2 later setups: the error decreases from 1.2 to 1.1 µm, in 40 min."
        in told
    )
