"""Ten times more contradiction than a machine makes is a mistake: named where it most probably lies, and an error."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.solver.methods.solve import solve
from testkit.surveys import DIAGONALS, Bench


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
def test_a_pass_that_slipped_is_named(setup, number):
    """Nobody but the solver sees it: the count went wrong by 200 um in the middle of one pass of four diagonals out and back."""
    clean = survey(angle_urad=10.0)
    rows = (np.array(clean.setup) == setup) & (np.array(clean.pass_number) == number) & (np.array(clean.stop) >= 7)
    assert errors_of(shifted(clean, rows, 200.0)) == [("chi-square-far", setup, number, None)]
