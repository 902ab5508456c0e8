"""A machine is surveyed, its files are loaded, and ten minutes tell whether they act: by the
daemon, on the virtual machine."""

import json
import re
import shutil
from pathlib import Path

import pytest

from testkit.cli import stepdiag
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.system

SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y")
SIZE = (300.0, 240.0, 120.0)
MACHINE = """
[machine]
positioning_um = 12.0
straightness_um = 12.0
scale_um_m = 40.0
squareness_urad = 30.0
"""
PROFILE = """
[machine]
name = "virtual"
controller = "siemens"
measured_with = "off"
[axes.X]
name = "AX1"
step_mm = 50.0
reference_mm = 0.0
[axes.Y]
name = "AX2"
step_mm = 40.0
reference_mm = 0.0
[axes.Z]
name = "AX3"
step_mm = 20.0
reference_mm = 0.0
[limits]
slope_um_mm = 5.0
[siemens]
measuring_system = 1
"""
EXPORT = '[[export]]\ncontroller = "siemens"\nprofile = "siemens.toml"\n'
DRIVEN = {"n": 6, "back": True, "size": SIZE, "exports": EXPORT}
PACED = {"handshake": True, "dwell": 0.5}
"""No stop takes longer than its capture."""


def surveyed(folder: Path) -> Path:
    """Survey a machine in a folder, with its export; return the folder."""
    folder.mkdir()
    (folder / "siemens.toml").write_text(PROFILE, encoding="utf-8")
    with (
        hall(folder, setups=SETUPS, bench=MACHINE, **DRIVEN, **PACED) as place,
        daemon(place.survey) as process,
    ):
        place.start_setups()
        assert until(process, "survey-complete")[-1]["exit_code"] == 0
    return folder


def exported(surveyed: Path, folder: Path) -> list[Path]:
    """Copy what the survey left into a folder of its own; return the exported files."""
    shutil.copytree(
        surveyed, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("devices")
    )
    files = sorted(
        path
        for path in (folder / "hall" / "0001" / "exports" / "siemens").glob("*.INI")
        if "_RESTORE" not in path.name
    )
    assert len(files) == 2
    return files


def active(files: list[Path]) -> str:
    """Return the lines of a bench whose control holds files."""
    held = json.dumps([str(path) for path in files])
    return f'[[compensation]]\ncontrol = "siemens"\nfiles = {held}\n'


def planning(survey: Path, setups: tuple[str, ...]) -> None:
    """Make a survey file plan these setups."""
    text = survey.read_text(encoding="utf-8")
    survey.write_text(
        re.sub(r"(?m)^setups = .*", f"setups = {json.dumps(setups)}", text), encoding="utf-8"
    )


def record(place, survey: Path, setups: tuple[str, ...]) -> None:
    """Record the setups that the bench drives by a survey file that plans these."""
    planning(survey, setups)
    with daemon(survey) as process:
        place.start_setups()
        assert until(process, "survey-complete")[-1]["exit_code"] == 0


def test_proof_runs_of_a_machine_keep_restore_and_go_on(tmp_path):
    """One survey serves both parts: it takes as long as they do."""
    known = surveyed(tmp_path / "surveyed")
    an_undecided_run_goes_on_with_the_setup_that_it_names(tmp_path / "undecided", known)
    right_tables_are_kept_and_turned_ones_restored(tmp_path / "decided", known)


def an_undecided_run_goes_on_with_the_setup_that_it_names(tmp_path, surveyed):
    """A line alone leaves open all that acts along and across other axes: one diagonal decides
    it, and the line is not driven again."""
    driven = DRIVEN | PACED | {"bench": MACHINE + active(exported(surveyed, tmp_path))}
    with hall(tmp_path, setups=("linear-x",), **driven) as place:
        planning(place.survey, SETUPS)
        options = ("--controller", "siemens", "--minutes", "0.01", "--json")
        planned = stepdiag("proof", place.survey, *options)
        assert planned.code == 0, planned.refusal
        survey = Path(json.loads(planned.out)["survey"])
        record(place, survey, ("linear-x",))
    shown = stepdiag("proof", survey, "--json")
    verdict = json.loads(shown.out)
    assert (shown.code, verdict["action"]) == (3, "undecided"), shown
    right = [each["function"] for each in verdict["tables"] if each["state"] == "right"]
    assert right == ["EXX"]
    (further,) = verdict["further"]
    assert further in SETUPS[:4]
    assert f"Add {further} to the setups" in " ".join(
        stepdiag("proof", survey, "--verbose").out.split()
    )
    port = f"port = {place.ready['plc_port']}"
    with hall(tmp_path, setups=(further,), plc_bench=port, **driven) as place:
        record(place, survey, ("linear-x", further))
    shown = stepdiag("proof", survey, "--json")
    verdict = json.loads(shown.out)
    assert (shown.code, verdict["action"], verdict["further"]) == (0, "keep", []), shown
    assert [each["code"] for each in verdict["tables"]] == 9 * ["right"]


def right_tables_are_kept_and_turned_ones_restored(tmp_path, surveyed):
    """The plan names diagonal, line, programs and what they will see; the run ends in status,
    result and verdict, and with an exit code."""
    files = exported(surveyed, tmp_path)
    for number, sign in enumerate((1, -1), start=1):
        verdict = proved(
            tmp_path,
            [loaded(tmp_path, path, sign if "EEC" in path.name else 1) for path in files],
            f"000{number}",
        )
        by_function = {each["function"]: each["code"] for each in verdict["tables"]}
        assert verdict["action"] == ("keep" if sign == 1 else "restore"), verdict
        assert all(
            code == ("right" if sign == 1 or name[1] != name[2] else "sign-turned")
            for name, code in by_function.items()
        )
        assert len(by_function) == 9
        assert [record.splitlines()[1] for record in verdict["sign_tests"]] == (
            ['kind = "eec"', 'kind = "cec"'] if sign == 1 else []
        )


def loaded(folder: Path, path: Path, sign: int) -> Path:
    """Write a file as the control holds it, its values times a sign."""
    held = folder / f"held{sign:+d}-{path.name}"
    text = path.read_text(encoding="ascii")
    held.write_text(
        text
        if sign == 1
        else re.sub(r"(\$AA_ENC_COMP\[\d+,\d+,\w+\]=)", r"\1-", text).replace("=--", "="),
        encoding="ascii",
    )
    return held


def proved(folder: Path, files: list[Path], name: str) -> dict:
    """Drive a proof run with files in the control; return the verdict that the command prints,
    after status and result hold the same."""
    with hall(
        folder, setups=("ppp", "linear-x"), bench=MACHINE + active(files), **DRIVEN
    ) as place:
        export = folder / "hall" / "0001" / "exports" / "siemens"
        named = (
            ("--loaded", export, "--profile", folder / "siemens.toml")
            if name == "0002"
            else ()
        )  # else as the survey file has them
        options = (
            "--controller",
            "siemens",
            *named,
            "--minutes",
            "0.01",
            "--out",
            folder / "programs",
            "--json",
        )
        planned = stepdiag("proof", place.survey, *options)
        assert planned.code == 0, planned.refusal
        plan = json.loads(planned.out)
        assert [Path(program).exists() for program in plan["programs"]] == [True, True]
        assert {each["function"] for each in plan["foreseen"]} >= {"EXX", "EYX"}
        assert plan["repeats"] == 1
        survey = Path(plan["survey"])
        record(place, survey, ("ppp", "linear-x"))  # as the bench drives, whatever the plan
    shown = stepdiag("proof", survey, "--json")
    verdict = json.loads(shown.out)
    assert shown.code == {"keep": 0, "restore": 5}[verdict["action"]], shown
    result = json.loads(
        (folder / "hall-proof-0001" / name / "result.json").read_text(encoding="utf-8")
    )
    (found,) = [each for each in result["findings"] if each["code"] == "proof"]
    assert found["severity"] == {"keep": "info", "restore": "error"}[verdict["action"]]
    assert found["text"] in stepdiag("status", survey, "--verbose").out.replace("\n", " ")
    return verdict
