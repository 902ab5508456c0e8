"""The solver's cases: surveys of the virtual machine, every kind of them small, and tables of what is refused."""

from dataclasses import replace

import numpy as np
from _figures import FIGURES

from stepdiag.solver.model.angles import render_angles
from stepdiag.solver.readings.readings import Readings, render_readings
from testkit.exact.surveys import DATA, DIAGONALS, LINEAR, Bench

SMALL = Bench(seed=3, size_mm=(300.0, 200.0, 100.0), increments=4, angle_urad=6.0)


def survey(readings: Readings, **further):
    """Return the JSON of a survey: the lines of its table and what else the solver is told."""
    return {"readings": render_readings(readings).splitlines(), **further}


def angles(bench: Bench, *names: str, u_urad: float = 1.0):
    """Return the lines of an angles file with these functions, all where none is named."""
    known = bench.angles(u_urad)
    return render_angles({name: known[name] for name in names or known}).splitlines()


def moved(readings: Readings, setup: str, pass_number: int, by_um) -> Readings:
    """Return readings of which those of one pass are changed by ``by_um``, a function of the stop."""
    mine = np.array([name == setup for name in readings.setup]) & (readings.pass_number == pass_number)
    added = np.where(mine, 1e-3 * by_um(readings.stop.astype(float)), 0.0)
    return replace(readings, reading_mm=readings.reading_mm + added)


def golden(name: str):
    """Return the readings of a golden file as they stand."""
    return {"readings": (DATA / f"golden_stepdiag_{name}.csv").read_text(encoding="utf-8").splitlines()}


def _back():
    return SMALL.survey(passes=(1, 2))


CASES = FIGURES | {
    "usual": ("four diagonals, three runs, all angles known", "solve", lambda: survey(SMALL.survey(), angles=angles(SMALL))),
    "usual-no-angles": ("four diagonals, three runs, no angles", "solve", lambda: survey(SMALL.survey())),
    "diagonals-alone": (
        "four diagonals out, no scale", "solve",
        lambda: survey(replace(SMALL, chain="XYFZ").survey(DIAGONALS), chain="XYFZ"),
    ),
    "two-ways": (
        "four diagonals and runs out and back, some angles known", "solve",
        lambda: survey(_back(), angles=angles(SMALL, "EAX", "EBX", "ECY")),
    ),
    "outlier": (
        "one stop of a diagonal 30 um off", "solve",
        lambda: survey(moved(SMALL.survey(), "npp", 1, lambda stop: 30.0 * (stop == 5))),
    ),
    "slip": (
        "the count of a diagonal slips by 8 um", "solve",
        lambda: survey(moved(_back(), "pnp", 1, lambda stop: 8.0 * (stop >= 6))),
    ),
    "printed": ("Wang's formulas as printed", "solve", lambda: survey(SMALL.survey(DIAGONALS), method="wang2000")),
    "closed": ("the closed form, corrected", "solve", lambda: survey(SMALL.survey((*DIAGONALS, *LINEAR)), method="least-squares")),
}  # fmt: skip
