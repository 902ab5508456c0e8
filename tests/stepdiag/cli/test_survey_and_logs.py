"""``init``, ``info`` and ``recover`` as a person and a program meet them."""

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.result.members import software
from stepdiag.cli import logs, survey
from stepdiag.daq.survey.file import load_survey
from testkit.cli import joined, stepdiag
from testkit.recording import recording, write_log

EVENTS = recording(0.5)


def run(*arguments: str | Path) -> str:
    """Run a command; return what it prints, or raise its refusal."""
    app = typer.Typer()
    survey.register(app)
    logs.register(app)
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if isinstance(result.exception, Exception):
        raise result.exception
    assert result.exit_code == 0, result.output
    return joined(result.stdout)


@pytest.fixture
def cut_off(tmp_path: Path) -> Path:
    lengths = write_log(tmp_path / "whole.mcap", EVENTS, flush_every=100)
    part = tmp_path / "0001.mcap.part"
    part.write_bytes((tmp_path / "whole.mcap").read_bytes()[: lengths[2] + 20])
    return part


def test_init_writes_a_survey_that_validates_and_nothing_over_it(tmp_path: Path) -> None:
    path = tmp_path / "survey.toml"
    assert "stepdiag check" in run("init", path)
    assert load_survey(path).volume.increments == 16
    written = path.read_bytes()
    assert b"\r" not in written
    with pytest.raises(
        UsageError,
        match=r"survey\.toml: expected a new file, found a file that already exists",
    ):
        run("init", path)
    assert path.read_bytes() == written
    with pytest.raises(UsageError, match="expected a file that can be written"):
        run("init", tmp_path / "none" / "survey.toml")


def test_init_takes_the_class_of_the_machine_and_its_screws(tmp_path: Path) -> None:
    run(
        "init",
        tmp_path / "a.toml",
        "--machine-class",
        "poor",
        "--feedback",
        "scale",
        "--pitch-mm",
        "16",
    )
    stated = load_survey(tmp_path / "a.toml").uncertainty
    assert (stated.machine_class, stated.feedback, stated.pitch_mm) == ("poor", "scale", 16.0)
    for wrong in (
        ("--machine-class", "best"),
        ("--feedback", "none"),
        ("--pitch-mm", "nan"),
        ("--pitch-mm", "0"),
    ):
        with pytest.raises(UsageError):
            run("init", tmp_path / "b.toml", *wrong)
    assert not (tmp_path / "b.toml").exists()


def test_init_asks_on_a_terminal_until_it_understands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = typer.Typer()
    survey.register(app)
    monkeypatch.setattr("stepdiag.cli.questions.on_terminal", lambda: True)
    asked = CliRunner().invoke(app, [str(tmp_path / "a.toml")], input="best\ngood\n\n20\n")
    assert asked.exit_code == 0, asked.output
    assert (
        "ordinary  a machining centre in a workshop; repeatability 0.5 µm, angular errors 15 µrad"
        in joined(asked.output)
    )
    stated = load_survey(tmp_path / "a.toml").uncertainty
    assert (stated.machine_class, stated.feedback, stated.pitch_mm) == ("good", "screw", 20.0)


def test_info_says_whether_a_log_is_whole(tmp_path: Path, cut_off: Path) -> None:
    whole = run("info", tmp_path / "whole.mcap")
    assert "whole.mcap: the log is complete, complete" in whole
    assert "0 stops, 25 polls of the machine" in whole
    damaged = run("info", cut_off)
    assert (
        "the log is not complete (the log was cut off; 20 bytes cannot be read, and 0 events are "
        "lost); `stepdiag recover` repairs it" in damaged
    )


def test_info_for_programs(tmp_path: Path, cut_off: Path) -> None:
    whole = json.loads(run("info", "--json", tmp_path / "whole.mcap"))
    assert whole["whole"]
    assert whole["events"] == len(EVENTS)
    assert whole["run"]["setup"] == "ppp"
    assert json.loads(run("info", "--json", cut_off))["events"] == 300


def test_recover_says_what_it_kept_and_what_not(cut_off: Path) -> None:
    told = run("recover", cut_off)
    assert "300 events" in told
    assert "20 bytes" in told
    assert "repaired from 0001.mcap.part" in run("info", cut_off.with_suffix(""))
    with pytest.raises(DataError, match="a log is never overwritten"):
        run("recover", cut_off)


def test_recover_for_programs_into_a_named_file(tmp_path: Path, cut_off: Path) -> None:
    told = json.loads(run("recover", cut_off, "--out", tmp_path / "mended.mcap", "--json"))
    assert told["target"] == str(tmp_path / "mended.mcap")
    assert (told["events"], told["lost_bytes"]) == (300, 20)


def test_info_of_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("setup,pass,stop\n", encoding="utf-8")
    with pytest.raises(DataError, match="expected a log of stepdiag"):
        run("info", tmp_path / "a.csv")


def test_the_version_is_that_which_logs_and_results_carry():
    """The remedy of a log that a newer version wrote names this option."""
    assert stepdiag("--version").out == f"stepdiag {software().version}\n"
