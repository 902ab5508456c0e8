"""Readings off the nodes, against the exact machine: a finer run is used, not called vibration."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.readings.readings import make_readings
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model import between
from stepdiag.solver.model.between import USUAL_UM, between_beside_head, between_of
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench

COLUMNS = ("pass_number", "stop", "position_mm", "reading_mm", "u_um", "beam_mm")


def joined(*parts):
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS
    }
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
    assert not [
        finding.code
        for finding in result.findings
        if finding.code in ("pass-wanders", "noise-high", "stated-u-low")
    ]
    for name in ("EXX", "EYY", "EZZ"):
        off, u = off_truth(bench, result, name)
        assert len(off) == 20
        assert np.mean(np.abs(off) <= 2 * u) >= 0.9
        assert np.sqrt(np.mean(off**2)) < 0.5, name
    assert all(report.noise_um < 0.5 for report in result.setups.values())
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
        assert len(off) == 6, (
            "what a diagonal alone saw between the nodes is a sum, no value of one function"
        )
        assert np.all(np.abs(off) <= 3 * u)


def test_on_the_nodes_there_is_nothing_between():
    assert between_of(lay_out(Bench(increments=3).survey())).count == 0


def test_a_program_with_one_decimal_knows_no_more_between_the_nodes_than_an_exact_one():
    """Stops 0.03 mm beside their nodes stood as values of their own, and what is between them
    counted as half known: 1.05 of 1.60 um."""
    survey = Bench(seed=3, increments=7).survey()
    exact = survey.select(np.concatenate(list(survey.passes().values())))
    layout, position_mm = lay_out(exact), np.round(exact.position_mm, 1)
    moved_mm = np.sum((position_mm - exact.position_mm) * layout.direction, axis=1)
    found, rounded = (
        solve(exact),
        solve(
            replace(exact, position_mm=position_mm, reading_mm=exact.reading_mm + moved_mm)
        ),
    )
    assert rounded.volumetric_u_um == pytest.approx(found.volumetric_u_um, rel=0.02)
    for name in ("EXX", "EYY", "EZZ"):
        assert rounded.errors[name].position_mm == pytest.approx(
            found.errors[name].position_mm
        )


def passed(name, *position_mm):
    """A head's pass in a function, at positions in mm."""
    there = np.array(position_mm)
    return MeasuredStraightness(
        name=name, position_mm=there, value_um=0.0 * there, u_um=0.0 * there + 0.5
    )


def test_a_head_off_the_nodes_sees_a_bridge_in_every_cell():
    """Zero at both nodes, `USUAL_UM` in the middle, in no other cell and in no other function; two
    passes of a function see the same."""
    layout = lay_out(Bench(size_mm=(400.0, 300.0, 200.0), increments=2).survey())
    measured = (
        passed("EYX", 0.0, 50.0, 100.0, 200.0, 250.0, 400.0),
        passed("EZX", 100.0, 250.0),
        passed("EYX", 100.0),
        passed("EXY", 0.0, 150.0, 300.0),
    )
    between = between_of(layout, measured)
    assert between.names == ("EYX", "EZX")
    assert [axis.position_mm.tolist() for axis in between.axes] == [
        [50.0, 100.0, 250.0],
        [],
        [],
    ]
    effect = between_beside_head(layout, measured, between)
    share = np.array([0.25, 0.5])
    cell = 4 * (np.minimum(share[:, None], share) - share[:, None] * share) * USUAL_UM**2
    wanted = np.zeros((12, 12))
    wanted[np.ix_([1, 2], [1, 2])] = cell
    wanted[[2, 8], [8, 2]] = wanted[8, 8] = wanted[6, 6] = cell[1, 1]
    wanted[[1, 8], [8, 1]] = cell[0, 1]
    wanted[4, 4] = wanted[7, 7] = cell[0, 0]
    assert effect @ effect.T == pytest.approx(wanted, abs=1e-12)


def test_where_a_head_alone_passed_no_positioning_was_measured():
    layout = lay_out(
        joined(Bench(increments=2).survey(DIAGONALS), Bench(increments=4).survey(LINEAR))
    )
    step = layout.volume.size_mm[0] / 8
    between = between_of(layout, (passed("EYX", step, 2 * step + 0.004, 4 * step),))
    assert between.axes[0].position_mm == pytest.approx([step, 2 * step, 6 * step])
    assert between.axes[0].alone.tolist() == [False, True, True]
    assert between.names == ("EXX", "EYX", "EYY", "EZZ")


def test_a_head_on_the_nodes_leaves_nothing_between():
    layout = lay_out(Bench(increments=3).survey())
    assert between_of(layout, (passed("EYX", *layout.volume.nodes_mm(0)),)).count == 0
