"""The INI file names what acts: every change that an export asks for can be made, and taken back to
the letter."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import is_restore
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.profile import Profile
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.linuxcnc.ini import changed

RESULT = made_result(
    {"EXX": [0, 3, 8, 12, 20], "EYY": [0, -2, -5, -7, -9]}, squareness={"C0Y": 20.0}
)
INI = {
    "[KINS]": ["KINEMATICS = trivkins coordinates=XYZ"],
    "[HAL]": ["HALFILE = mill.hal"],
    "[JOINT_0]": ["BACKLASH = 0.004"],
}
SCREWS = {"[JOINT_0]": ["COMP_FILE = own_x.comp", "COMP_FILE_TYPE = 0"]}
SQUARE = {
    "[KINS]": ["KINEMATICS = matrixkins"],
    "[HAL]": ["HALFILE = mill.hal", "HALFILE = own.hal"],
}


def profile(way: str, existing: Sequence[ControlFile] = ()) -> Profile:
    made = profile_of("linuxcnc", VOLUME)
    return replace(
        made, options=msgspec.structs.replace(made.options, way=way), existing=tuple(existing)
    )


def own(*names: str) -> list[ControlFile]:
    """The machine's own COMP_FILE of X and its coefficients, under names of its own."""
    control = controller_named("linuxcnc")
    files = control.render(
        control.plan(curves_of(RESULT, ["EXX", "EXY"]), profile("screw")).tables,
        profile("screw"),
    )
    named = {"own_x.comp": "screw_x.comp", "own.hal": "squareness.hal"}
    return [
        replace(file, name=name)
        for name in names
        for file in files
        if file.name == named[name]
    ]


@pytest.mark.parametrize(
    ("existing", "before"),
    [
        ((), INI),
        (("own_x.comp",), {**INI, "[JOINT_0]": [*INI["[JOINT_0]"], *SCREWS["[JOINT_0]"]]}),
        (("own.hal",), {**INI, **SQUARE}),
    ],
)
@pytest.mark.parametrize("way", ["screw", "kinematics"])
def test_there_and_back(way, existing, before, tmp_path: Path):
    """From nothing, from a COMP_FILE or from coefficients to new tables or to the lattice: nothing
    old acts on, all comes back."""
    export(
        RESULT,
        "linuxcnc",
        profile(way, own(*existing)),
        out_dir=tmp_path / "out",
        accept=["change-large"],
    )
    (lines,) = (
        path
        for path in (tmp_path / "out").glob("ini_lines*.txt")
        if not is_restore(path.name)
    )
    after = changed(before, lines.read_text(encoding="ascii"))
    acting = [
        line
        for section in after.values()
        for line in section
        if line.startswith(("COMP_FILE =", "KINEMATICS", "HALFILE"))
    ]
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
    restored = changed(
        after,
        (tmp_path / "out" / "ini_lines_RESTORE.txt").read_text(encoding="ascii"),
        INI["[KINS]"][0],
    )
    assert {section: sorted(lines) for section, lines in restored.items() if lines} == {
        key: sorted(each) for key, each in before.items()
    }
    for file in own(*existing):
        assert (
            tmp_path / "out" / file.name.replace(".", "_RESTORE.")
        ).read_bytes() == file.data


@pytest.mark.parametrize("way", ["screw", "kinematics"])
def test_a_comp_file_that_the_ini_file_did_not_name_stays_out(way, tmp_path: Path):
    """Off while measuring: nothing in the files states whether the INI file names them, so the
    lines are bound to what it named."""
    export(
        RESULT,
        "linuxcnc",
        profile(way, own("own_x.comp")),
        out_dir=tmp_path / "out",
        accept=["change-large"],
    )
    notes = sorted(
        (tmp_path / "out").glob("ini_lines*.txt"), key=lambda path: is_restore(path.name)
    )
    there, back = (path.read_text(encoding="ascii") for path in notes)
    # COMP_FILE_TYPE is 0 by the control's own rule where no line states it, so it may come back
    # without its COMP_FILE
    unnamed = SCREWS["[JOINT_0]"]
    after = changed(INI, there, unnamed=unnamed[:1] if way == "screw" else unnamed)
    assert "own" not in str(after)
    restored = changed(
        after, back, INI["[KINS]"][0], unnamed=unnamed[:1] if way == "screw" else unnamed
    )
    assert {section: sorted(lines) for section, lines in restored.items() if lines} == {
        key: sorted(each) for key, each in INI.items()
    }


LIMITED = {
    "[JOINT_0]": ["MIN_LIMIT = -205.0", "MAX_LIMIT = 205.0"],
    "[JOINT_1]": ["MIN_LIMIT = -10.0", "MAX_LIMIT = 410.0"],
}
TRAVEL = {"X": (-205.0, 205.0), "Y": (-10.0, 410.0)}


def travelling(made: Profile, travel_mm: Mapping[str, tuple[float, float]]) -> Profile:
    axes = {
        name: msgspec.structs.replace(axis, travel_mm=travel_mm.get(name))
        for name, axis in made.axes.items()
    }
    return replace(made, axes=axes)


@pytest.mark.parametrize("unit", ["mm", "inch"])
def test_the_limits_of_the_joints_leave_room_for_the_corrections(unit, tmp_path: Path):
    """An axis at its software limit, its joint corrected outwards: nothing stops, and the way back
    is exact."""
    made = travelling(profile("kinematics"), TRAVEL)
    mm = 25.4 if unit == "inch" else 1.0
    export(
        RESULT,
        "linuxcnc",
        replace(made, machine=msgspec.structs.replace(made.machine, units=unit)),
        out_dir=tmp_path,
    )
    there, back = (
        (tmp_path / name).read_text(encoding="ascii")
        for name in ("ini_lines.txt", "ini_lines_RESTORE.txt")
    )
    named = [line for line in there.splitlines() if line.startswith("- ")]
    assert len(named) == 4, "Z has no travel"
    assert "# [JOINT_2]: axes.Z.travel_mm is not stated" in there
    held = lattice.parse(
        ControlFile(name="lattice.csv", data=(tmp_path / "lattice.csv").read_bytes())
    )
    before = {**INI, "[JOINT_0]": named[:2], "[JOINT_1]": named[2:]}
    before = {
        section: [line.removeprefix("- ") for line in lines]
        for section, lines in before.items()
    }
    after = changed(before, there)
    for index, letter in enumerate("XY"):
        low, high = (
            float(line.partition(" = ")[2]) * mm
            for line in sorted(after[f"[JOINT_{index}]"], reverse=True)
        )
        needed_mm = np.max(np.abs(held.vectors_um[..., index])) / 1000.0
        for room_mm in (TRAVEL[letter][0] - low, high - TRAVEL[letter][1]):
            assert needed_mm < room_mm < needed_mm + 0.00101
    if unit == "mm":
        assert {section: before[section] for section in LIMITED} == LIMITED
    assert changed(after, back, INI["[KINS]"][0]) == before


def test_a_second_lattice_starts_from_the_widened_limits(tmp_path: Path):
    """The INI file holds the limits of the lattice before; they are what goes out, and what comes
    back."""
    made = travelling(profile("kinematics"), TRAVEL)
    export(RESULT, "linuxcnc", made, out_dir=tmp_path / "first")
    first = changed(
        {**INI, **LIMITED}, (tmp_path / "first" / "ini_lines.txt").read_text(encoding="ascii")
    )
    file = ControlFile(
        name="lattice.csv", data=(tmp_path / "first" / "lattice.csv").read_bytes()
    )
    larger = made_result(
        {"EXX": [0, 6, 16, 24, 40], "EYY": [0, -4, -10, -14, -18]}, squareness={"C0Y": 40.0}
    )
    export(
        larger,
        "linuxcnc",
        replace(made, existing=(file,)),
        out_dir=tmp_path / "second",
        accept=["change-large"],
    )
    second = changed(
        first, (tmp_path / "second" / "ini_lines.txt").read_text(encoding="ascii")
    )
    assert len(second["[JOINT_0]"]) == 2, "one MIN_LIMIT and one MAX_LIMIT"
    assert second["[JOINT_0]"] != first["[JOINT_0]"]
    assert (
        changed(
            second,
            (tmp_path / "second" / "ini_lines_RESTORE.txt").read_text(encoding="ascii"),
        )
        == first
    )


@pytest.mark.parametrize(("beyond_mm", "named"), [(0.0, True), (0.005, True), (0.1, False)])
def test_a_travel_without_room_for_the_corrections_is_named(beyond_mm, named, tmp_path: Path):
    """20 µm at the end of X, where the travel ends 0, 5 or 100 µm behind the volume."""
    made = travelling(profile("kinematics"), {"X": (-200.0 - beyond_mm, 200.0 + beyond_mm)})
    short = made_result({"EXX": [0, -3, -8, -12, -20]})
    report = export(
        short, "linuxcnc", made, out_dir=tmp_path, accept=["beyond-travel"] if named else []
    )
    assert [
        (each.code, each.severity) for each in report.findings if each.code == "beyond-travel"
    ] == [("beyond-travel", "warning")] * named
