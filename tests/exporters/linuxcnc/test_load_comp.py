"""The script that loads COMP_FILEs writes only where the configuration holds what the export takes
for held, and brings it back."""

import shutil
import subprocess
import sys
from dataclasses import replace
from datetime import date
from pathlib import Path

import msgspec
import pytest

from stepdiag.base.compensation import Statement, stated
from stepdiag.base.result.members import Facts
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.tables.curves import curves_of
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

CONTROL = controller_named("linuxcnc")
OLD, LEFT = {"EXX": [0, 3, 8, 12, 20]}, {"EXX": [0, 1, 0, -1, 0], "EYY": [0, -2, -5, -7, -9]}
ACCEPT = ("change-large", "correction-small")
INI = """\
[EMC]
MACHINE = mill
# a comment
[JOINT_0]
HOME = 0
{zero}[JOINT_1]
HOME = 0
{one}[JOINT_2]
HOME = 0
"""
NAMED = "COMP_FILE = {}\nCOMP_FILE_TYPE = 0\n"


def own(name: str = "screw_x.comp") -> ControlFile:
    base = profile_of("linuxcnc", VOLUME)
    tables = CONTROL.plan(curves_of(made_result(OLD), ["EXX"]), base).tables
    (file,) = (each for each in CONTROL.render(tables, base) if each.name == "screw_x.comp")
    return replace(file, name=name)


def exported(folder: Path, existing: tuple[ControlFile, ...], state: str) -> Path:
    """Return the folder of an export, with its sign test made."""
    base = profile_of("linuxcnc", VOLUME)
    machine = msgspec.structs.replace(
        base.machine, measured_with=state, functions=["EXX", "EYY"]
    )
    said = (
        stated("on", {file.name: file.data for file in existing}, date(2026, 6, 1), "copied")
        if state == "on"
        else Statement(state="off")
    )
    result = replace(made_result(LEFT), survey=said.facts(Facts(machine="test machine")))
    profile = replace(base, existing=existing, machine=machine)
    export(result, "linuxcnc", profile, accept=ACCEPT, out_dir=folder)
    for path in folder.glob("*_UNTESTED_SIGN*"):
        path.rename(folder / path.name.replace("_UNTESTED_SIGN", ""))
    return folder


def machine(folder: Path, *, zero: str = "", one: str = "", files: dict[str, bytes]) -> Path:
    folder.mkdir()
    for name, data in files.items():
        (folder / name).write_bytes(data)
    (folder / "mill.ini").write_text(INI.format(zero=zero, one=one), encoding="utf-8")
    return folder / "mill.ini"


def load(folder: Path, ini: Path, *words: str) -> tuple[int, str]:
    told = subprocess.run(
        [sys.executable, folder / "load_comp.py", ini, *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=20.0,
    )
    return told.returncode, told.stderr


@pytest.mark.parametrize("name", ["screw_x.comp", "own_x.comp"])
def test_what_is_listed_goes_and_comes_back(name: str, tmp_path: Path) -> None:
    """Under the name of the new file, and under a name of its own; loaded twice as well."""
    old = own(name)
    folder = exported(tmp_path / "out", (old,), "on")
    ini = machine(tmp_path / "mill", zero=NAMED.format(name), files={name: old.data})
    before = ini.read_text(encoding="utf-8")
    for _ in range(2):
        assert load(folder, ini) == (0, "")
        text = ini.read_text(encoding="utf-8")
        assert text.count("COMP_FILE = screw_x.comp") == 1
        assert "own_x" not in text
        for each in ("screw_x.comp", "screw_y.comp"):
            assert (ini.parent / each).read_bytes() == (folder / each).read_bytes()
    assert load(folder, ini, "--restore") == (0, "")
    assert sorted(ini.read_text(encoding="utf-8").split()) == sorted(before.split())
    assert (ini.parent / name).read_bytes() == old.data
    assert (ini.parent / "mill.ini.before").read_text(encoding="utf-8") == before


OTHER = b"-200 -200.01 -200.01\n200 200.01 200.01\n"


@pytest.mark.parametrize(
    ("zero", "one", "held", "words"),
    [
        (NAMED.format("screw_x.comp"), "", {"screw_x.comp": OTHER}, "rows are not those"),
        (NAMED.format("screw_x.comp"), "", {}, "rows are not those"),
        ("", "", {"screw_x.comp": None}, "names no COMP_FILE"),
        (
            NAMED.format("screw_x.comp"),
            NAMED.format("wear.comp"),
            {"screw_x.comp": None, "wear.comp": OTHER},
            "[JOINT_1] names wear.comp",
        ),
        (
            "COMP_FILE = screw_x.comp\nCOMP_FILE_TYPE = 1\n",
            "",
            {"screw_x.comp": None},
            "TYPE 1",
        ),
    ],
    ids=["edited", "gone", "not named", "nobody listed", "trims"],
)
def test_whatever_else_the_configuration_holds_stops_it(
    zero, one, held, words, tmp_path: Path
) -> None:
    """Old tables that acted while measuring; None stands for the file that is listed."""
    old = own()
    folder = exported(tmp_path / "out", (old,), "on")
    files = {name: old.data if data is None else data for name, data in held.items()}
    ini = machine(tmp_path / "mill", zero=zero, one=one, files=files)
    before = {path.name: path.read_bytes() for path in ini.parent.iterdir()}
    code, why = load(folder, ini)
    assert code == 1
    assert words in why
    assert {path.name: path.read_bytes() for path in ini.parent.iterdir()} == before


def test_tables_that_nobody_listed_stop_it_and_an_empty_configuration_does_not(
    tmp_path: Path,
) -> None:
    folder = exported(tmp_path / "out", (), "off")
    held = machine(
        tmp_path / "held", zero=NAMED.format("screw_x.comp"), files={"screw_x.comp": OTHER}
    )
    assert load(folder, held)[0] == 1
    bare = machine(tmp_path / "bare", files={})
    assert load(folder, bare) == (0, "")


def test_files_without_a_sign_test_are_not_loaded(tmp_path: Path) -> None:
    folder = exported(tmp_path / "out", (), "off")
    shutil.move(folder / "screw_x.comp", folder / "screw_x_UNTESTED_SIGN.comp")
    code, why = load(folder, machine(tmp_path / "bare", files={}))
    assert code == 1
    assert "screw_x.comp is not in this folder" in why
