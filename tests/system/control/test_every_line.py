"""A survey with every kind of line on a real control: LinuxCNC drives it, the daemon records and
solves it and writes files."""

import csv
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from stepdiag.base.result.result import parse_result
from stepdiag.daemon.driving import sequence_of
from stepdiag.daq.survey.file import parse_survey
from stepdiag.exporters.programs import nc_programs
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.physics.error_functions import Amplitudes, random_errors
from stepdiag.virtual.physics.machine import Machine, Setup
from testkit.exact.placed import placed
from testkit.linuxcnc.comparison import ATTEMPTS
from testkit.linuxcnc.files import profile_text
from testkit.linuxcnc.job import (
    DWELL_S,
    EXPORT,
    FEED_MM_MIN,
    NOISE_UM,
    OFF,
    SURVEY,
    daemon,
    still_missing,
)
from testkit.linuxcnc.rig import Control, linuxcnc
from testkit.linuxcnc.stand import LATENCY_S, Stand

pytestmark = [pytest.mark.system, pytest.mark.control]

ORIGIN_MM, SIZE_MM = (-200.0, -100.0, -160.0), (300.0, 180.0, 120.0)
ERRORS = Amplitudes(
    positioning_um=5.0,
    straightness_um=5.0,
    angle_urad=0.0,
    scale_um_m=40.0,
    squareness_urad=40.0,
)
LINES = """\
setups = ["ppp", "npp", "pnp", "ppn", "linear-x", "linear-z"]
repeats = 3
axis_orders = ["xyz", "yzx", "zxy"]
targets = 8
"""
ELSEWHERE = """\
[[plan.beam_offset]]
setup = "face-xy-np"
offset_mm = [0.0, 0.0, 60.0]
[[plan.beam_offset]]
setup = "linear-y"
offset_mm = [300.0, 0.0, 120.0]
[[plan.beam_offset]]
setup = "ppn"
offset_mm = [0.0, 35.0, 0.0]
[machine]
"""


SECOND_PASS = 10
"""The count of the machine at a stop in the second pass of the first program, whose three passes
have three orders of the axes: the program is driven anew, and begins with the first order."""


@contextmanager
def beam_cut(control: Control, stand: Stand, put_up: Setup, *, at: int) -> Iterator[None]:
    """Cut the beam at a count of the machine while the block runs; 0 cuts nothing."""

    def cut() -> None:
        control.wait_for(lambda state: state.running and state.count == at)
        stand.readout.put(put_up)

    thread = threading.Thread(target=cut)
    if at:
        thread.start()
    yield
    if at:
        thread.join()


@pytest.mark.timeout(1500)
def test_faces_other_edges_three_orders_and_irregular_runs_end_in_files(
    tmp_path: Path,
) -> None:
    """The number that the machine shows names the line, the daemon waits for the next one, and the
    result is right."""
    machine = Machine(errors=random_errors(5, ORIGIN_MM, SIZE_MM, ERRORS), chain="FXYZ")
    box = Box(origin_mm=ORIGIN_MM, size_mm=SIZE_MM, increments=2)
    ends = [
        (axis, low + share * size)
        for axis, low, size in zip("xyz", ORIGIN_MM, SIZE_MM, strict=True)
        for share in (0, 1)
    ]
    angles = "axis,position_mm,EA_urad,EB_urad,EC_urad,u_urad\n" + "".join(
        f"{axis},{at},0,0,0,0.1\n" for axis, at in ends
    )
    (tmp_path / "angles.csv").write_text(angles, encoding="utf-8")
    with (
        linuxcnc(swift=True) as control,
        Stand(control, machine, box, tmp_path, noise_um=NOISE_UM) as stand,
    ):
        text = (
            SURVEY.replace("setups = {setups}\n", LINES)
            .replace("[machine]\n", ELSEWHERE)
            .format(
                origin=list(ORIGIN_MM),
                size=list(SIZE_MM),
                increments=2,
                feed=FEED_MM_MIN,
                dwell=DWELL_S,
                port=stand.plc_port,
                laser=stand.laser_port,
                latency=LATENCY_S,
                state=OFF,
                export=EXPORT,
            )
        )
        survey = parse_survey(text, "survey.toml")
        (tmp_path / "linuxcnc.toml").write_text(
            profile_text("kinematics", survey.volume), encoding="utf-8"
        )
        (tmp_path / "survey.toml").write_text(text, encoding="utf-8")
        programs = {
            program.setup: program.data
            for program in nc_programs(sequence_of(survey), "linuxcnc")
        }
        folder = tmp_path / "control" / "0001"
        with daemon(tmp_path / "survey.toml") as log:
            missing, driven = list(programs), 0
            for _ in range(len(programs) + ATTEMPTS):
                for setup in missing:
                    run = survey.planned.run_of(setup)
                    put_up = placed(survey.planned, run, (0.4, -0.3), (0.1, 0.15))
                    stand.readout.put(put_up)
                    time.sleep(0.4)
                    with beam_cut(control, stand, put_up, at=0 if driven else SECOND_PASS):
                        control.run(programs[setup])
                    driven += 1
                again = still_missing(folder, log, driven)
                if not again:
                    break
                missing = [again]
    result = parse_result((folder / "result.json").read_text(encoding="utf-8"), "result.json")
    with (folder / "readings.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    stops = {setup: [row for row in rows if row["setup"] == setup] for setup in programs}
    wanted = {
        **dict.fromkeys(programs, 21),
        **dict.fromkeys(("linear-x", "linear-y+1", "linear-z"), 27),
        "face-xy-np+1": 15,
    }
    assert {setup: len(own) for setup, own in stops.items()} == wanted
    assert {(float(row["x_mm"]), float(row["z_mm"])) for row in stops["linear-y+1"]} == {
        (100.0, -40.0)
    }
    truth = machine.truth(2)
    for name, quantity in result.squareness.items():
        assert quantity.value == pytest.approx(truth.squareness_urad[name], abs=3.0)
    written = folder / "exports" / "linuxcnc"
    assert json.loads((folder / "result.json").read_text())["version"] >= 3
    assert (written / "lattice.csv").exists()
