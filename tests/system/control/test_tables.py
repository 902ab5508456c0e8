"""A real control applies COMP_FILEs as the exporter's law says: signs, rows, ends, and the BACKLASH
that they switch off."""

import subprocess
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest

from stepdiag.base.volume import Volume
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import write_set
from stepdiag.exporters.linuxcnc.control import LinuxCnc
from stepdiag.exporters.programs import Sequence, nc_programs, passes_of
from stepdiag.exporters.safety.read_back import compare
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.tables import total_correction_um
from testkit.exact.machines import profile_of
from testkit.exact.results import made_result
from testkit.linuxcnc.rig import linuxcnc
from testkit.linuxcnc.standing import stands

pytestmark = [pytest.mark.system, pytest.mark.control]

VOLUME = Volume(
    origin_mm=(-200.0, -100.0, -150.0), size_mm=(400.0, 200.0, 150.0), increments=2
)
SWIFT = Sequence(name="rig", volume=VOLUME, feed_mm_min=90000.0, dwell_s=0.1, overrun_mm=5.0)
LINES = ("linear-x", "linear-y", "linear-z")
BACKLASH_UM = 8.0


def test_the_control_applies_the_files_as_the_law_says() -> None:
    """Motors are moved by what `correction_um` says, forward and in reverse: signs, interpolation
    between rows, held ends."""
    errors = {"EXX": [0.0, 9.0, -20.0], "EYY": [3.0, 1.0, 8.0], "EZZ": [0.0, -5.0, 6.0]}
    profile = profile_of("linuxcnc", VOLUME, sections=8, direction="both")
    result = made_result(
        errors, reversal={"EXX": [6.0] * 3, "EZZ": [-4.0, -2.0, 0.0]}, volume=VOLUME
    )
    controller = LinuxCnc()
    plan = controller.plan(curves_of(result, ["EXX", "EYY", "EZZ"]), profile)
    files = [file for file in controller.render(plan.tables, profile) if file.role == "data"]
    tables = controller.parse(files, profile)
    sequence = replace(
        SWIFT, setups=("ppn",), volume=replace(VOLUME, size_mm=(390.0, 195.0, 150.0))
    )
    program = nc_programs(sequence, "linuxcnc")[0].data
    travel = np.array([1, 1, -1])
    with linuxcnc({file.name[-6].upper(): file.data for file in files}) as control:
        driven = stands(control, program)
    outward = passes_of(sequence, "ppn")[0]
    for number, state in enumerate(driven):
        way = travel if number < len(outward.stops) else -travel
        point = np.array([state.commanded_mm])
        law = [
            total_correction_um(
                [t for t in tables if t.input_axis == axis], point, int(sign)
            ).sum()
            for axis, sign in zip("XYZ", way, strict=True)
        ]
        moved_um = (np.array(state.motor_mm) - np.array(state.commanded_mm)) * 1000.0
        np.testing.assert_allclose(moved_um, law, rtol=0, atol=1e-3)


def test_what_the_control_holds_is_read_back_number_by_number(tmp_path: Path) -> None:
    """Loaded by the script of the export, read out of the running control while it drives,
    compared; the files of another survey show, and are not loaded over these."""
    profile = profile_of("linuxcnc", VOLUME, sections=2, direction="both")
    controller = LinuxCnc()
    sets = []
    for errors in (
        {"EXX": [0.0, 9.0, -20.0], "EYY": [3.0, 1.0, 8.0]},
        {"EXX": [0.0, 9.0, -20.0], "EYY": [3.0, 1.2, 8.0]},
    ):
        result = made_result(errors, reversal={"EXX": [6.0] * 3}, volume=VOLUME)
        plan = controller.plan(curves_of(result, ["EXX", "EYY"]), profile)
        files = controller.render(plan.tables, profile)
        beside = controller.read_back(plan.tables, profile)
        write_set(tmp_path / str(len(sets)), [*files, *beside])
        sets.append([file for file in files if file.role == "data"])
    written, another = sets
    program, reader, _ = beside
    loaded = partial(load, folder=tmp_path / "0", refused=False)
    with linuxcnc(prepared=loaded) as control:
        load(control.folder / "rig.ini", folder=tmp_path / "1", refused=True)
        (control.folder / reader.name).write_bytes(reader.data)
        pairs = ["0", "screw_x.comp", "1", "screw_y.comp"]
        words = ["/usr/bin/python3", reader.name, *pairs]
        reading = subprocess.Popen(
            words,
            cwd=control.folder,
            env={"PATH": "/usr/bin:/bin"},
            stderr=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        control.run(program.data)
        said, missed = reading.communicate(timeout=120.0)
        assert reading.returncode == 0, missed.decode()
        names = [f"held_screw_{letter}.comp" for letter in "xy"]
        assert said.decode().split() == names
        held = [
            ControlFile(name=name, data=(control.folder / name).read_bytes())
            for name in names
        ]
    same = compare(controller, written, held, profile)
    assert [found.text for found in same.findings] == []
    assert same.numbers == 3 * 3
    (found,) = compare(controller, another, held, profile).findings
    assert (found.key, found.message.arguments["label"].arguments["function"]) == (
        "read-back-differs",
        "EYY",
    )


def load(ini: Path, *, folder: Path, refused: bool) -> None:
    """Run the loading script of an export with the system's own Python."""
    told = subprocess.run(
        ["/usr/bin/python3", folder / "load_comp.py", ini],
        capture_output=True,
        text=True,
        check=False,
        env={"PATH": "/usr/bin:/bin"},
        timeout=20.0,
    )
    assert told.returncode == int(refused), told.stderr
    assert ("rows are not those of machine.existing" in told.stderr) == refused


def test_a_comp_file_holds_the_backlash_that_it_switches_off() -> None:
    """What the motor gives between approach in + and approach in - is BACKLASH without a table, and
    the same with one, to 0.1 um.

    X has our file, Y a file of zeros, Z none: the control itself forgets its BACKLASH where a
    COMP_FILE is, so Y has none of it left.
    """
    errors = {"EXX": [0.0, 9.0, -7.0]}
    profile = profile_of("linuxcnc", VOLUME, sections=8)
    axes = {
        letter: msgspec.structs.replace(axis, backlash_um=BACKLASH_UM)
        for letter, axis in profile.axes.items()
    }
    profile = replace(profile, axes=axes)
    controller = LinuxCnc()
    tables = controller.plan(
        curves_of(made_result(errors, volume=VOLUME), ["EXX"]), profile
    ).tables
    (file,) = (file for file in controller.render(tables, profile) if file.role == "data")
    zeros = b"-200 -200 -200\n200 200 200\n"
    moved = {}
    with linuxcnc(
        {"X": file.data, "Y": zeros}, backlash_mm=dict.fromkeys("XYZ", BACKLASH_UM / 1000.0)
    ) as control:
        for axis, program in enumerate(nc_programs(replace(SWIFT, setups=LINES), "linuxcnc")):
            driven = stands(control, program.data)
            moved["XYZ"[axis]] = np.array(
                [
                    (state.motor_mm[axis] - state.commanded_mm[axis]) * 1000.0
                    for state in driven
                ]
            )
    there = VOLUME.increments + 1
    forward, reverse = (
        {name: um[:there] for name, um in moved.items()},
        {name: um[there:][::-1] for name, um in moved.items()},
    )
    np.testing.assert_allclose(forward["Z"][1:-1] - reverse["Z"][1:-1], BACKLASH_UM, atol=0.1)
    np.testing.assert_allclose(forward["Y"][1:-1] - reverse["Y"][1:-1], 0.0, atol=0.1)
    np.testing.assert_allclose(forward["X"][1:-1] - reverse["X"][1:-1], BACKLASH_UM, atol=0.1)
    middle = (forward["X"][1:-1] + reverse["X"][1:-1]) / 2.0
    np.testing.assert_allclose(middle, -np.array(errors["EXX"][1:-1]), atol=0.1)
