"""Every file door of the command line, with files that are right but for one field: a command is done or refused in words, never broken."""

import os
import random
from collections.abc import Callable
from contextlib import chdir
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stepdiag.daq.survey.template import template
from testkit.cli import stepdiag
from testkit.foreign import ANGLES, READINGS, targets
from testkit.machines import MACHINES, profile_text
from testkit.one_field import wrong_csv, wrong_json, wrong_toml
from testkit.recording import HEADER, recording, write_log

EXAMPLES = max(3, int(os.environ.get("STEPDIAG_FUZZ_EXAMPLES", "60")) // 20)
LONGEST_SAID = 20_000
RESULT = targets()["result"].seed.decode()


@dataclass(frozen=True)
class Door:
    """A command, the files it is given, and the one of them that is wrong."""

    command: tuple[str, ...]
    files: dict[str, str]
    wrong: str
    change: Callable[[str, random.Random], str]


def profile_for(name: str) -> str:
    """Return a profile whose tables run over the volume of the result."""
    direction = MACHINES[name].directions[-1]
    return profile_text(name, steps_mm=(100.0, 100.0, 50.0), references_mm=(-200.0, 0.0, -100.0), direction=direction)


def doors() -> dict[str, Door]:
    """Return every door by name."""
    readings, angles, survey = READINGS.decode(), ANGLES.decode(), template().replace("/var/lib", "var")
    found = {
        "solve readings": Door(("solve", "r.csv", "--out", "out.json"), {"r.csv": readings}, "r.csv", wrong_csv),
        "solve angles": Door(("solve", "r.csv", "--angles", "a.csv"), {"r.csv": readings, "a.csv": angles}, "a.csv", wrong_csv),
        "report": Door(("report", "r.json", "--out", "r.html"), {"r.json": RESULT}, "r.json", wrong_json),
        "compare": Door(("compare", "r.json", "s.json"), {"r.json": RESULT, "s.json": RESULT}, "s.json", wrong_json),
        "plan": Door(("plan", "s.toml"), {"s.toml": survey}, "s.toml", wrong_toml),
        "status": Door(("status", "s.toml"), {"s.toml": survey}, "s.toml", wrong_toml),
        "program": Door(("program", "s.toml", "--controller", "fanuc", "--out", "nc"), {"s.toml": survey}, "s.toml", wrong_toml),
        "service": Door(
            ("service", "install", "etc/stepdiag/s.toml", "--root", "."), {"etc/stepdiag/s.toml": survey}, "etc/stepdiag/s.toml", wrong_toml
        ),
        "info": Door(("info", "0001.mcap"), {"survey": survey}, "survey", wrong_toml),
        "replay": Door(("replay", "0001.mcap", "--out", "again"), {"survey": survey}, "survey", wrong_toml),
        "recover": Door(("recover", "0001.mcap", "--out", "mended.mcap"), {"survey": survey}, "survey", wrong_toml),
    }
    for name in MACHINES:
        command = ("export", "r.json", "--controller", name, "--profile", "p.toml", "--out", "files")
        files = {"r.json": RESULT, "p.toml": profile_for(name)}
        found[f"export {name} result"] = Door(command, files, "r.json", wrong_json)
        found[f"export {name} profile"] = Door(command, files, "p.toml", wrong_toml)
    return found


DOORS = doors()


def go_through(door: Door, folder: Path) -> None:
    """Run the command where its files are; fail where it does not end as the contract says."""
    with chdir(folder):
        for name, text in door.files.items():
            Path(name).parent.mkdir(parents=True, exist_ok=True)
            Path(name).write_text(text, encoding="utf-8")
        if "survey" in door.files:
            write_log(Path("0001.mcap"), recording(0.2), header=replace(HEADER, survey_text=door.files["survey"]))
        told = stepdiag(*door.command)
    assert told.code in (0, 2, 3, 5), told
    assert told.code == 0 or told.refusal, "a refusal says why"
    assert len(told.refusal) < LONGEST_SAID
    assert not any(path.name.startswith(".") and path.is_file() for path in folder.rglob("*")), "nothing half written is left"


@pytest.mark.parametrize("name", DOORS)
def test_one_field_wrong_is_done_or_refused_in_words(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    door = DOORS[name]

    @settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck), deadline=None)
    @given(st.integers(0, 2**32))
    def run(seed: int) -> None:
        text = door.change(door.files[door.wrong], random.Random(seed))
        go_through(replace(door, files={**door.files, door.wrong: text}), tmp_path_factory.mktemp("door"))

    run()
