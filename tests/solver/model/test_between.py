"""Readings off the nodes, against the exact machine: a finer run is used, not called vibration."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model import between
from stepdiag.solver.model.between import between_of
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.readings.readings import make_readings
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench

COLUMNS = ("pass_number", "stop", "position_mm", "reading_mm", "u_um", "beam_mm")


def joined(*parts):
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
    return make_readings(setup=[name for part in parts for name in part.setup], **columns)


def off_truth(bench, result, name):
    """Return value less truth and u of a function where it is told."""
    function, axis = result.errors[name], "XYZ".index(name[2])
    true = bench.machine.errors.functions[name]
    off = function.value - (true(function.position_mm) - true(function.position_mm[:1]))
    told = function.u > 1e-9
    assert np.all(np.diff(function.position_mm) > 0)
    assert function.position_mm[-1] == pytest.approx(bench.size_mm[axis])
    return off[told], function.u[told]


@pytest.fixture(scope="module")
def finer_runs():
    bench, fine = Bench(seed=2, increments=5), Bench(seed=2, increments=20)
    return bench, joined(bench.survey(DIAGONALS), fine.survey(LINEAR))


def test_a_finer_linear_run_is_known_at_all_its_positions(finer_runs):
    bench, readings = finer_runs
    result = solve(readings)
    assert not [finding.code for finding in result.findings if finding.code in ("pass-wanders", "noise-high", "chi-square-high")]
    for name in ("EXX", "EYY", "EZZ"):
        off, u = off_truth(bench, result, name)
        assert len(off) == 20
        assert np.mean(np.abs(off) <= 2 * u) >= 0.9
        assert np.sqrt(np.mean(off**2)) < 0.5, name
    assert all(report["noise_um"] < 0.5 for report in result.setups.values())
    assert len(result.errors["EYX"].position_mm) == 6


def test_a_fine_run_with_few_waves_a_cell_still_holds_the_truth(finer_runs, monkeypatch):
    bench, readings = finer_runs
    monkeypatch.setattr(between, "MOST_CAUSES", 15)
    assert between_of(lay_out(readings)).count == 15
    off, u = off_truth(bench, solve(readings), "EXX")
    assert np.mean(np.abs(off) <= 2 * u) >= 0.9


def test_diagonals_whose_stops_do_not_meet_are_taken_together():
    six, four = Bench(seed=3, increments=6), Bench(seed=3, increments=4)
    readings = joined(six.survey((*DIAGONALS[:2], *LINEAR)), four.survey(DIAGONALS[2:]))
    result = solve(readings)
    assert not [finding.code for finding in result.findings if finding.severity == "error"]
    for name in ("EXX", "EYY", "EZZ"):
        off, u = off_truth(six, result, name)
        assert len(off) == 6, "what a diagonal alone saw between the nodes is a sum, no value of one function"
        assert np.all(np.abs(off) <= 3 * u)


def test_on_the_nodes_there_is_nothing_between():
    assert between_of(lay_out(Bench(increments=3).survey())).count == 0


def test_a_program_with_one_decimal_knows_no_more_between_the_nodes_than_an_exact_one():
    """Stops 0.03 mm beside their nodes stood as values of their own, and what is between them counted as half known: 1.05 of 1.60 um."""
    survey = Bench(seed=3, increments=7).survey()
    exact = survey.select(np.concatenate(list(survey.passes().values())))
    layout, position_mm = lay_out(exact), np.round(exact.position_mm, 1)
    moved_mm = np.sum((position_mm - exact.position_mm) * layout.direction, axis=1)
    found, rounded = solve(exact), solve(replace(exact, position_mm=position_mm, reading_mm=exact.reading_mm + moved_mm))
    assert rounded.extra["volumetric_u_um"] == pytest.approx(found.extra["volumetric_u_um"], rel=0.02)
    for name in ("EXX", "EYY", "EZZ"):
        assert rounded.errors[name].position_mm == pytest.approx(found.errors[name].position_mm)
