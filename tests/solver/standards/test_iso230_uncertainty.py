"""U of the positioning figures, by hand from the sources (theory.md 8.7)."""

import numpy as np
import pytest

from stepdiag.solver.standards.iso230 import PositioningRuns, positioning_figures
from stepdiag.solver.standards.iso230_uncertainty import RunSources, expanded_um

SOURCES = RunSources(relative=2e-6, reading_um=0.3, environment_um=0.4)
"""One reading is known to hypot(0.3, 0.4) = 0.5 µm; a metre to 2 um."""
FIGURES = (
    "E",
    "E_up",
    "E_down",
    "M",
    "B",
    "B_mean",
    "R_up",
    "R_down",
    "R",
    "A_up",
    "A_down",
    "A",
)


def test_every_figure_by_hand():
    """Four runs: the mean of a position is known to 0.25 µm, a scatter of four to one part in
    sqrt(6); B is the largest of five."""
    told = expanded_um(
        {**dict.fromkeys(FIGURES, 1.0), "R_up": 2.4, "R_down": 3.2},
        1000.0,
        (4, 4),
        5,
        SOURCES,
    )
    of_range = (2.0**2 + 2 * 0.25**2) ** 0.5
    reversal = 2**0.5 * 0.25
    up, down = 2.4 / 6**0.5, 3.2 / 6**0.5
    largest = reversal * (1.0 + 2.0 * np.log(5.0) / 3.0) ** 0.5
    both = (((up**2 + down**2) ** 0.5 / 2) ** 2 + largest**2) ** 0.5
    exact = {
        "E": of_range,
        "E_up": of_range,
        "E_down": of_range,
        "M": (2.0**2 + 0.25**2) ** 0.5,
        "B": largest,
        "B_mean": reversal,
        "R_up": up,
        "R_down": down,
        "R": both,
        "A_up": (of_range**2 + up**2) ** 0.5,
        "A_down": (of_range**2 + down**2) ** 0.5,
        "A": (of_range**2 + both**2) ** 0.5,
    }
    assert told == pytest.approx({name: 2 * u for name, u in exact.items()})


def test_figures_of_one_direction_need_no_other():
    told = expanded_um(
        {"E_up": 1.0, "M": 1.0, "R_up": 2.4, "A_up": 3.0, "A": 3.0, "R": 1.0},
        0.0,
        (4, 4),
        5,
        SOURCES,
    )
    assert set(told) == {"E_up", "M", "R_up", "A_up"}
    assert told["M"] == pytest.approx(0.5)
    assert told["E_up"] == pytest.approx(2 * 2**0.5 * 0.25)


def test_one_run_more_in_one_direction():
    """A pass back that was driven again: its scatter is of two runs, the mean that of the direction
    with one."""
    told = expanded_um({"E": 1.0, "R_down": 3.0, "A_down": 3.5}, 0.0, (1, 2), 5, SOURCES)
    assert told["R_down"] == pytest.approx(2 * 3.0 / 2**0.5)
    assert told["E"] == pytest.approx(2 * 2**0.5 * 0.5)


@pytest.mark.parametrize(("targets", "runs"), [(5, 5), (11, 2), (41, 5)])
def test_u_holds_the_truth_of_every_figure(targets, runs):
    """3 µm of backlash, 4 µm of slope, noise of 0.5 µm a reading: of 400 tests U holds the truth in
    95 %, as far as 400 can tell (2 %)."""
    rng = np.random.default_rng(targets)
    at, noise = np.linspace(0.0, 4.0, targets), 0.5
    sources = RunSources(relative=0.0, reading_um=noise, environment_um=0.0)
    truth = {
        "E_up": 4.0,
        "E": 7.0,
        "M": 4.0,
        "B": 3.0,
        "B_mean": 3.0,
        "R_up": 4 * noise,
        "R": 4 * noise + 3.0,
        "A": 7.0 + 4 * noise,
    }
    inside = dict.fromkeys(truth, 0)
    for _ in range(400):
        up, down = (
            at[:, None] + half + rng.normal(0.0, noise, (targets, runs))
            for half in (1.5, -1.5)
        )
        found = positioning_figures(
            PositioningRuns(target_mm=100.0 * at, up_um=up, down_um=down)
        ).numbers()
        u = expanded_um(found, 400.0, (runs, runs), targets, sources)
        for name, true in truth.items():
            inside[name] += abs(found[name] - true) <= u[name]
    assert min(inside[name] for name in ("E_up", "E", "M", "B", "B_mean")) >= 0.93 * 400, (
        inside
    )
    # R and A are what their runs scattered by: the largest of many targets says more than the
    # machine's own
    assert min(inside.values()) >= 0.9 * 400, inside
