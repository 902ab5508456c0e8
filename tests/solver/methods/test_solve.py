"""The one door: methods by name, chains, determinism, refusals."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.readings.readings import parse_readings, render_readings
from stepdiag.base.result.result import same_result
from stepdiag.solver.methods.registry import METHODS
from stepdiag.solver.methods.solve import solve
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench
from testkit.examples import few

DATA = Path(__file__).parents[2] / "data"
SURVEY = Bench(increments=4).survey()


@pytest.mark.parametrize("method", METHODS)
def test_every_method_gives_a_complete_result(method):
    result = solve(SURVEY, method=method)
    assert result.method == method
    assert len([name for name in result.errors if name[1] in "XYZ"]) == 9
    assert set(result.squareness) == {"C0Y", "B0Z", "A0Z"}
    assert set(result.scale) == {"X", "Y", "Z"}


@pytest.mark.parametrize("method", METHODS)
@given(st.randoms())
@few(3)
def test_the_order_of_rows_does_not_change_a_byte(method, random):
    rows = list(range(len(SURVEY)))
    random.shuffle(rows)
    assert (
        solve(SURVEY.select(rows), method=method).to_json()
        == solve(SURVEY, method=method).to_json()
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_survey_from_a_file_gives_the_same_bytes_each_time(method):
    text = render_readings(SURVEY)
    assert (
        solve(parse_readings(text), method=method).to_json()
        == solve(parse_readings(text), method=method).to_json()
    )


def test_many_stops_along_the_axes_alone_give_the_positioning_of_each():
    """Unknowns of 15 increments are eliminated block by block; here no reading touches more than
    one block."""
    bench = Bench(seed=1, increments=15)
    result = solve(bench.survey(LINEAR))
    for name in ("EXX", "EYY", "EZZ"):
        true = bench.machine.errors.functions[name]
        function = result.errors[name]
        off = function.value - (true(function.position_mm) - true(function.position_mm[:1]))
        assert np.all(np.abs(off) <= 4 * function.u + 1e-9)
        assert np.mean(np.abs(off) <= 2 * function.u + 1e-9) > 0.8


def test_a_machine_that_stands_elsewhere_has_the_same_errors():
    moved = Bench(increments=4, origin_mm=(-1200.0, 350.0, 80.0)).survey()
    here, there = solve(SURVEY), solve(moved)
    assert there.squareness["C0Y"].value == pytest.approx(
        here.squareness["C0Y"].value, abs=1e-3
    )
    assert there.errors["EZX"].position_mm[0] == -1200.0
    assert there.errors["EZX"].value == pytest.approx(here.errors["EZX"].value, abs=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "estimat"}, "did you mean 'estimate'?"),
        (
            {"method": "magic"},
            "method: expected one of estimate, least-squares, wang2000, found 'magic'",
        ),
        ({"chain": "XYZ"}, "chain: expected X, Y, Z and the bed once each"),
    ],
)
def test_wrong_use_is_refused(options, message):
    with pytest.raises(UsageError) as refusal:
        solve(SURVEY, **options)
    assert message in str(refusal.value)


@pytest.mark.parametrize("missing", DIAGONALS)
def test_a_survey_without_one_diagonal_says_what_it_lacks(missing):
    """Three diagonals and three linear runs: rank 9n+3 of the theory's table, one squareness or
    more is unknown or all is told."""
    result = solve(
        Bench(increments=4).survey([name for name in DIAGONALS if name != missing])
    )
    codes = {finding.key for finding in result.findings}
    assert "unidentified.squareness" in codes
    for name, quantity in result.squareness.items():
        assert quantity.value is None or name not in next(
            f.text for f in result.findings if f.key == "unidentified.squareness"
        )


def test_a_survey_with_gaps_is_solved_within_u_and_repeats_are_compared_stop_by_stop():
    bench = Bench(seed=2, increments=4)
    whole = bench.survey(passes=(1, 3))
    gaps = {("ppp", 1, 4), ("ppp", 3, 8), ("linear-y", 1, 2)}
    at = zip(whole.setup, whole.pass_number.tolist(), whole.stop.tolist(), strict=True)
    result, full = (
        solve(whole.select([row for row, key in enumerate(at) if key not in gaps])),
        solve(whole),
    )
    assert "stop-missing" in {finding.key for finding in result.findings}
    assert result.setups["ppp"].repeatability_um == pytest.approx(
        full.setups["ppp"].repeatability_um, rel=0.5
    )
    for name, quantity in full.squareness.items():
        assert abs(quantity.value - result.squareness[name].value) < quantity.u


def test_a_pass_of_one_stop_is_refused():
    rows = [
        row
        for row in range(len(SURVEY))
        if SURVEY.setup[row] != "linear-x" or SURVEY.stop[row] == 0
    ]
    with pytest.raises(
        DataError, match=r"\(linear-x\), pass 1 out: expected at least 2 stops, found 1"
    ):
        solve(SURVEY.select(rows))


ELSEWHERE = """
from testkit.exact.surveys import Bench
from pathlib import Path
from stepdiag.solver.methods.solve import solve
from stepdiag.base.readings.readings import parse_readings
print(solve(parse_readings(Path({steady!r}).read_text(), "steady")).to_json())
print("---")
print(solve(Bench(seed=4, increments=3).survey(("ppp",), passes=(1, 2), joined=True)).to_json())
print("---")
print(solve(Bench(seed=3, increments=2, angle_urad=2.0, size_mm=(300.0, 200.0, 100.0)).survey()).to_json())
for seed in (0, 1, 2):
    quiet = Bench(seed=seed, increments=1, diagonal_noise_um=0.002, linear_noise_um=0.002, size_mm=(300.0, 200.0, 100.0))
    print("---")
    print(solve(quiet.survey(passes=(1, 2), joined=True)).to_json())
"""  # noqa: E501


def test_what_is_not_identified_leaves_no_trace_of_the_processor():
    """A survey of one diagonal identifies little; the arbitrary rest of a solution is another one
    on another kernel of the products.

    And diagonals see alike: which of them sees a slip of the count least is no matter of rounding.
    What the readings know to 0.01 µm stood beside what is usual within 50: as a difference of such
    numbers it was another one on each processor. And a fine laser sees few targets: what the
    unknowns take over of a cause is left out of it before anything is multiplied.
    """
    script = ELSEWHERE.format(steady=str(DATA / "small_steady_readings.csv"))
    lib = str(Path(__file__).parents[2] / "lib")
    told = []
    for kernel in ({}, {"OPENBLAS_CORETYPE": "Prescott"}):
        environment = os.environ | kernel | {"PYTHONPATH": lib}
        done = subprocess.run(
            [sys.executable, "-c", script],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
            timeout=120,
        )
        told.append(done.stdout)
    here, there = (each.split("---") for each in told)
    assert all(
        same_result(one.encode(), other.encode())
        for one, other in zip(here, there, strict=True)
    )
    result = json.loads(here[1])
    unidentified = {
        name for name, function in result["errors"].items() if function["value"] is None
    }
    assert unidentified
    assert not unidentified & set(result["budget"]["shares"])
