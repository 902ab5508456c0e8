"""A machine that is compensated already is measured again by the daemon: whatever is said of it, no
export makes it worse unseen."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from stepdiag.base.result.field import without_rigid_motion
from stepdiag.base.volume import Volume
from stepdiag.exporters.export.export import export
from stepdiag.exporters.profiles.file import load_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.virtual.bench.building import build_errors, build_machine
from stepdiag.virtual.bench.config import load_config
from stepdiag.virtual.control.siemens import SiemensControl
from stepdiag.virtual.physics.machine import Machine
from testkit.cli import stepdiag
from testkit.exact.results import made_result
from testkit.exact.siemens_files import HALL_AXES
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.system

VOLUME = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(300.0, 200.0, 100.0), increments=2)
SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y")
MACHINE = """
[machine]
positioning_um = 0.0
straightness_um = 0.0
scale_um_m = 40.0
squareness_urad = 60.0
tables.EXX = { position_mm = [0.0, 150.0, 300.0], value = [0.0, 9.0, 12.0] }
tables.EYX = { position_mm = [0.0, 150.0, 300.0], value = [0.0, 7.0, 0.0] }
tables.EZY = { position_mm = [0.0, 100.0, 200.0], value = [0.0, -8.0, 0.0] }
tables.EZZ = { position_mm = [0.0, 50.0, 100.0], value = [0.0, -3.0, -8.0] }
"""
"""Straight lines between the stops: what tables can hold."""
SHARE = 0.7
"""The tables in the control were made before wear: they hold this share of what the machine
errs."""
PROFILE = """
[machine]
name = "virtual"
controller = "siemens"
measured_with = "{state}"
existing = {existing}
[limits]
slope_um_mm = 2.0
"""
ACCEPT = ("compensation-contradicted", "change-large", "correction-small", "value-large")
ON = (
    'compensation = "on"\nactive = ["AX_EEC.INI", "NC_CEC.INI"]\nactive_date = '
    '2026-01-31\nactive_source = "archive"'
)
GIVEN = {
    "none": [],
    "right": ["AX_EEC.INI", "NC_CEC.INI"],
    "one of two": ["NC_CEC.INI"],
    "others": ["other/AX_EEC.INI", "other/NC_CEC.INI"],
}


def machine_with(bench: str, share: float) -> Machine:
    """The machine of a bench, or one whose errors are only a share of its errors."""
    config = load_config(bench)
    built = build_machine(config)
    if share == 1.0:
        return built
    errors = build_errors(config)
    functions = {
        name: (lambda at, of=function: share * of(at))
        for name, function in errors.functions.items()
    }
    smaller = {name: share * value for name, value in errors.squareness_urad.items()}
    return Machine(
        errors=type(errors)(
            low_mm=errors.low_mm,
            size_mm=errors.size_mm,
            functions=functions,
            squareness_urad=smaller,
        )
    )


def tables_for(bench: str, share: float, folder: Path, here: Path) -> None:
    """Write the tables that hold a share of the errors, as an earlier calibration left them in the
    control."""
    truth = machine_with(bench, share).truth(VOLUME.increments)
    known = {name: value for name, value in truth.errors.items() if name[1] in "XYZ"}
    result = made_result(known, squareness=truth.squareness_urad, volume=VOLUME)
    profile = load_profile(here / "off-none.toml", controller_named("siemens"), VOLUME)
    export(result, "siemens", profile, accept=ACCEPT, out_dir=folder / "made")
    for name in ("AX_EEC", "NC_CEC"):
        (folder / f"{name}.INI").write_bytes(
            (folder / "made" / f"{name}_UNTESTED_SIGN.INI").read_bytes()
        )


def errs_um(machine: Machine, files: list[Path]) -> float:
    """The largest error of the tool with files loaded, without the shift and turn of the
    workpiece."""
    control = SiemensControl()
    for file in files:
        control.load(file.read_text(encoding="ascii"))
    machine.compensations = control.tables()
    axes = [np.linspace(0.0, size, 7) for size in VOLUME.size_mm]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return float(
        np.max(
            np.linalg.norm(
                without_rigid_motion(VOLUME, points, machine.error_at(points)), axis=1
            )
        )
    )


def survey_of_a_compensated_machine(folder: Path) -> tuple[str, Path]:
    """Let the daemon measure the machine with the tables active; return its bench without them, and
    the folder of the result."""
    for state, given in product(["off", "on"], GIVEN):
        (folder / f"{state}-{given}.toml").write_text(
            PROFILE.format(state=state, existing=GIVEN[given]) + HALL_AXES, encoding="utf-8"
        )
    (folder / "other").mkdir()
    bench = f"seed = 5\n[volume]\nsize_mm = [300.0, 200.0, 100.0]\nincrements = 2\n{MACHINE}"
    tables_for(bench, SHARE, folder, folder)
    tables_for(bench, 0.2, folder / "other", folder)
    active = (
        f'[[compensation]]\ncontrol = "siemens"\nfiles = ["{folder}/AX_EEC.INI", '
        f'"{folder}/NC_CEC.INI"]\n'
    )
    machine, files = machine_with(bench, 1.0), [folder / name for name in GIVEN["right"]]
    assert 0.25 * errs_um(machine, []) < errs_um(machine, files) < 0.6 * errs_um(machine, [])
    with (
        hall(folder, setups=SETUPS, machine=ON, bench=MACHINE + active) as place,
        daemon(place.survey) as process,
    ):
        place.start_setups()
        assert until(process, "survey-complete")[-1]["exit_code"] == 0
    return bench, place.round


@pytest.mark.impatient
def test_no_combination_makes_the_machine_worse_unseen(tmp_path):
    """Profile on or off, four sets of files, a quick look, said in the survey or afterwards:
    refused (5), or never worse than before."""
    bench, measured = survey_of_a_compensated_machine(tmp_path)
    machine, before_files = (
        machine_with(bench, 1.0),
        [tmp_path / name for name in GIVEN["right"]],
    )
    before = errs_um(machine, before_files)
    silent = tmp_path / "silent.toml"
    silent.write_text(
        (tmp_path / "survey.toml").read_text().replace(ON, ""), encoding="utf-8"
    )
    told = stepdiag("solve", measured, "--out", tmp_path / "said.json")
    assert told.code == 0, told.refusal
    again = stepdiag("replay", measured, "--survey", silent, "--out", tmp_path / "silent")
    assert (tmp_path / "silent" / "result.json").exists(), again
    files = [word for name in GIVEN["right"] for word in ("--active", tmp_path / name)]
    afterwards = (
        "--compensation",
        "on",
        *files,
        "--active-date",
        "2026-01-31",
        "--active-source",
        "archive",
    )
    open_one = tmp_path / "silent" / "result.json"
    surveys = {
        "said": (tmp_path / "said.json", ()),
        "silent": (open_one, ()),
        "afterwards": (open_one, afterwards),
    }
    written = []
    for (survey, (result, words)), (state, given) in product(
        surveys.items(), [*product(["off", "on"], GIVEN), ("quick", "none")]
    ):
        out = tmp_path / "out" / f"{survey}-{state}-{given}"
        how = (
            ("--step-mm", "50")
            if state == "quick"
            else ("--profile", tmp_path / f"{state}-{given}.toml")
        )
        accept = [word for code in ACCEPT for word in ("--accept", code)]
        told = stepdiag(
            "export", result, "--controller", "siemens", *how, *accept, *words, "--out", out
        )
        if told.code == 5:
            assert not out.exists()
            continue
        assert told.code == 0, told.refusal
        written.append((survey, state, given))
        after = errs_um(
            machine,
            [
                *before_files,
                *(path for path in sorted(out.glob("*.INI")) if "_RESTORE" not in path.name),
            ],
        )
        assert after < before, (survey, state, given)
        assert after < 0.5 * before
    assert written == [("said", "on", "right"), ("afterwards", "on", "right")]
