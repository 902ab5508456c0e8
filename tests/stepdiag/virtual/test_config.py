"""The bench's configuration: what a file may say, and what the machine built from it is."""

from pathlib import Path

import numpy as np
import pytest

from stepdiag.virtual.bench.building import (
    alignment_of,
    build_drive,
    build_errors,
    build_machine,
    build_plan,
    setup_builder,
)
from stepdiag.virtual.bench.config import load_config, read_config

FULL = """
seed = 4
time_scale = 10.0
[volume]
origin_mm = [-100.0, 0.0, 0.0]
size_mm = [400.0, 300.0, 200.0]
increments = 5
axis_order = "zxy"
[program]
setups = ["ppp", "linear-x"]
start = "command"
[[program.beam_offset]]
setup = "ppp"
offset_mm = [0.0, 50.0, 0.0]
[[program.beam_offset]]
setup = "ppp"
offset_mm = [0.0, 0.0, 50.0]
[machine]
chain = "XFYZ"
squareness = { C0Y = 12.0 }
tables = { EXX = { position_mm = [-100.0, 300.0], value = [0.0, 9.0] } }
backlash_um = [3.0, 0.0, 0.0]
[hall]
material_c = { start = 22.0, per_hour = 0.5 }
[alignment]
mirror_mrad = 0.5
[laser]
format = "line"
compensated = true
[[fault]]
kind = "beam-lost"
setup = "ppp"
stop = 3
"""


def built(text):
    config = load_config(text)
    return build_plan(config), build_machine(config)


def test_the_example_of_the_document_loads():
    page = (Path(__file__).parents[3] / "docs" / "virtual-machine.md").read_text(
        encoding="utf-8"
    )
    example = page.partition("```toml\n")[2].partition("```")[0]
    plan, machine = built(example)
    assert len(plan.setups) == 8
    assert machine.chain == "XFYZ"


def test_a_full_file_builds_its_machine():
    config = load_config(FULL)
    machine = build_machine(config)
    assert machine.chain == "XFYZ"
    assert machine.environment.material_c.at(np.array([7200.0])) == pytest.approx([23.0])
    errors = build_errors(config)
    assert errors.squareness_urad["C0Y"] == 12.0
    assert errors.functions["EXX"](np.array([100.0])) == pytest.approx([4.5])
    assert config.fault[0].placed


def test_backlash_is_lost_motion():
    """An axis with 3 µm of backlash lags: 1.5 µm short when it came in +, 1.5 µm too far when it
    came in -."""
    machine = build_machine(load_config(FULL))
    point = np.array([[-100.0, 0.0, 0.0]])
    forward, backward = (
        machine.error_at(point, direction=np.array([sign, 0.0, 0.0]))[0, 0]
        for sign in (1.0, -1.0)
    )
    assert forward - backward == pytest.approx(-3.0)


def test_shifted_beams_are_setups_of_their_own():
    config = load_config(FULL)
    plan = build_plan(config)
    assert plan.setups == ("ppp", "linear-x", "ppp+1", "ppp+2")
    assert plan.pause_s is None
    assert alignment_of(config, "ppp+2").beam_offset_mm == (0.0, 0.0, 50.0)
    setup_of = setup_builder(config, build_machine(config))
    shift = setup_of("ppp+1").beam.source_mm - setup_of("ppp").beam.source_mm
    assert shift == pytest.approx([0.0, 50.0, 0.0], abs=1e-6)


def test_every_setup_is_aligned_anew_to_the_same_quality():
    config = load_config(FULL)
    tilts = [alignment_of(config, name).mirror_mrad for name in ("ppp", "npp")]
    assert [np.hypot(*tilt) for tilt in tilts] == pytest.approx([0.5, 0.5])
    assert tilts[0] != tilts[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[laser]\nbord = 'umd1'\n", "bord"),
        ("[program]\npasses = 'two'\n", "passes"),
        ("[[fault]]\nkind = 'fire'\n", "fire"),
        ("[machine]\nsquareness = { C0X = 1.0 }\n", "C0X"),
        ("[program]\nsetups = ['ppq']\n", "ppq"),
        ("[machine]\nchain = 'XYZ'\n", "XYZ"),
    ],
)
def test_a_wrong_file_is_refused_by_name(text, message):
    with pytest.raises(ValueError, match=message):
        built(text)


def test_compensation_files_lie_beside_the_configuration(tmp_path):
    (tmp_path / "x.comp").write_text("0 0 0\n500 500.01 500.01\n", encoding="ascii")
    file = tmp_path / "bench.toml"
    file.write_text(
        '[[compensation]]\ncontrol = "linuxcnc"\nfiles = ["x.comp"]\n', encoding="utf-8"
    )
    machine = build_machine(read_config(file))
    assert machine.compensations[0].correction_mm(np.full((1, 3), 500.0), np.ones((1, 3)))[
        0, 0
    ] == pytest.approx(-0.01)


def test_an_ordinary_machine_is_built_from_its_fields():
    plan, machine = built(
        """
[program]
decimals = 2
incremental = true
first_overrun = false
[volume]
increments = 7
[machine]
screw_um = [2.0, 0.0, 0.0]
screw_pitch_mm = 5.0
growth_um_m = [20.0, 0.0, 0.0]
growth_bearing_mm = [-100.0, 0.0, 0.0]
growth_tau_s = 600.0
growth_begun_s = 600.0
"""
    )
    assert plan.box.incremental
    assert not plan.first_overrun
    at = np.linspace(100.0, 105.0, 51)
    plain = built("[volume]\nincrements = 7\n")[1].errors.functions
    waves = machine.errors.functions["EXX"](at) - plain["EXX"](at)
    assert np.ptp(waves) == pytest.approx(4.0, rel=0.01)
    assert waves[0] == pytest.approx(waves[-1], abs=1e-6)
    assert machine.errors.functions["EYY"](at).tolist() == plain["EYY"](at).tolist()
    assert machine.growth.share(np.array([0.0]))[0] == pytest.approx(1.0 - np.exp(-1.0))


def test_a_machine_without_growth_has_none():
    assert build_machine(load_config("")).growth is None


def test_the_drive_of_an_ordinary_machine_misses_its_targets():
    drive = build_drive(load_config("[machine]\nrepeatability_um = 0.5\nservo_um = 0.3\n"))
    assert (drive.repeatability_um, drive.servo_um) == (0.5, 0.3)
