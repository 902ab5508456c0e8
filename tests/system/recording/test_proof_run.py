"""A machine is surveyed, its files are loaded, and ten minutes tell whether they act: by the
daemon, on the virtual machine."""

import json
import re
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


def test_a_proof_run_keeps_right_tables_and_restores_turned_ones(tmp_path):
    """The plan names diagonal, line, programs and what they will see; the run ends in status,
    result and verdict, and with an exit code."""
    (tmp_path / "siemens.toml").write_text(PROFILE, encoding="utf-8")
    with (
        hall(
            tmp_path, setups=SETUPS, n=6, back=True, size=SIZE, bench=MACHINE, exports=EXPORT
        ) as place,
        daemon(place.survey) as process,
    ):
        place.start_setups()
        assert until(process, "survey-complete")[-1]["exit_code"] == 0
    files = sorted(
        path
        for path in (tmp_path / "hall" / "0001" / "exports" / "siemens").glob("*.INI")
        if "_RESTORE" not in path.name
    )
    assert len(files) == 2
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
    active = (
        '[[compensation]]\ncontrol = "siemens"\nfiles = '
        f"{json.dumps([str(path) for path in files])}\n"
    )
    with hall(
        folder,
        setups=("ppp", "linear-x"),
        n=6,
        back=True,
        size=SIZE,
        bench=MACHINE + active,
        exports=EXPORT,
    ) as place:
        export = folder / "hall" / "0001" / "exports" / "siemens"
        named = (
            ("--loaded", export, "--profile", folder / "siemens.toml") if name == "0002" else ()
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
        text = survey.read_text(
            encoding="utf-8"
        )  # the bench drives these two, whichever the plan finds best
        survey.write_text(
            re.sub(r"(?m)^setups = .*", 'setups = ["ppp", "linear-x"]', text), encoding="utf-8"
        )
        with daemon(survey) as process:
            place.start_setups()
            assert until(process, "survey-complete")[-1]["exit_code"] == 0
    shown = stepdiag("proof", survey, "--json")
    verdict = json.loads(shown.out)
    assert shown.code == {"keep": 0, "restore": 5}[verdict["action"]], shown
    result = json.loads(
        (folder / "hall-proof-0001" / name / "result.json").read_text(encoding="utf-8")
    )
    (found,) = [each for each in result["findings"] if each["code"] == "proof"]
    assert found["severity"] == {"keep": "info", "restore": "error"}[verdict["action"]]
    assert found["text"] in stepdiag("status", survey).out.replace("\n", " ")
    return verdict
