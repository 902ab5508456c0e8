"""A whole survey with the 4-DOF head: diagonals, linear runs and head runs over real ptys and
Modbus, and its replay."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from stepdiag.cli.app import app, build
from stepdiag.fourdof.commissioning import parse_curves
from stepdiag.solver.model.angles import parse_angles
from stepdiag.virtual.bench.building import build_machine
from stepdiag.virtual.bench.config import read_config
from testkit.exact.heads import survey_section, write_head_file
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.system

SETUPS = (
    "ppp",
    "npp",
    "pnp",
    "ppn",
    "linear-x",
    "linear-y",
    "linear-z",
    "fourdof-x",
    "fourdof-y",
    "fourdof-z",
)
BENCH = """
[machine]
angle_urad = 20.0
[machine.tables.ECZ]
position_mm = [0.0, 100.0]
value = [0.0, 0.0]
[alignment]
mirror_mrad = 0.5
beam_mrad = 0.5
[head]
pointing_urad = 5.0
pointing_period_s = 120.0
"""
LEVEL = "axis,position_mm,EA_urad,EB_urad,EC_urad,u_urad\n"


def level_csv(truth):
    """What a level says: the roll of X and Y, half an arc-second uncertain; Z has none to be seen
    by it."""
    rows = [
        f"{axis.lower()},{at},{a},{b},,2.0"
        for axis, column in (("X", 0), ("Y", 1))
        for at, a, b in roll(truth, axis, column)
    ]
    return LEVEL + "\n".join(rows) + "\n"


def roll(truth, axis, column):
    name = f"E{'ABC'[column]}{axis}"
    for at, value in zip(truth.position_mm[axis], truth.errors[name], strict=True):
        yield at, (value if column == 0 else ""), (value if column == 1 else "")


@pytest.mark.impatient
def test_diagonals_lines_and_head_give_one_result_and_replay_to_the_same_bytes(tmp_path):
    """All of the 21 errors but the roll of Z, which neither head nor level sees; the head's
    pointing drifts by 5 urad meanwhile."""
    write_head_file(tmp_path / "head.toml")
    (tmp_path / "level.csv").write_text(LEVEL + "x,0,0,,,\nx,300,0,,,\n")
    more = survey_section(tmp_path / "devices" / "head") + '[solver]\nangles = "level.csv"\n'
    with hall(
        tmp_path,
        setups=SETUPS,
        n=2,
        handshake=True,
        dwell=0.5,
        laser_bench=BENCH,
        laser_survey=more,
    ) as place:
        truth = build_machine(read_config(tmp_path / "bench.toml")).truth(2)
        (tmp_path / "level.csv").write_text(level_csv(truth))
        with daemon(place.survey, wait_for=("laser", "machine", "head")) as process:
            place.start_setups()
            said = until(process, "survey-complete")
        assert said[-1]["exit_code"] == 0, said[-1]
        result = json.loads((place.round / "result.json").read_text())
        identified = [
            name
            for name, function in result["errors"].items()
            if function["value"] is not None
        ]
        assert set(identified) == {
            f"E{kind}{axis}" for axis in "XYZ" for kind in "XYZABC"
        } - {"ECZ"}
        assert all(
            entry["value"] is not None
            for entry in (*result["squareness"].values(), *result["scale"].values())
        )
        for name in ("EBX", "ECX", "EAY", "ECY", "EAZ", "EBZ"):
            assert (
                np.abs(np.array(result["errors"][name]["value"]) - truth.errors[name]).max()
                < 2.5
            ), name
        for name in ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"):
            assert (
                np.abs(np.array(result["errors"][name]["value"]) - truth.errors[name]).max()
                < 1.0
            ), name
            assert result["head_straightness"][name]["passes"] == 1
        assert "straightness-misclosure" not in {
            finding["code"] for finding in result["findings"]
        }
        assert "Straightness by the 4-DOF head" in (place.round / "report.html").read_text()
        build()
        replayed = CliRunner().invoke(
            app, ["replay", str(place.round), "--out", str(tmp_path / "again"), "--json"]
        )
        assert replayed.exit_code == 0, replayed.output
        compared = json.loads(replayed.stdout)
        assert compared["different"] == compared["rounded"] == compared["missing"] == []
        assert_head_commands_read_the_logs(place.round, truth, tmp_path)


def assert_head_commands_read_the_logs(logs, truth, folder):
    """The head's passes against the truth as a reference instrument, and its stream in the log of
    one of them."""
    names = ("EYX", "EZX")
    columns = [f"{name}_um" for name in names]
    rows = zip(truth.position_mm["X"], *(truth.errors[name] for name in names), strict=True)
    lines = [
        ",".join(["position_mm", *columns]),
        *(",".join(f"{value:.6f}" for value in row) for row in rows),
    ]
    (folder / "reference.csv").write_text("\n".join(lines) + "\n")
    compared = CliRunner().invoke(
        app,
        [
            "fourdof",
            "compare",
            str(logs),
            "--reference",
            str(folder / "reference.csv"),
            "--json",
        ],
    )
    assert compared.exit_code == 0, compared.output
    figures = json.loads(compared.stdout)
    figures.pop("arms")
    assert set(figures) >= set(names)
    assert all(each["rms"] < 0.3 for each in figures.values())
    said = CliRunner().invoke(
        app, ["fourdof", "show", str(logs), "--out", str(folder / "head")]
    )
    assert said.exit_code == 0, said.output
    assert "minimum-zone" in said.stdout
    assert set(parse_angles((folder / "head" / "angles.csv").read_text())) == {
        "EBX",
        "ECX",
        "EAY",
        "ECY",
        "EAZ",
        "EBZ",
    }
    assert set(parse_curves((folder / "head" / "straightness.csv").read_text(), "s")) == {
        "EYX",
        "EZX",
        "EXY",
        "EZY",
        "EXZ",
        "EYZ",
    }
    beside = (
        "--angles",
        folder / "head" / "angles.csv",
        "--straightness",
        folder / "head" / "straightness.csv",
    )
    solved = CliRunner().invoke(
        app, ["solve", str(logs / "readings.csv"), *map(str, beside), "--json"]
    )
    assert solved.exit_code == 0, solved.output
    assert set(json.loads(solved.stdout)["head_straightness"]) == {
        "EYX",
        "EZX",
        "EXY",
        "EZY",
        "EXZ",
        "EYZ",
    }
    shown = CliRunner().invoke(app, ["fourdof", "align", str(logs / "0008.mcap")])
    assert shown.exit_code == 0, shown.output
    assert "PSD2" in shown.stdout
