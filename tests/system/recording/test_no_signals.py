"""A machine that says nothing: a person begins each setup, and the laser alone places and names the
stops."""

import json
import os
import signal
import time

import numpy as np
import pytest

from stepdiag.base.result.field import Tabulated, field_of_um
from stepdiag.daq.survey.file import load_survey
from stepdiag.virtual.base.reserved import reserved_port
from stepdiag.virtual.bench.building import alignment_of, build_box, build_machine
from stepdiag.virtual.bench.config import read_config
from testkit.cli import stepdiag
from testkit.ordinary.measured import simulate_pass
from testkit.running.hall import daemon, hall, ordered, until
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

FIXED = '[environment]\nsource = "fixed"\n'
QUIET = {"silent": True, "patient": False, "dwell": 5.0, "laser_survey": FIXED}


def until_told(place, words):
    """Wait until ``status`` says this: that the daemon has come so far."""
    end = time.monotonic() + 60.0
    while words not in " ".join(
        (told := stepdiag("status", place.survey, "--verbose").out).split()
    ):
        assert time.monotonic() < end, told
        time.sleep(0.05)


def begin_and_start(place, setups):
    """Begin each setup at the terminal, then start its program at the machine, until the last has
    ended."""
    for setup in (*setups, ""):
        while place.bench.next(300.0, "bench")["event"] not in ("waiting", "finished"):
            pass
        if setup:
            until_told(place, f"({setup}) on the page")
            code, _, said = stepdiag("begin", place.survey, setup)
            assert code == 0, said
            place.bench.say("start")


def error_um(place, book):
    """Return how far the readings are from what the machine truly did, rms in um."""
    config = read_config(place.folder / "bench.toml")
    machine, box = build_machine(config), build_box(config)
    errors = []
    for each in book.passes:
        true = simulate_pass(
            machine,
            box,
            each.route.setup,
            each.number,
            alignment=alignment_of(config, each.route.setup),
        )
        chosen = each.chosen()
        off = [
            (stop.reading_mm - true.reading_mm[index]) * 1e3
            for index, stop in sorted(chosen.items())
        ]
        errors += list(np.array(off) - np.mean(off))
    return float(np.sqrt(np.mean(np.square(errors))))


def left_um(place):
    """Return the volumetric error that is left where the machine takes the result off: rms of truth
    less result over the nodes, um."""
    config, survey = read_config(place.folder / "bench.toml"), load_survey(place.survey)
    truth = build_machine(config).truth(survey.box.increments)
    result = json.loads((place.round / "result.json").read_text())
    functions = {}
    for name, true in truth.errors.items():
        told = result["errors"].get(name, {}).get("value") or [None] * len(true)
        found = np.array([0.0 if value is None else value for value in told])
        functions[name] = Tabulated(truth.position_mm[name[2]], (true - found)[None, :])
    squareness = {
        name: np.array([true - (result["squareness"][name]["value"] or 0.0)])
        for name, true in truth.squareness_urad.items()
    }
    axes = [np.asarray(truth.position_mm[letter]) for letter in "XYZ"]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    (left,) = field_of_um(survey.volume, "FXYZ", functions, squareness, nodes)
    return float(np.sqrt(np.mean(np.sum(np.square(left), axis=1))))


@pytest.mark.impatient
def test_a_whole_survey_without_signals_is_as_good_as_one_with_them(tmp_path):
    """The same machine, once with Modbus and once without: same stops, an error at most a tenth
    larger, replayed to the same bytes.

    The readings by themselves, and what is left in the volume after compensation.
    """
    readings_um, volume_um = {}, {}
    for way, options in (("modbus", {"dwell": 5.0, "laser_survey": FIXED}), ("none", QUIET)):
        folder = tmp_path / way
        folder.mkdir()
        with hall(folder, n=1, back=True, **options) as place:
            with daemon(place.survey, wait_for=("laser",)) as process:
                if way == "none":
                    begin_and_start(place, place.setups)
                else:
                    place.start_setups()
                said = until(process, "survey-complete")
            assert said[-1]["exit_code"] == 0, said[-1]
            readings_um[way] = error_um(place, nothing_silently_wrong(place))
            volume_um[way] = left_um(place)
    code, out, refusal = stepdiag(
        "replay", place.round, "--out", tmp_path / "again", "--json"
    )
    assert code == 0, refusal
    assert json.loads(out)["different"] == []
    assert readings_um["none"] < 1.1 * readings_um["modbus"] + 0.01
    assert volume_um["none"] <= 1.1 * volume_um["modbus"] + 0.02
    result = json.loads((place.round / "result.json").read_text())
    assert "no-signals" in {each["code"] for each in result["findings"]}


@pytest.mark.impatient
def test_a_killed_daemon_asks_for_the_pass_from_its_beginning(tmp_path):
    with hall(tmp_path, setups=("ppp",), **QUIET) as place:
        with daemon(place.survey, wait_for=("laser",)) as process:
            assert place.bench.next(300.0, "bench")["event"] == "waiting"
            assert stepdiag("begin", place.survey, "ppp")[0] == 0
            place.bench.say("start")
            until(process, "stop", stop=2)
            os.kill(process.process.pid, signal.SIGKILL)
            process.process.wait()
        with daemon(place.survey, wait_for=("laser",)):
            until_told(place, "(ppp) on the page")
        nothing_silently_wrong(place)


def test_begin_says_why_it_cannot(tmp_path, monkeypatch):
    with hall(tmp_path, **QUIET) as place:
        code, _, said = stepdiag("begin", place.survey, "ppp")
        assert (code, "expected a daemon that records, found" in said) == (2, True)
        with daemon(place.survey, wait_for=("laser",)) as process:
            assert stepdiag("begin", place.survey, "xyz")[0] == 2
            assert stepdiag("begin", place.survey, "npp")[0] == 0
            monkeypatch.setattr(
                "stepdiag.cli.begin.ANSWER_S", 1.0
            )  # that one is not answered at all
            code, _, said = stepdiag("begin", place.survey, "pnp")
            assert code == 3
            assert "(npp), stop 1 of 7" in said
            until(process, "begin-refused")
        code, out, _ = stepdiag("check", place.survey, "--seconds", "1")
        assert code == 0
        assert "the machine sends no signals" in out


def test_a_machine_with_signals_is_not_begun_by_hand(tmp_path):
    with hall(tmp_path) as place:
        code, _, said = stepdiag("begin", place.survey, "ppp")
    assert code == 2
    assert 'plc.transport: expected the value "none"' in said


@pytest.mark.impatient
def test_a_setup_is_chosen_and_begun_on_the_page(tmp_path):
    """By whoever has the token; the page says that somebody has to."""
    port, token = reserved_port(), "a token of the tests"
    with hall(tmp_path, page=True, page_port=port, **QUIET) as place:
        file = tmp_path / "survey.token"
        file.write_text(token)
        file.chmod(0o600)
        text = place.survey.read_text()
        place.survey.write_text(
            text.replace(
                "enabled = true\nport", 'enabled = true\ntoken_file = "survey.token"\nport'
            )
        )
        with daemon(place.survey, wait_for=("laser",)):
            ordered(port, token, "choose-setup", setup="pnp")
            ordered(port, token, "start")
            until_told(place, "(pnp), stop 1 of 7")


@pytest.mark.impatient
def test_the_marker_input_of_a_qudis_hears_the_stop_relay(tmp_path):
    """The edges lie in the laser's own stream; both passes are named, counted, and right."""
    telling = f"[laser.qudis]\nmarker = true\n{FIXED}"
    options = {
        "laser": "qudis",
        "laser_bench": 'wire = "tcp"\n',
        "laser_survey": telling,
        "silent": True,
        "patient": False,
        "dwell": 5.0,
    }
    with (
        hall(tmp_path, setups=("ppp",), back=True, **options) as place,
        daemon(place.survey, wait_for=("laser",)) as process,
    ):
        assert place.bench.next(300.0, "bench")["event"] == "waiting"
        assert stepdiag("begin", place.survey, "ppp")[0] == 0
        place.bench.say("start")
        said = until(
            process,
            "pass-ended",
            reason="diagonal X-Y-Z- to X+Y+Z+ (ppp) back: stop 7 is past",
        )
        assert not [
            each
            for each in said
            if each["event"] == "finding" and each["code"].startswith("count-")
        ]
        book = nothing_silently_wrong(place)
        assert [len(each.chosen()) for each in book.passes] == [7, 7]
