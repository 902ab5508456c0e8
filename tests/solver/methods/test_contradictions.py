"""Ten times more contradiction than a machine makes is a mistake: named where it most probably
lies, and an error."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.conclusion.intervals import reach_in
from stepdiag.solver.methods.solve import solve
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench
from testkit.examples import spread


def errors_of(readings):
    """Return (code, setup, pass, stop) of the errors of a result."""
    findings = solve(readings, chain="FXYZ", method="estimate").findings
    return [
        (each.key, each.setup, each.pass_number, each.stop)
        for each in findings
        if each.severity == "error"
    ]


def survey(**options):
    return Bench(
        seed=3, increments=5, diagonal_noise_um=0.05, linear_noise_um=0.05, **options
    ).survey(DIAGONALS, passes=(1, 2))


def shifted(readings, rows, by_um):
    reading = np.array(readings.reading_mm)
    reading[rows] += by_um * 1e-3
    return replace(readings, reading_mm=reading)


@pytest.mark.parametrize("angle_urad", spread([0.0, 10.0, 40.0], 2))
def test_an_unmeasured_angle_is_no_mistake(angle_urad):
    assert errors_of(survey(angle_urad=angle_urad)) == []


@pytest.mark.parametrize(("setup", "number"), [("npp", 1), ("ppn", 2)])
def test_a_pass_that_is_wrong_everywhere_is_named(setup, number):
    """Nobody but the solver sees it: every stop of one pass of four diagonals out and back is off
    by some 20 µm, each by another amount."""
    clean = survey(angle_urad=10.0)
    rows = np.flatnonzero(
        (np.array(clean.setup) == setup) & (np.array(clean.pass_number) == number)
    )
    off = np.random.default_rng(1).normal(scale=20.0, size=len(rows))
    said = solve(shifted(clean, rows, off), chain="FXYZ", method="estimate").findings
    errors = [each for each in said if each.severity == "error"]
    assert errors
    assert any(
        f"({setup}), pass {number} " in each.text
        or (each.setup, each.pass_number) == (setup, number)
        for each in said
    )


def test_a_count_that_slipped_once_is_repaired_and_named():
    """200 µm in the middle of one pass: one more unknown explains it all, and nothing is
    refused."""
    clean = survey(angle_urad=10.0)
    rows = (
        (np.array(clean.setup) == "npp")
        & (np.array(clean.pass_number) == 1)
        & (np.array(clean.stop) >= 7)
    )
    findings = solve(shifted(clean, rows, 200.0), chain="FXYZ", method="estimate").findings
    assert [
        (each.key, each.setup, each.pass_number, each.stop)
        for each in findings
        if each.key == "count-step"
    ] == [("count-step", "npp", 1, 7)]
    assert not [each for each in findings if each.severity == "error"]
    # the null space keeps its precision while all scatter is first found a thousand times larger,
    # then as it is
    assert not {"unidentified.squareness", "unidentified.function"} & {
        each.key for each in findings
    }


@pytest.mark.parametrize(("u_um", "codes"), [(9.0, set()), (12.0, {"noise-high.reading"})])
def test_readings_ten_times_as_uncertain_as_usual_stop_the_export_with_their_setup(
    u_um, codes
):
    """They contradict nothing: their scatter is as they say themselves, and nothing can be
    concluded from them."""
    clean = survey()
    reading = np.array(clean.reading_mm) + np.random.default_rng(1).normal(
        scale=u_um * 1e-3, size=len(clean.reading_mm)
    )
    errors = errors_of(replace(clean, reading_mm=reading, u_um=np.full(len(reading), u_um)))
    assert {code for code, *_ in errors} == codes
    assert [setup for _, setup, *_ in errors] == list(DIAGONALS) * bool(codes)


@pytest.mark.parametrize("um", spread([25.0, 60.0], 2))
def test_a_setup_that_drifts_far_more_than_usual_is_named_and_harms_nothing(um):
    """Evenly in time, out and back: the drift is found at its size and taken off, and the result is
    that of the survey without it."""
    clean = Bench(
        seed=3, increments=5, diagonal_noise_um=0.05, linear_noise_um=0.05, angle_urad=2.0
    ).survey(DIAGONALS, passes=(1, 2))
    mine = np.array(clean.setup) == "npp"
    since = np.array(clean.time_s) - np.min(np.array(clean.time_s)[mine])
    result, without = (
        solve(shifted(clean, mine, um * since[mine] / np.ptp(since[mine]))),
        solve(clean),
    )
    assert [
        "(npp):" in each.text for each in result.findings if each.key == "drift-large"
    ] == [True]
    assert result.setups["npp"].drift[0].total_um == pytest.approx(um, rel=0.2)
    for name, function in result.errors.items():
        assert (
            np.max(np.abs(function.value - without.errors[name].value)) < 0.1 + 0.01 * um
        ), name


@pytest.mark.parametrize("um", [12.0, 60.0])
def test_a_drift_that_was_stated_hides_and_harms_nothing(um):
    """Who states 20 µm of drift hears nothing of 12 to 60: compensated by the result the machine
    errs by less than a tenth of before, and the interval holds what was there; what will be left is
    not promised too small."""
    bench = Bench(seed=3, increments=5, angle_urad=2.0)
    clean = bench.survey((*DIAGONALS, *LINEAR), passes=(1, 2))
    mine = np.array(clean.setup) == "npp"
    since = np.array(clean.time_s) - np.min(np.array(clean.time_s)[mine])
    result = solve(
        shifted(clean, mine, um * since[mine] / np.ptp(since[mine])),
        assumed=Assumptions(drift_um=20.0),
    )
    assert not [each for each in result.findings if each.severity == "error"]
    points = np.stack(
        np.meshgrid(*(np.linspace(0.0, size, 6) for size in bench.size_mm), indexing="ij"),
        axis=-1,
    ).reshape(-1, 3)
    true = bench.machine.error_at(points)
    before, after = (
        float(
            np.sqrt(
                np.mean(
                    np.sum(without_rigid_motion(result.volume, points, field) ** 2, axis=1)
                )
            )
        )
        for field in (true, true - error_field_um(result, points))
    )
    said = reach_in(result)
    assert after < 0.1 * before
    assert said.rms_before.low_um < before < said.rms_before.high_um
    assert after < said.rms_after.high_um
