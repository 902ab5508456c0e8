"""A real control proves what it loaded: a table with the wrong sign is found and taken out without
a person deciding."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from stepdiag.base.result.result import parse_result
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import write_set
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.physics.machine import Machine
from testkit.cli import stepdiag
from testkit.linuxcnc.comparison import driven_rms_um
from testkit.linuxcnc.files import screw_files
from testkit.linuxcnc.job import NOISE_UM, daemon, drive, still_missing
from testkit.linuxcnc.machine import BOX, leaning_machine
from testkit.linuxcnc.rig import Control, linuxcnc
from testkit.linuxcnc.stand import Stand
from testkit.linuxcnc.standing import settled

pytestmark = [pytest.mark.system, pytest.mark.control]


@pytest.mark.timeout(1500)
def test_a_wrong_sign_is_undone_on_a_real_control(
    first_survey: Callable[[], tuple[Path, float]], tmp_path: Path
) -> None:
    """Survey, load with one sign turned, drive ten seconds of proof: restore; load the right
    files: keep, and better."""
    machine = leaning_machine()
    first, nothing = first_survey()
    own = tmp_path / "first"
    shutil.copytree(first.parents[1], own, ignore=shutil.ignore_patterns("laser"))
    comp, _ = screw_files(
        parse_result((first / "result.json").read_text(encoding="utf-8"), "result.json"),
        tmp_path,
    )
    wrong = comp | {"X": turned(comp["X"])}
    reached = {}
    for name, held in (("turned", wrong), ("right", comp)):
        with linuxcnc(held, swift=True) as control:
            settled(control)
            verdict = proved(control, machine, own, comp)
            reached[name] = driven_rms_um(control, machine, BOX)
        codes = {each["function"]: each["code"] for each in verdict["tables"]}
        assert codes == {
            "EXX": "sign-turned" if name == "turned" else "right",
            "EYY": "right",
            "EZZ": "right",
        }, verdict
        assert verdict["action"] == ("restore" if name == "turned" else "keep")
    # it takes the COMP_FILE lines out of the INI file, and the control is that of the first survey
    assert (tmp_path / "screw" / "ini_lines_RESTORE.txt").exists()
    print(nothing, reached)
    assert reached["turned"] > 1.1 * nothing
    assert reached["right"] < 0.9 * nothing


def turned(comp: bytes) -> bytes:
    """Return a COMP_FILE whose trims have the other sign: actual positions mirrored at the nominal
    ones."""
    rows = [
        [float(word) for word in line.split()] for line in comp.decode("ascii").splitlines()
    ]
    return "".join(
        f"{at:.6f} {2 * at - ahead:.6f} {2 * at - back:.6f}\n" for at, ahead, back in rows
    ).encode("ascii")


def proved(control: Control, machine: Machine, folder: Path, comp: dict[str, bytes]) -> dict:
    """Plan, record and judge a proof run of COMP_FILEs on a running control; return the verdict as
    the command prints it."""
    held = folder / "loaded"
    write_set(
        held,
        [
            ControlFile(name=f"screw_{axis.lower()}.comp", data=data)
            for axis, data in comp.items()
        ],
    )
    box = Box(origin_mm=BOX.origin_mm, size_mm=BOX.size_mm, increments=BOX.increments)
    with Stand(control, machine, box, folder, noise_um=NOISE_UM) as stand:
        survey = folder / "survey.toml"
        text = re.sub(
            r'(?m)^port = ".*"',
            f'port = "{stand.laser_port}"',
            survey.read_text(encoding="utf-8"),
        )
        survey.write_text(
            re.sub(r"(?m)^port = \d+", f"port = {stand.plc_port}", text), encoding="utf-8"
        )
        options = (
            "--controller",
            "linuxcnc",
            "--loaded",
            held,
            "--profile",
            folder.parent / "screw.toml",
            "--minutes",
            "0.1",
        )
        planned = stepdiag(
            "proof",
            survey,
            *options,
            "--out",
            folder / f"programs{control.plc_port}",
            "--json",
        )
        assert planned.code == 0, planned.refusal
        plan = json.loads(planned.out)
        by_setup = {
            setup: Path(name).read_bytes()
            for setup, name in zip(plan["setups"], plan["programs"], strict=True)
        }
        proof = Path(plan["survey"])
        with daemon(proof) as log:
            for setup, program in by_setup.items():
                drive(control, stand, setup, program)
            rounds = folder / "control-proof-0001"
            newest = max(
                rounds.iterdir(), key=lambda path: path.name if path.is_dir() else ""
            )
            for attempt in range(12):
                missing = still_missing(newest, log, len(by_setup) + attempt)
                if not missing:
                    break
                drive(control, stand, missing, by_setup[missing])
    shown = stepdiag("proof", proof, "--json")
    verdict: dict = json.loads(shown.out)
    assert shown.code == {"keep": 0, "restore": 5, "undecided": 3}[verdict["action"]]
    return verdict
