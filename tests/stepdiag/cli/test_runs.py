"""Linear runs and straight diagonals of other programs at the command line, against the exact
virtual machine."""

import json

import numpy as np
import pytest

from stepdiag.base.readings.readings import parse_readings, render_readings
from stepdiag.base.volume import Volume, diagonal_direction
from testkit.cli import stepdiag
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench

BENCH = Bench(increments=4, diagonal_noise_um=0.05, linear_noise_um=0.05)
TIMES = np.linspace(0.0, 1.0, 5)


def written(path, readings):
    path.write_text(render_readings(readings))
    return path


@pytest.fixture
def files(tmp_path):
    """The diagonals as CSV, and the linear runs of the same survey as .rtl, as `stepdiag rtl`
    writes them."""
    survey = BENCH.survey((*DIAGONALS, *LINEAR), passes=(1, 2))
    whole = written(tmp_path / "whole.csv", survey)
    of = [row for row, setup in enumerate(survey.setup) if setup in DIAGONALS]
    diagonals = written(tmp_path / "diagonals.csv", survey.select(of))
    told = stepdiag("rtl", whole, "--out", tmp_path / "rtl", "--machine", "mill 7")
    assert told.code == 0, told.refusal
    return whole, diagonals, [tmp_path / "rtl" / f"{setup}.rtl" for setup in LINEAR]


def test_linear_runs_of_another_program_join_a_survey(files, tmp_path):
    """The scales, which four diagonals do not tell apart, come from the runs, as if they had been
    recorded here."""
    whole, diagonals, runs = files
    options = [option for path in runs for option in ("--run", path)]
    results = {}
    for name, arguments in (
        ("whole", (whole,)),
        ("joined", (diagonals, *options)),
        ("alone", (diagonals,)),
    ):
        told = stepdiag("solve", *arguments, "--json")
        assert told.code == 0, told.refusal
        results[name] = json.loads(told.out)
    assert not results["alone"]["scale"]["X"]["identified"]
    for axis in "XYZ":
        scale = {name: result["scale"][axis]["value"] for name, result in results.items()}
        assert scale["joined"] == pytest.approx(scale["whole"], abs=0.5)
    for name in ("C0Y", "B0Z", "A0Z"):
        assert results["joined"]["squareness"][name]["value"] == pytest.approx(
            results["whole"]["squareness"][name]["value"], abs=0.5
        )


def test_a_straight_diagonal_that_was_not_used_is_held_against_the_result(files, tmp_path):
    whole, _, _ = files
    result = tmp_path / "result.json"
    assert stepdiag("solve", whole, "--out", result).code == 0
    volume = Volume(
        origin_mm=BENCH.origin_mm, size_mm=BENCH.size_mm, increments=BENCH.increments
    )
    target = TIMES * float(np.linalg.norm(BENCH.size_mm))
    points = np.asarray(BENCH.origin_mm) + TIMES[:, None] * np.asarray(BENCH.size_mm)
    along = diagonal_direction(volume, "ppp")
    error_um = BENCH.machine.error_at(points) @ along
    lines = [
        f"1 {number} {value - error_um[0]:.4f}" for number, value in enumerate(error_um, 1)
    ]
    rtl = tmp_path / "d1.rtl"
    rtl.write_text(
        "TARGET DATA::\nTarget-count : 5\nTargets :\n"
        + "\n".join(map(str, target))
        + "\nRUNS::\nRun-count : 1\nDEVIATIONS::\n"
        + "\n".join(lines)
        + "\nEOF::\n"
    )
    told = stepdiag("verify", result, "--diagonal", f"ppp={rtl}", "--json")
    assert told.code == 0, told.refusal
    found = json.loads(told.out)["diagonals"][0]
    span = max(found["measured_um"]) - min(found["measured_um"])
    assert span > 2.0
    assert found["largest_um"] < 0.35 * span
    assert "predicted_um" in stepdiag("verify", result, "--diagonal", f"ppp={rtl}").out


def test_what_is_asked_wrongly_is_refused(files, tmp_path):
    whole, diagonals, runs = files
    assert "the setup linear-x once" in stepdiag("solve", whole, "--run", runs[0]).refusal
    assert (
        "before the =" in stepdiag("solve", diagonals, "--run", f"linear-q={runs[0]}").refusal
    )
    assert (
        "three coordinates" in stepdiag("solve", diagonals, "--run", f"{runs[0]}@1,2").refusal
    )
    assert (
        "give a point of the measured line"
        in stepdiag("solve", diagonals, "--run", f"{runs[0]}@,9999,0").refusal
    )
    assert (
        "or --diagonal" in stepdiag("verify", tmp_path / "result.json").refusal
        or stepdiag("verify", tmp_path / "no.json").code
    )
    assert stepdiag("rtl", diagonals, "--out", tmp_path).code == 3
    moved = stepdiag("solve", diagonals, "--run", f"linear-x={runs[0]}@,0,0")
    assert moved.code == 0, moved.refusal
    assert len(parse_readings(whole.read_text(), "w")) > 0
