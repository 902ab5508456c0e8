"""A real control: LinuxCNC drives the programs of `exporters.programs`, the daemon records and solves, the control loads the files."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import numpy as np
import pytest

from stepdiag.exporters.linuxcnc.control import LinuxCnc
from stepdiag.exporters.programs import Sequence, nc_programs, passes_of, setup_number
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.tables import total_correction_um
from stepdiag.solver.geometry.volume import Volume
from stepdiag.solver.result.result import Function, parse_result
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment
from stepdiag.virtual.physics.error_functions import Amplitudes, random_errors
from stepdiag.virtual.physics.machine import Machine
from testkit.linuxcnc_rig import Control, State, linuxcnc
from testkit.linuxcnc_stand import LATENCY_S, Stand
from testkit.machines import profile_of
from testkit.results import made_result

pytestmark = [pytest.mark.system, pytest.mark.control]

VOLUME = Volume(origin_mm=(-200.0, -100.0, -150.0), size_mm=(400.0, 200.0, 150.0), increments=4)
SWIFT = Sequence(name="rig", volume=VOLUME, feed_mm_min=30000.0, dwell_s=0.15, overrun_mm=5.0)

SURVEY = """\
[survey]
name = "control"
machine = "LinuxCNC, simulated axes"
[volume]
origin_mm = {origin}
size_mm = {size}
increments = {increments}
[plan]
setups = {setups}
return_pass = false
feed_mm_min = 12000.0
dwell_s = 0.6
[machine]
compensation = "off"
[laser]
format = "umd"
port = "{laser}"
compensated = true
latency_s = {latency}
[laser.umd]
phase_bits = 16
[plc]
host = "127.0.0.1"
port = {port}
[stop]
settle_s = 0.1
min_window_s = 0.25
[page]
enabled = false
[[export]]
controller = "linuxcnc"
profile = "linuxcnc.toml"
"""
PROFILE = """\
[machine]
name = "LinuxCNC, simulated axes"
controller = "linuxcnc"
measured_with = "off"
functions = ["EXX", "EYY", "EZZ"]
[axes.X]
name = "X"
step_mm = 100.0
reference_mm = -200.0
backlash_um = 0.0
[axes.Y]
name = "Y"
step_mm = 50.0
reference_mm = -100.0
backlash_um = 0.0
[axes.Z]
name = "Z"
step_mm = 37.5
reference_mm = -150.0
backlash_um = 0.0
[[sign_test]]
kind = "comp"
date = {date}
verdict = "as-error"
[linuxcnc]
joints = {{ X = [0], Y = [1], Z = [2] }}
"""


def stands(control: Control, program: bytes) -> list[State]:
    """Drive a program and return the state late in each stop: the last one that was seen standing with that counter."""
    seen: dict[int, State] = {}

    def watch(state: State) -> None:
        if state.stopped:
            seen[state.count] = state

    control.on_state = watch
    control.run(program)
    return list(seen.values())


def test_the_control_stands_exactly_where_the_survey_commands() -> None:
    """Every stop of outward and return pass, with its setup and counter, in position, and nothing left on afterwards."""
    sequence = replace(SWIFT, setups=("npp", "linear-z"))
    with linuxcnc() as control:
        for program in nc_programs(sequence, "linuxcnc"):
            driven = stands(control, program.data)
            wanted = [stop for each in passes_of(sequence, program.setup) for stop in each.stops]
            assert [state.count for state in driven] == [stop.count for stop in wanted]
            assert {state.setup for state in driven} == {setup_number(program.setup)}
            assert all(state.in_position for state in driven)
            positions = [stop.position_mm for stop in wanted]
            np.testing.assert_allclose([state.commanded_mm for state in driven], positions, rtol=0, atol=1e-6)
            after = control.wait_for(lambda state: not state.running)
            assert (after.setup, after.stopped) == (0, False)


def test_the_handshake_holds_the_control() -> None:
    """Without the answer the control stays at its first stop; each answer lets it go on to the next."""
    sequence = replace(SWIFT, volume=replace(VOLUME, increments=1), setups=("linear-x",), return_pass=False, handshake=True)
    program = nc_programs(sequence, "linuxcnc")[0].data
    with linuxcnc() as control:
        since_ns: dict[int, int] = {}
        answered_ns: dict[int, int] = {}

        def answer(state: State) -> None:
            if not state.stopped or state.count in answered_ns:
                return
            if state.time_ns - since_ns.setdefault(state.count, state.time_ns) > 1_000_000_000:
                answered_ns[state.count] = state.time_ns
                control.captured(state.count)

        control.on_state = answer
        control.run(program)
    assert list(answered_ns) == [1, 2]


def test_the_control_applies_the_files_as_the_law_says() -> None:
    """Motors are moved by what `correction_um` says, forward and in reverse: signs, interpolation between rows, held ends."""
    errors = {"EXX": [0.0, 9.0, 4.0, -7.0, -20.0], "EYY": [3.0, 1.0, 0.0, 2.0, 8.0], "EZZ": [0.0, -5.0, -5.0, 1.0, 6.0]}
    profile = profile_of("linuxcnc", VOLUME, sections=8, direction="both")
    result = made_result(errors, reversal={"EXX": [6.0] * 5, "EZZ": [-4.0, -3.0, -2.0, -1.0, 0.0]}, volume=VOLUME)
    controller = LinuxCnc()
    plan = controller.plan(curves_of(result, ["EXX", "EYY", "EZZ"]), profile)
    files = [file for file in controller.render(plan.tables, profile) if file.role == "data"]
    tables = controller.parse(files, profile)
    sequence = replace(SWIFT, setups=("ppn",), volume=replace(VOLUME, increments=5))
    program = nc_programs(sequence, "linuxcnc")[0].data
    travel = np.array([1, 1, -1])
    with linuxcnc({file.name[-6].upper(): file.data for file in files}) as control:
        driven = stands(control, program)
    outward = passes_of(sequence, "ppn")[0]
    for number, state in enumerate(driven):
        way = travel if number < len(outward.stops) else -travel
        point = np.array([state.commanded_mm])
        law = [
            total_correction_um([t for t in tables if t.input_axis == axis], point, int(sign)).sum()
            for axis, sign in zip("XYZ", way, strict=True)
        ]
        moved_um = (np.array(state.motor_mm) - np.array(state.commanded_mm)) * 1000.0
        np.testing.assert_allclose(moved_um, law, rtol=0, atol=1e-3)


BACKLASH_UM = 8.0


def test_a_comp_file_holds_the_backlash_that_it_switches_off() -> None:
    """What the motor gives between approach in + and approach in - is BACKLASH without a table, and the same with one, to 0.1 um.

    The control itself forgets its BACKLASH where a COMP_FILE is: with a file of zeros the lost motion would be back in full.
    """
    errors = {"EXX": [0.0, 9.0, 4.0, -7.0, -20.0]}
    profile = profile_of("linuxcnc", VOLUME, sections=8)
    axes = {letter: msgspec.structs.replace(axis, backlash_um=BACKLASH_UM) for letter, axis in profile.axes.items()}
    profile = replace(profile, axes=axes)
    controller = LinuxCnc()
    tables = controller.plan(curves_of(made_result(errors, volume=VOLUME), ["EXX"]), profile).tables
    (file,) = (file for file in controller.render(tables, profile) if file.role == "data")
    zeros = b"-200 -200 -200\n200 200 200\n"
    program = nc_programs(replace(SWIFT, setups=("linear-x",)), "linuxcnc")[0].data
    moved = {}
    for name, files in (("as it was", {}), ("zeros", {"X": zeros}), ("ours", {"X": file.data})):
        with linuxcnc(files, backlash_mm={"X": BACKLASH_UM / 1000.0}) as control:
            driven = stands(control, program)
        moved[name] = np.array([(state.motor_mm[0] - state.commanded_mm[0]) * 1000.0 for state in driven])
    there = VOLUME.increments + 1
    forward, reverse = {name: um[:there] for name, um in moved.items()}, {name: um[there:][::-1] for name, um in moved.items()}
    np.testing.assert_allclose(forward["as it was"][1:-1] - reverse["as it was"][1:-1], BACKLASH_UM, atol=0.1)
    np.testing.assert_allclose(forward["zeros"][1:-1] - reverse["zeros"][1:-1], 0.0, atol=0.1)
    np.testing.assert_allclose(forward["ours"][1:-1] - reverse["ours"][1:-1], BACKLASH_UM, atol=0.1)
    middle = (forward["ours"][1:-1] + reverse["ours"][1:-1]) / 2.0
    np.testing.assert_allclose(middle, -np.array(errors["EXX"][1:-1]), atol=0.1)


MACHINE_ERRORS = Amplitudes(positioning_um=8.0, straightness_um=6.0, scale_um_m=20.0, squareness_urad=15.0)
NOISE_UM = 0.2
"""Of one laser sample; a stop is the mean of some hundreds of them."""
FILE_UM = 0.005
"""What files in whole nanometres and a correction taken at the commanded instead of the actual position leave."""


@pytest.mark.timeout(900)
def test_the_whole_job_on_a_real_control(tmp_path: Path) -> None:
    """Survey, solve, export, load, measure again: the positioning error at the targets falls to the noise of the readings.

    Nothing of the control is imitated: its interpreter reads the programs, its trajectory planner drives, its screw
    compensation moves the motors; the laser sees the machine's exact physics at those motor positions.
    """
    machine = Machine(errors=random_errors(5, VOLUME.origin_mm, VOLUME.size_mm, MACHINE_ERRORS))
    with linuxcnc() as control:
        first = surveyed(control, machine, tmp_path / "before", ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z"))
    before = positioning(first)
    truth = machine.truth(VOLUME.increments)
    for name, function in before.items():
        assert np.ptp(function.value) > 4.0
        np.testing.assert_array_less(np.abs(function.value - truth.errors[name]), 5.0 * function.u + FILE_UM)
    files = {letter: (first / "exports" / "linuxcnc" / f"screw_{letter.lower()}.comp").read_bytes() for letter in "XYZ"}
    with linuxcnc(files) as control:
        after = positioning(surveyed(control, machine, tmp_path / "after", ("linear-x", "linear-y", "linear-z")))
    for name, function in after.items():
        noise_um = np.hypot(function.u, before[name].u)
        assert np.max(noise_um) < 0.05
        np.testing.assert_array_less(np.abs(function.value), 5.0 * noise_um + FILE_UM)


def surveyed(control: Control, machine: Machine, folder: Path, setups: tuple[str, ...]) -> Path:
    """Let the daemon record and solve a survey that the control drives; return the folder of its results."""
    folder.mkdir()
    sequence = replace(SWIFT, setups=setups, return_pass=False, dwell_s=0.6, feed_mm_min=12000.0)
    box = Box(origin_mm=VOLUME.origin_mm, size_mm=VOLUME.size_mm, increments=VOLUME.increments)
    (folder / "linuxcnc.toml").write_text(PROFILE.format(date=datetime.now(tz=UTC).date()), encoding="utf-8")
    with Stand(control, machine, box, folder, noise_um=NOISE_UM) as stand:
        survey = SURVEY.format(
            origin=list(VOLUME.origin_mm),
            size=list(VOLUME.size_mm),
            increments=VOLUME.increments,
            setups=list(setups),
            port=stand.plc_port,
            laser=stand.laser_port,
            latency=LATENCY_S,
        )
        (folder / "survey.toml").write_text(survey, encoding="utf-8")
        with daemon(folder / "survey.toml") as log:
            for program in nc_programs(sequence, "linuxcnc"):
                stand.readout.align(program.setup, Alignment())
                time.sleep(1.0)
                control.run(program.data)
            return finished(folder / "control" / "0001", log)


@contextmanager
def daemon(survey: Path) -> Iterator[Path]:
    """Run ``stepdiag run`` beside the machine; it must end cleanly when it is told to."""
    log = survey.parent / "daemon.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "stepdiag", "run", str(survey)], stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
        )
    try:
        until(lambda: b"ready" in log.read_bytes() or process.poll() is not None, log)
        yield log
    finally:
        process.terminate()
        assert process.wait(30.0) == 0, log.read_text(errors="replace")


def finished(folder: Path, log: Path) -> Path:
    """Return the folder of the survey when its result is there, written last."""
    until((folder / "result.json").exists, log)
    return folder


def until(done: Callable[[], bool], log: Path, timeout_s: float = 60.0) -> None:
    ends_s = time.monotonic() + timeout_s
    while not done():
        assert time.monotonic() < ends_s, log.read_text(errors="replace")[-4000:]
        time.sleep(0.1)


def positioning(folder: Path) -> dict[str, Function]:
    """Return the solved positioning errors: zero at the first target, with their standard uncertainty."""
    path = folder / "result.json"
    result = parse_result(path.read_text(encoding="utf-8"), path.name)
    return {name: result.errors[name] for name in ("EXX", "EYY", "EZZ")}
