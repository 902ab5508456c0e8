"""Ten times more contradiction than a machine makes is a mistake: named where it most probably lies, and an error."""

from dataclasses import replace

import numpy as np
import pytest

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
