"""The INI file names what acts: every change that an export asks for can be made, and taken back to the letter."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import is_restore
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.profile import Profile
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.linuxcnc.ini import changed

RESULT = made_result({"EXX": [0, 3, 8, 12, 20], "EYY": [0, -2, -5, -7, -9]}, squareness={"C0Y": 20.0})
INI = {"[KINS]": ["KINEMATICS = trivkins coordinates=XYZ"], "[HAL]": ["HALFILE = mill.hal"], "[JOINT_0]": ["BACKLASH = 0.004"]}
SCREWS = {"[JOINT_0]": ["COMP_FILE = own_x.comp", "COMP_FILE_TYPE = 0"]}
SQUARE = {"[KINS]": ["KINEMATICS = matrixkins"], "[HAL]": ["HALFILE = mill.hal", "HALFILE = own.hal"]}


def profile(way: str, existing: Sequence[ControlFile] = ()) -> Profile:
    made = profile_of("linuxcnc", VOLUME)
    return replace(made, options=msgspec.structs.replace(made.options, way=way), existing=tuple(existing))


def own(*names: str) -> list[ControlFile]:
    """The machine's own COMP_FILE of X and its coefficients, under names of its own."""
    control = controller_named("linuxcnc")
    files = control.render(control.plan(curves_of(RESULT, ["EXX", "EXY"]), profile("screw")).tables, profile("screw"))
    named = {"own_x.comp": "screw_x.comp", "own.hal": "squareness.hal"}
    return [replace(file, name=name) for name in names for file in files if file.name == named[name]]


@pytest.mark.parametrize(
    ("existing", "before"),
    [((), INI), (("own_x.comp",), {**INI, "[JOINT_0]": [*INI["[JOINT_0]"], *SCREWS["[JOINT_0]"]]}), (("own.hal",), {**INI, **SQUARE})],
)
@pytest.mark.parametrize("way", ["screw", "kinematics"])
def test_there_and_back(way, existing, before, tmp_path: Path):
    """From nothing, from a COMP_FILE or from coefficients to new tables or to the lattice: nothing old acts on, all comes back."""
    export(RESULT, "linuxcnc", profile(way, own(*existing)), out_dir=tmp_path / "out", accept=["change-large"])
    (lines,) = (path for path in (tmp_path / "out").glob("ini_lines*.txt") if not is_restore(path.name))
    after = changed(before, lines.read_text(encoding="ascii"))
    acting = [line for section in after.values() for line in section if line.startswith(("COMP_FILE =", "KINEMATICS", "HALFILE"))]
    if way == "kinematics":
        assert sorted(line.partition(" coordinates")[0] for line in acting) == [
            "HALFILE = mill.hal",
            "HALFILE = stepdiagkins.hal",
            "KINEMATICS = stepdiagkins",
        ]
    else:
        assert not [line for line in acting if "own" in line]
        assert acting.count("COMP_FILE = screw_x.comp") == 1
        assert "KINEMATICS = matrixkins" in acting
    restored = changed(after, (tmp_path / "out" / "ini_lines_RESTORE.txt").read_text(encoding="ascii"), INI["[KINS]"][0])
    assert {section: sorted(lines) for section, lines in restored.items() if lines} == {key: sorted(each) for key, each in before.items()}
    for file in own(*existing):
        assert (tmp_path / "out" / file.name.replace(".", "_RESTORE.")).read_bytes() == file.data
