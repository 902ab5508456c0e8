"""One axis alone, an ISO 230-2 run: solved, reported, exported and compared without a diagonal, and
nothing stated about a volume."""

import csv
import json
import warnings
from pathlib import Path

import numpy as np
import pytest

from stepdiag.base.readings.readings import Readings, make_readings, render_readings
from stepdiag.base.result.result import DISPLACEMENTS, parse_result
from stepdiag.solver.methods.solve import solve
from testkit.cli import stepdiag
from testkit.exact.beside import Beside, scattered
from testkit.exact.surveys import Bench

DATA = Path(__file__).parents[2] / "data"
OWN = (
    0.0,
    17.31,
    33.333,
    51.2,
    77.0,
    98.765,
    130.1,
    165.5,
    201.25,
    250.0,
    300.4,
    344.4,
    390.0,
    444.4,
    480.8,
    500.0,
)
BENCH = Bench(seed=3, increments=8)
ALONE = Beside(
    bench=BENCH,
    setups=("linear-x",),
    passes=(1, 2, 3, 4),
    targets_mm={"linear-x": OWN},
    stands=scattered(2.0, 1),
    u_um=0.1,
)


def published(name: str) -> Readings:
    """Return a published run in both directions as readings of X: its passes share the zero of the
    count."""
    lines = (DATA / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(lines[1:]))
    targets = sorted({float(row["target_mm"]) for row in rows})
    at = {
        (row["direction"], int(row["cycle"]), float(row["target_mm"])): float(
            row["reference_mm"]
        )
        for row in rows
    }
    columns: dict[str, list] = {
        "pass_number": [],
        "stop": [],
        "position_mm": [],
        "reading_mm": [],
    }
    start_mm = at["forward", 1, targets[0]]
    for cycle in range(1, 1 + max(number for _, number, _ in at)):
        for number, direction, order in (
            (2 * cycle - 1, "forward", targets),
            (2 * cycle, "reverse", targets[::-1]),
        ):
            columns["pass_number"] += [number] * len(order)
            columns["stop"] += range(len(order))
            columns["position_mm"] += [[target, 0.0, 0.0] for target in order]
            columns["reading_mm"] += [
                at[direction, cycle, target] - start_mm for target in order
            ]
    count = len(columns["stop"])
    return make_readings(setup=["linear-x"] * count, zero=[1] * count, **columns)


def test_figures_of_a_published_run_are_those_of_the_standard():
    result = solve(published("iso230_2_ecmc_11358_axis1"))
    figures = next(
        one for one in result.standards["linear-x"] if one.standard.startswith("ISO 230-2")
    )
    with (DATA / "iso230_2_expected.csv").open(encoding="utf-8") as file:
        rows = [
            row
            for row in csv.DictReader(file)
            if row["dataset"] == "ecmc_11358_axis1"
            and row["standard"].startswith("ISO 230-2")
        ]
    expected = {row["quantity"]: 1e3 * float(row["value_mm"]) for row in rows}
    for name in ("E", "B", "R", "M", "A"):
        assert getattr(figures, name) == pytest.approx(expected[name], abs=1e-3), name


def test_the_axis_is_measured_and_everything_else_is_null_and_named():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = solve(ALONE.readings())
    assert result.volume.size_mm == (500.0, 0.0, 0.0)
    true, function = BENCH.machine.errors.functions["EXX"], result.errors["EXX"]
    off_um = function.value - (true(function.position_mm) - true(function.position_mm[:1]))
    # the machine's scales are part of the function: slope and all
    assert np.all(np.abs(off_um) <= np.maximum(2.5 * function.u, 0.05))
    # at the nodes and at the run's own targets, each of which the stops lie beside by up to 2 µm
    assert all(np.min(np.abs(function.position_mm - target)) < 0.003 for target in OWN)
    assert result.scale["X"].identified
    for name in set(DISPLACEMENTS) - {"EXX"}:
        assert result.errors[name].value is None
    assert all(quantity.value is None for quantity in result.squareness.values())
    (finding,) = (each for each in result.findings if each.key == "unidentified.standing")
    assert finding.severity == "info"
    assert "Y and Z did not travel" in finding.text
    assert all(name in finding.text for name in ("EYX", "EZZ", "C0Y", "the scale of Z"))
    assert {each.key for each in result.findings if each.severity != "info"} == set()


def test_nothing_is_stated_about_a_volume():
    result = solve(ALONE.readings())
    assert result.posterior is None
    assert (
        not {"predicted", "volumetric_u_um", "tool", "unseen_slip", "scale_sum_um"}
        & json.loads(result.to_json()).keys()
    )
    assert not result.expected
    assert parse_result(result.to_json()).to_json() == result.to_json()


@pytest.mark.parametrize(
    ("setups", "size_mm", "known"),
    [
        (("linear-x",), (500.0, 0.0, 0.0), {"EXX"}),
        (("linear-z",), (0.0, 0.0, 300.0), {"EZZ"}),
        (("linear-x", "linear-y"), (500.0, 400.0, 0.0), {"EXX", "EYY"}),
        (("linear-x", "linear-y", "linear-z"), (500.0, 400.0, 300.0), {"EXX", "EYY", "EZZ"}),
    ],
)
def test_runs_without_diagonals(setups, size_mm, known):
    result = solve(Beside(bench=BENCH, setups=setups, u_um=0.1).readings())
    assert result.volume.size_mm == size_mm
    assert {name for name in DISPLACEMENTS if result.errors[name].value is not None} == known


@pytest.mark.parametrize(
    ("setups", "tables"), [(("linear-x",), 1), (("linear-x", "linear-y"), 2)]
)
def test_from_readings_to_a_table_on_the_command_line(setups, tables, tmp_path):
    survey = Beside(bench=BENCH, setups=setups, u_um=0.1)
    (tmp_path / "readings.csv").write_text(
        render_readings(survey.readings()), encoding="utf-8"
    )
    result, out = tmp_path / "result.json", tmp_path / "files"
    solved = stepdiag("solve", tmp_path / "readings.csv", "--out", result)
    assert solved.code == 0, solved.refusal
    assert "The errors in the volume are unknown" in solved.out
    done = stepdiag(
        "export", result, "--controller", "siemens", "--step-mm", "50", "--out", out
    )
    assert done.code == 0, done.refusal
    files = [path for path in sorted(out.glob("*.INI")) if "RESTORE" not in path.name]
    assert (
        "".join(path.read_text(encoding="ascii") for path in files).count("$AA_ENC_COMP_MIN")
        == tables
    )
    for arguments in (
        ("verify", result, *files),
        ("compare", result, result),
        ("report", result, "--out", tmp_path / "report.html"),
    ):
        done = stepdiag(*arguments)
        assert done.code == 0, done.refusal
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "The errors in the volume are unknown" in page
    assert 'id="field-before"' not in page
    assert json.loads(result.read_text(encoding="utf-8"))["volume"]["size_mm"].count(
        0.0
    ) == 3 - len(setups)


def test_a_machine_that_was_measured_whole_is_compared_with_one_axis_of_it(tmp_path):
    whole, axis = tmp_path / "whole.json", tmp_path / "axis.json"
    whole.write_text(solve(BENCH.survey()).to_json(), encoding="utf-8")
    axis.write_text(solve(ALONE.readings()).to_json(), encoding="utf-8")
    done = stepdiag("compare", whole, axis)
    assert done.code == 0, done.refusal
    assert "error along the travelled axes" in done.out
