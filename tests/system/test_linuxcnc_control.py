"""A real control: LinuxCNC drives the programs of `exporters.programs`, the daemon records and solves, the control loads the files."""

import json
import re
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import UNTESTED, suffixed
from stepdiag.exporters.linuxcnc.control import LinuxCnc
from stepdiag.exporters.profiles.file import load_profile
from stepdiag.exporters.programs import Sequence, nc_programs, passes_of, setup_number
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.tables import total_correction_um
from stepdiag.solver.geometry.volume import Volume
from stepdiag.solver.result.field import without_rigid_motion
from stepdiag.solver.result.result import Result, parse_result
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment
from stepdiag.virtual.physics.error_functions import Amplitudes, random_errors
from stepdiag.virtual.physics.machine import Machine
from testkit.exact.machines import profile_of
from testkit.exact.results import made_result
from testkit.linuxcnc.rig import Control, State, linuxcnc
from testkit.linuxcnc.stand import LATENCY_S, Stand

pytestmark = [pytest.mark.system, pytest.mark.control]

VOLUME = Volume(origin_mm=(-200.0, -100.0, -150.0), size_mm=(400.0, 200.0, 150.0), increments=2)
SWIFT = Sequence(name="rig", volume=VOLUME, feed_mm_min=90000.0, dwell_s=0.1, overrun_mm=5.0)

DIAGONALS = ("ppp", "npp", "pnp", "ppn")
LINES = ("linear-x", "linear-y", "linear-z")

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
feed_mm_min = {feed}
dwell_s = {dwell}
overrun_mm = 5.0
[machine]
{state}
[solver]
angles = "angles.csv"
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
poll_hz = 100.0
[plc.handshake]
enabled = true
[stop]
settle_s = 0.02
min_window_s = 0.05
[page]
enabled = false
{export}
"""
OFF = 'compensation = "off"'
ON = 'compensation = "on"\nactive = ["lattice.csv"]\nactive_date = 2026-01-31\nactive_source = "the folder of the INI file"'
EXPORT = '[[export]]\ncontroller = "linuxcnc"\nprofile = "linuxcnc.toml"'


def stands(control: Control, program: bytes) -> list[State]:
    """Drive a program and return the state late in each stop: the last one that was seen standing with that counter."""
    seen: dict[int, State] = {}

    def watch(state: State) -> None:
        if state.stopped:
            seen[state.count] = state

    before, control.on_state = control.on_state, watch
    control.run(program)
    control.on_state = before
    return list(seen.values())


@pytest.fixture(scope="class")
def control() -> Iterator[Control]:
    with linuxcnc(swift=True) as control:
        yield control


class TestPrograms:
    """The programs on a control without any compensation."""

    def test_the_control_stands_exactly_where_the_survey_commands(self, control: Control) -> None:
        """Every stop of outward and return pass, with its setup and counter, in position, and nothing left on afterwards."""
        sequence = replace(SWIFT, setups=("npp", "linear-z"))
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

    def test_the_handshake_holds_the_control(self, control: Control) -> None:
        """Without the answer the control stays at its first stop; each answer, written over Modbus, lets it go on to the next."""
        sequence = replace(SWIFT, volume=replace(VOLUME, increments=1), setups=("linear-x",), return_pass=False, handshake=True)
        program = nc_programs(sequence, "linuxcnc")[0].data
        with socket.create_connection(("127.0.0.1", control.plc_port)) as plc:
            since_ns: dict[int, int] = {}
            answered: list[int] = []

            def answer(state: State) -> None:
                if not state.stopped or state.count in answered:
                    return
                if state.time_ns - since_ns.setdefault(state.count, state.time_ns) > 500_000_000:
                    answered.append(state.count)
                    plc.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 6, 100, state.count))

            control.on_state = answer
            control.run(program)
        assert answered == [1, 2]


def test_the_control_applies_the_files_as_the_law_says() -> None:
    """Motors are moved by what `correction_um` says, forward and in reverse: signs, interpolation between rows, held ends."""
    errors = {"EXX": [0.0, 9.0, -20.0], "EYY": [3.0, 1.0, 8.0], "EZZ": [0.0, -5.0, 6.0]}
    profile = profile_of("linuxcnc", VOLUME, sections=8, direction="both")
    result = made_result(errors, reversal={"EXX": [6.0] * 3, "EZZ": [-4.0, -2.0, 0.0]}, volume=VOLUME)
    controller = LinuxCnc()
    plan = controller.plan(curves_of(result, ["EXX", "EYY", "EZZ"]), profile)
    files = [file for file in controller.render(plan.tables, profile) if file.role == "data"]
    tables = controller.parse(files, profile)
    sequence = replace(SWIFT, setups=("ppn",), volume=replace(VOLUME, size_mm=(390.0, 195.0, 150.0)))
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

    X has our file, Y a file of zeros, Z none: the control itself forgets its BACKLASH where a COMP_FILE is, so Y has none of it left.
    """
    errors = {"EXX": [0.0, 9.0, -7.0]}
    profile = profile_of("linuxcnc", VOLUME, sections=8)
    axes = {letter: msgspec.structs.replace(axis, backlash_um=BACKLASH_UM) for letter, axis in profile.axes.items()}
    profile = replace(profile, axes=axes)
    controller = LinuxCnc()
    tables = controller.plan(curves_of(made_result(errors, volume=VOLUME), ["EXX"]), profile).tables
    (file,) = (file for file in controller.render(tables, profile) if file.role == "data")
    zeros = b"-200 -200 -200\n200 200 200\n"
    moved = {}
    with linuxcnc({"X": file.data, "Y": zeros}, backlash_mm=dict.fromkeys("XYZ", BACKLASH_UM / 1000.0)) as control:
        for axis, program in enumerate(nc_programs(replace(SWIFT, setups=LINES), "linuxcnc")):
            driven = stands(control, program.data)
            moved["XYZ"[axis]] = np.array([(state.motor_mm[axis] - state.commanded_mm[axis]) * 1000.0 for state in driven])
    there = VOLUME.increments + 1
    forward, reverse = {name: um[:there] for name, um in moved.items()}, {name: um[there:][::-1] for name, um in moved.items()}
    np.testing.assert_allclose(forward["Z"][1:-1] - reverse["Z"][1:-1], BACKLASH_UM, atol=0.1)
    np.testing.assert_allclose(forward["Y"][1:-1] - reverse["Y"][1:-1], 0.0, atol=0.1)
    np.testing.assert_allclose(forward["X"][1:-1] - reverse["X"][1:-1], BACKLASH_UM, atol=0.1)
    middle = (forward["X"][1:-1] + reverse["X"][1:-1]) / 2.0
    np.testing.assert_allclose(middle, -np.array(errors["EXX"][1:-1]), atol=0.1)


BOX = Volume(origin_mm=(-200.0, -100.0, -160.0), size_mm=(384.0, 192.0, 168.0), increments=8)
MACHINE_ERRORS = Amplitudes(positioning_um=5.0, straightness_um=5.0, angle_urad=10.0, scale_um_m=60.0, squareness_urad=60.0)
LOST_MOTION_UM = 0.3
FEED_MM_MIN = 90000.0
DWELL_S = 0.12
TILT = Alignment(mirror_mrad=(0.4, -0.3), beam_mrad=(0.1, 0.15))
NOISE_UM = 0.05
"""Of one laser sample; a stop is the mean of a dozen, as a longer one of a noisier laser is of a hundred."""
U_ANGLE_URAD = 1.0
AGAIN = replace(BOX, increments=2)
"""Squareness needs no more."""
ATTEMPTS = 5
APART = ((0.06, 0.77), (0.19, 0.93), (0.06, 0.77))
"""Where the grid lies in the volume, along each axis: at no stop of the survey."""


@pytest.mark.timeout(1500)
def test_the_whole_loop_on_a_real_control(tmp_path: Path) -> None:
    """Survey, solve, export, load, drive where nobody measured: each form of compensation reaches what it can hold, and no more.

    Nothing of the control is imitated: its interpreter reads the programs, its trajectory planner drives, the product's own component
    serves its signals over Modbus and takes the handshake, and the compensation moves its motors. The laser sees the exact physics of the
    machine at those motor positions: mirror and beam lean, the axes have backlash, and angles of 10 urad turn the mirror. Its diagonals
    again, with the component active, find square axes; the angles file is left out then, because the component has taken their levers away.
    """
    machine = leaning_machine()
    (tmp_path / "angles.csv").write_text(angles_of(machine), encoding="utf-8")
    with linuxcnc(swift=True) as control:
        first, nothing = surveyed(control, machine, tmp_path, "first", (*DIAGONALS, "linear-x", "linear-y"), BOX)
        reached = {"nothing": nothing}
    result = parse_result((first / "result.json").read_text(encoding="utf-8"), "result.json")
    whole = {
        name: (first / "exports" / "linuxcnc" / name).read_bytes()
        for name in ("lattice.csv", "stepdiagkins.c", "stepdiagkins.hal", "ini_lines.txt")
    }
    comp, squareness = screw_files(result, tmp_path)
    with linuxcnc(comp, whole | lattice_file(squareness), swift=True) as control:
        control.set("stepdiagkins.enable", "0")
        settled(control)
        reached["screws"] = driven_rms_um(control, machine)
        control.set("stepdiagkins.enable", "1")
        settled(control)
        reached["screws and squareness"] = driven_rms_um(control, machine)
    with linuxcnc(kinematics=whole, swift=True) as control:
        settled(control)
        again, reached["kinematics"] = surveyed(control, machine, tmp_path, "again", DIAGONALS, AGAIN, active=whole["lattice.csv"])
    held = lattice.parse(ControlFile(name="lattice.csv", data=whole["lattice.csv"]))
    with linuxcnc(kinematics=whole | lattice_file(replace(held, vectors_um=-held.vectors_um)), swift=True) as control:
        settled(control)
        reached["signs turned"] = driven_rms_um(control, machine)
    print({name: round(um, 2) for name, um in reached.items()})
    assert reached["nothing"] > 10.0
    assert reached["kinematics"] < 1.0
    assert 2.0 * reached["kinematics"] < reached["screws and squareness"] < reached["screws"] < reached["nothing"]
    assert reached["signs turned"] > 1.8 * reached["nothing"]
    found = parse_result((again / "result.json").read_text(encoding="utf-8"), "result.json")
    assert "angles-left-out" in {finding.code for finding in found.findings}
    for name, quantity in found.squareness.items():
        assert abs(result.squareness[name].value or 0.0) > 5.0
        assert abs(quantity.value or 99.0) < 1.0, (name, quantity)


def leaning_machine() -> Machine:
    """Return a machine with all 21 errors and backlash."""
    errors = random_errors(3, BOX.origin_mm, BOX.size_mm, MACHINE_ERRORS)
    backlash = {name: lambda position_mm: np.full(len(position_mm), LOST_MOTION_UM) for name in ("EXX", "EYY", "EZZ")}
    return Machine(errors=replace(errors, reversal=backlash))


def angles_of(machine: Machine) -> str:
    """Return the angles file of an autocollimator that measured every axis at the stops, good to `U_ANGLE_URAD`."""
    rng, truth = np.random.default_rng(2), machine.truth(BOX.increments)
    rows = ["axis,position_mm,EA_urad,EB_urad,EC_urad,u_urad"]
    for letter in "XYZ":
        seen = [truth.errors[f"E{turn}{letter}"] + rng.normal(0.0, U_ANGLE_URAD, BOX.increments + 1) for turn in "ABC"]
        for index, at in enumerate(truth.position_mm[letter]):
            values = ",".join(f"{column[index] - column[0]:.4f}" for column in seen)
            rows.append(f"{letter.lower()},{at:g},{values},{U_ANGLE_URAD}")
    return "\n".join([*rows, ""])


def screw_files(result: Result, folder: Path) -> tuple[dict[str, bytes], lattice.Lattice]:
    """Return the COMP_FILEs of the same result by axis, and the movement of its matrixkins coefficients as a lattice.

    Debian's LinuxCNC has no matrixkins: the same straight lines go through our component.
    """
    (folder / "screw.toml").write_text(profile_text("screw"), encoding="utf-8")
    profile = load_profile(folder / "screw.toml", LinuxCnc(), result.volume)
    report = export(result, "linuxcnc", profile, out_dir=folder / "screw", accept=("sign-untested",))
    comp = {letter: (folder / "screw" / suffixed(f"screw_{letter.lower()}.comp", UNTESTED)).read_bytes() for letter in "XYZ"}
    axes = tuple(np.array([low, low + size]) for low, size in zip(BOX.origin_mm, BOX.size_mm, strict=True))
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    moved = total_correction_um([table for table in report.tables if table.kind == "matrixkins"], corners.reshape(-1, 3))
    return comp, lattice.Lattice(axes_mm=axes, vectors_um=moved.reshape(corners.shape))


def lattice_file(held: lattice.Lattice) -> dict[str, bytes]:
    """Return a lattice with the INI line that loads it, in the place of those of an export."""
    rows = held.vectors_um[..., 0].size
    ini = f"[KINS]\nKINEMATICS = stepdiagkins coordinates=XYZ lattice=lattice.csv vertices={rows}\n[HAL]\nHALFILE = stepdiagkins.hal\n"
    return {"lattice.csv": lattice.render(held).data, "ini_lines.txt": ini.encode()}


def settled(control: Control) -> None:
    """Wait until the compensation has come in or gone: the joints have stopped following the slew limit."""
    places = [control.state.motor_mm]
    while len(places) < 10 or places[-10] != places[-1]:
        time.sleep(0.05)
        places.append(control.state.motor_mm)
        assert len(places) < 400, places[-1]


def driven_rms_um(control: Control, machine: Machine) -> float:
    """Return the true error of the tool, rms without rigid motion, on a grid that no survey touched."""
    steps = [[low + share * size for share in shares] for shares, low, size in zip(APART, BOX.origin_mm, BOX.size_mm, strict=True)]
    points = np.array([(x, y, z) for x in steps[0] for y in steps[1] for z in steps[2]])
    left: dict[int, np.ndarray] = {}
    for _ in range(ATTEMPTS):
        missing = [number for number in range(len(points)) if number not in left]
        left |= driven_um(control, machine, points, missing)
        if len(left) == len(points):
            errors = np.array([left[number] for number in range(len(points))])
            return float(np.sqrt(np.mean(np.sum(without_rigid_motion(BOX, points, errors) ** 2, axis=1))))
    raise AssertionError(f"the rig was told of {len(left)} of {len(points)} stops in {ATTEMPTS} attempts")


def driven_um(control: Control, machine: Machine, points: np.ndarray, numbers: list[int]) -> dict[int, np.ndarray]:
    """Return the error vector at each of the numbered points that the rig saw the control stand at; it may look away on a busy computer."""
    lines = ["G21 G90 G61.1"]
    for number in numbers:
        x, y, z = points[number]
        lines += [f"G53 G1 X{x:.6f} Y{y:.6f} Z{z:.6f} F90000", f"M68 E1 Q{number + 1}", "M64 P0", "G4 P0.08", "M65 P0"]
    direction, last = np.zeros(3), np.array(control.state.commanded_mm)
    ways = {}
    for number in numbers:
        moved = points[number] - last
        direction = np.where(np.abs(moved) > 1e-3, np.sign(moved), direction)
        ways[number], last = direction, points[number]
    seen = {state.count - 1: state for state in stands(control, "\n".join([*lines, "M2", ""]).encode("ascii"))}
    return {
        number: (machine.pose(np.array([seen[number].motor_mm]), direction=ways[number]).origin_mm[0] - points[number]) * 1e3
        for number in numbers
        if number in seen
    }


def profile_text(way: str) -> str:
    """Return the profile of the control for COMP_FILEs or for the kinematics component."""
    steps = {letter: size / (2 * BOX.increments) for letter, size in zip("XYZ", BOX.size_mm, strict=True)}
    axes = [
        f'[axes.{letter}]\nname = "{letter}"\nstep_mm = {steps[letter]}\nreference_mm = {low}\nbacklash_um = 0.0'
        for letter, low in zip("XYZ", BOX.origin_mm, strict=True)
    ]
    machine = '[machine]\nname = "LinuxCNC, simulated axes"\ncontroller = "linuxcnc"\nmeasured_with = "off"'
    limits, joints = "[limits]\nslope_um_mm = 1.0", f'[linuxcnc]\njoints = {{ X = [0], Y = [1], Z = [2] }}\nway = "{way}"'
    return "\n".join([machine, *axes, limits, joints, ""])


def surveyed(
    control: Control, machine: Machine, folder: Path, name: str, setups: tuple[str, ...], volume: Volume, active: bytes = b""
) -> tuple[Path, float]:
    """Let the daemon record and solve a survey that the control drives, and export where no lattice is ``active``.

    Returns its folder, and what the machine errs on the grid, which is driven while the daemon solves.
    """
    own = folder / name
    own.mkdir()
    sequence = Sequence(
        name=name, volume=volume, setups=setups, return_pass=False, feed_mm_min=FEED_MM_MIN, dwell_s=DWELL_S, overrun_mm=5.0, handshake=True
    )
    box = Box(origin_mm=volume.origin_mm, size_mm=volume.size_mm, increments=volume.increments)
    (own / "linuxcnc.toml").write_text(profile_text("kinematics"), encoding="utf-8")
    (own / "angles.csv").write_bytes((folder / "angles.csv").read_bytes())
    with Stand(control, machine, box, own, noise_um=NOISE_UM) as stand:
        survey = SURVEY.format(
            origin=list(volume.origin_mm),
            size=list(volume.size_mm),
            increments=volume.increments,
            setups=list(setups),
            feed=FEED_MM_MIN,
            dwell=DWELL_S,
            port=stand.plc_port,
            laser=stand.laser_port,
            latency=LATENCY_S,
            state=ON if active else OFF,
            export="" if active else EXPORT,
        )
        if active:
            (own / "lattice.csv").write_bytes(active)
        (own / "survey.toml").write_text(survey, encoding="utf-8")
        programs = {program.setup: program.data for program in nc_programs(sequence, "linuxcnc")}
        with daemon(own / "survey.toml") as log:
            for setup, program in programs.items():
                drive(control, stand, setup, program)
            left_um = driven_rms_um(control, machine)
            for attempt in range(ATTEMPTS):
                missing = still_missing(own / "control" / "0001", log, len(programs) + attempt)
                if not missing:
                    return own / "control" / "0001", left_um
                drive(control, stand, missing, programs[missing])
            raise AssertionError(log.read_text(errors="replace")[-3000:])


def drive(control: Control, stand: Stand, setup: str, program: bytes) -> None:
    """Put the laser up for a setup and run its program."""
    stand.readout.align(setup, TILT)
    time.sleep(0.4)
    control.run(program)


def still_missing(folder: Path, log: Path, driven: int) -> str:
    """Return the setup to drive again, because a busy computer lost samples of it; nothing once the result is there.

    ``driven``: how many programs were run so far. What the daemon waits for counts once the last of them has ended.
    """

    def wanted() -> str:
        said = [json.loads(line) for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if line.endswith("}")]
        ended = [event for event in said if event.get("event") == "pass-ended"]
        begun = max((place for place, event in enumerate(said) if event.get("event") == "stop" and event["stop"] == 0), default=0)
        waits = [event["what"] for event in said[begun:] if event.get("event") == "waiting"] if len(ended) >= driven else []
        found = re.search(r"the program of ([a-z-]+)", waits[-1]) if waits else None
        return found[1] if found else ""

    until(lambda: bool(wanted()) or (folder / "result.json").exists(), log, 300.0)
    return "" if (folder / "result.json").exists() else wanted()


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


def until(done: Callable[[], bool], log: Path, timeout_s: float = 60.0) -> None:
    ends_s = time.monotonic() + timeout_s
    while not done():
        assert time.monotonic() < ends_s, log.read_text(errors="replace")[-4000:]
        time.sleep(0.1)
