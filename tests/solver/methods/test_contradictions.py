"""Ten times more contradiction than a machine makes is a mistake: named where it most probably lies, and an error."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from stepdiag.solver.methods.contradictions import contradictions
from stepdiag.solver.methods.solve import solve
from testkit.exact.surveys import DIAGONALS, Bench


def errors_of(readings):
    """Return (code, setup, pass, stop) of the errors of a result."""
    findings = solve(readings, chain="FXYZ", method="estimate").findings
    return [(each.code, each.setup, each.pass_number, each.stop) for each in findings if each.severity == "error"]


def survey(**options):
    return Bench(seed=3, increments=5, diagonal_noise_um=0.05, linear_noise_um=0.05, **options).survey(DIAGONALS, passes=(1, 2))


def shifted(readings, rows, by_um):
    reading = np.array(readings.reading_mm)
    reading[rows] += by_um * 1e-3
    return replace(readings, reading_mm=reading)


@pytest.mark.parametrize("angle_urad", [0.0, 10.0, 40.0])
def test_an_unmeasured_angle_is_no_mistake(angle_urad):
    assert errors_of(survey(angle_urad=angle_urad)) == []


@pytest.mark.parametrize(("setup", "number"), [("npp", 1), ("ppn", 2)])
def test_a_pass_that_is_wrong_everywhere_is_named(setup, number):
    """Nobody but the solver sees it: every stop of one pass of four diagonals out and back is off by some 20 um, each by another amount."""
    clean = survey(angle_urad=10.0)
    rows = np.flatnonzero((np.array(clean.setup) == setup) & (np.array(clean.pass_number) == number))
    off = np.random.default_rng(1).normal(scale=20.0, size=len(rows))
    said = solve(shifted(clean, rows, off), chain="FXYZ", method="estimate").findings
    errors = [each for each in said if each.severity == "error"]
    assert errors
    assert any(f"setup {setup}, pass {number}" in each.text or (each.setup, each.pass_number) == (setup, number) for each in said)


def test_a_count_that_slipped_once_is_repaired_and_named():
    """200 um in the middle of one pass: one more unknown explains it all, and nothing is refused."""
    clean = survey(angle_urad=10.0)
    rows = (np.array(clean.setup) == "npp") & (np.array(clean.pass_number) == 1) & (np.array(clean.stop) >= 7)
    findings = solve(shifted(clean, rows, 200.0), chain="FXYZ", method="estimate").findings
    assert [(each.code, each.setup, each.pass_number, each.stop) for each in findings if each.code == "count-step"] == [
        ("count-step", "npp", 1, 7)
    ]
    assert not [each for each in findings if each.severity == "error"]


@pytest.mark.parametrize(("u_um", "codes"), [(9.0, set()), (12.0, {"noise-far"})])
def test_readings_ten_times_as_uncertain_as_usual_stop_the_export_with_their_setup(u_um, codes):
    """They contradict nothing: their scatter is as they say themselves, and nothing can be concluded from them."""
    clean = survey()
    reading = np.array(clean.reading_mm) + np.random.default_rng(1).normal(scale=u_um * 1e-3, size=len(clean.reading_mm))
    errors = errors_of(replace(clean, reading_mm=reading, u_um=np.full(len(reading), u_um)))
    assert {code for code, *_ in errors} == codes
    assert [setup for _, setup, *_ in errors] == list(DIAGONALS) * bool(codes)


@pytest.mark.parametrize(("total_um", "u_um", "said"), [(19.0, 0.1, False), (21.0, 0.1, True), (21.0, 1.0, False), (-40.0, 1.0, True)])
def test_a_drift_ten_times_what_is_usual_is_no_drift(total_um, u_um, said):
    """Of a setup's report: named with the way back of its pair, unless it is not known well enough."""
    quiet = SimpleNamespace(chi_square=1.0, fit=SimpleNamespace(freedom=10))
    report = {"drift": [{"pair": 2, "total_um": total_um, "u_um": u_um}], "noise_um": 0.1, "repeatability_um": None}
    found = contradictions(quiet, {"npp": report})
    assert [(each.code, each.severity, each.setup, each.pass_number) for each in found] == [("drift-far", "error", "npp", 4)] * said
