"""A head that commissions itself: the machine jogs and stands, the daemon records, one command
makes the calibration file of it."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from stepdiag.cli.app import app, build
from stepdiag.daq.replay import find_logs, replay
from stepdiag.daq.survey.head_file import parse_head_file
from stepdiag.fourdof.runs import evaluate_head, over_passes
from stepdiag.virtual.bench.building import build_machine
from stepdiag.virtual.bench.config import read_config
from testkit.exact.heads import survey_section
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.system

HEAD = """
[machine]
angle_urad = 20.0
repeatability_um = 0.3
backlash_um = [5.0, 8.0, 6.0]
[head]
pointing_urad = 5.0
pointing_period_s = 600.0
[head.optics]
waist_mm = 1.9
spot_growth_per_m = 0.02
psd1_defocus_mm = 0.3
psd2_defocus_mm = -0.3
[head.optics.qd]
sign = [-1.0, 1.0]
rotation_mrad = 25.0
dark = [0.003, -0.002, 0.004]
[head.optics.psd1]
sign = [1.0, -1.0]
rotation_mrad = -20.0
gain = [1.02, 0.98]
[head.optics.psd2]
sign = [-1.0, -1.0]
rotation_mrad = 15.0
gain = [0.98, 1.03]
"""


def fourdof(*arguments):
    build()
    done = CliRunner().invoke(app, ["fourdof", *map(str, arguments)])
    assert done.exit_code == 0, (done.output, done.exception)
    return done.stdout


@pytest.mark.impatient
def test_a_head_out_of_the_box_measures_after_one_run(tmp_path):
    """No stage, no typed sign: the jogs and wobbles of its run make the calibration with which the
    same run is then evaluated."""
    fourdof(
        "new",
        "--id",
        "4D-001",
        "--psd1-focal-mm",
        150,
        "--psd2-focal-mm",
        150,
        "--out",
        tmp_path / "head.toml",
    )
    more = survey_section(tmp_path / "devices" / "head")
    program = "commission_s = [20.0, 120.0, 30.0]"
    with hall(
        tmp_path,
        setups=("fourdof-x",),
        n=4,
        back=True,
        handshake=True,
        dwell=5.0,
        laser_bench=HEAD,
        laser_survey=more,
        program=program,
    ) as place:
        with daemon(place.survey, wait_for=("laser", "machine", "head")) as process:
            place.start_setups()
            said = until(process, "survey-open")
        assert "next: `stepdiag fourdof commission`" in said[-1]["reason"]
        logs, truth = (
            place.round,
            build_machine(read_config(tmp_path / "bench.toml")).truth(4),
        )
    found = json.loads(
        fourdof(
            "commission",
            logs,
            "--calibration",
            tmp_path / "head.toml",
            "--out",
            tmp_path / "made.toml",
            "--json",
        )
    )
    for name, true in (
        ("qd.rotation_mrad", 25.0),
        ("psd1.rotation_mrad", -20.0),
        ("psd2.rotation_mrad", 15.0),
    ):
        assert abs(found["fields"][name]["value"] - true) < 3 * found["fields"][name]["u"], (
            name
        )
    file = parse_head_file((tmp_path / "made.toml").read_bytes(), "made.toml")
    assert (file.qd.x.sign, file.qd.y.sign, file.psd1.x.sign, file.psd1.y.sign) == (
        -1,
        1,
        1,
        -1,
    )
    assert (file.psd2.x.sign, file.psd2.y.sign) == (-1, -1)
    assert file.absent() == []
    assert {each.by for each in file.measured.values()} == {"fourdof commission"}
    replayed = replay(find_logs([logs]))
    measured = evaluate_head(
        replayed.survey,
        replayed.book.passes,
        {"head.toml": (tmp_path / "made.toml").read_bytes()},
        {},
    )
    for name, known in measured.angles.items():
        assert np.all(np.abs(known.value_urad - truth.errors[name]) <= 3 * known.u_urad), name
    for one in over_passes(measured):
        assert np.all(np.abs(one.value_um - truth.errors[one.name]) <= 3 * one.u_um), one.name
    assert max(float(np.max(one.u_um)) for one in over_passes(measured)) < 1.0
