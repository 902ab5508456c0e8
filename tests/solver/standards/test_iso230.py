"""Figures of ISO 230-2, ISO 230-6, ASME B5.54 and VDI/DGQ 3441 against published readings."""

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stepdiag.base.errors import DataError
from stepdiag.solver.standards.iso230 import (
    PositioningRuns,
    arrange_runs,
    diagonal_figures,
    positioning_figures,
    vdi_3441_figures,
)

DATA = Path(__file__).parents[2] / "data"
REPORT_NAMES = {
    "B_mean": "B_mean",
    "R_fwd": "R_up",
    "R_bwd": "R_down",
    "E_fwd": "E_up",
    "E_bwd": "E_down",
}
REPORT_NAMES |= {
    "A_fwd": "A_up",
    "A_bwd": "A_down",
    "Umax": "U_max",
    "Umean": "U_mean",
    "Psmax": "Ps_max",
    "Psmean": "Ps_mean",
}


def load(name):
    """Read a table of readings: columns target, direction, cycle, and a position in mm or a
    deviation in um."""
    lines = (DATA / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(lines[1:]))
    targets = sorted({float(row["target_mm"]) for row in rows})
    tables = {}
    for row in rows:
        target = float(row["target_mm"])
        deviation = (
            float(row["deviation_um"])
            if "deviation_um" in row
            else 1e3 * (float(row["reference_mm"]) - target)
        )
        direction = "up" if row["direction"] in {"up", "forward"} else "down"
        tables.setdefault(direction, {t: [] for t in targets})[target].append(deviation)
    up, down = (np.array([tables[name][t] for t in targets]) for name in ("up", "down"))
    return PositioningRuns(target_mm=np.array(targets), up_um=up, down_um=down)


def expected_um(dataset, standard):
    with (DATA / "iso230_2_expected.csv").open(encoding="utf-8") as file:
        rows = [
            row
            for row in csv.DictReader(file)
            if row["dataset"] == dataset and row["standard"].startswith(standard)
        ]
    return {row["quantity"]: 1e3 * float(row["value_mm"]) for row in rows}


def assert_figures(figures, expected):
    assert expected
    for name, value in expected.items():
        assert getattr(figures, REPORT_NAMES.get(name, name)) == pytest.approx(
            value, abs=6e-5
        ), name


@pytest.mark.parametrize("dataset", ["ecmc_11358_axis1", "ecmc_20211110"])
def test_iso_230_2_of_real_stages(dataset):
    """data/iso230_2_expected.csv: from the readings printed in two public reports, seven decimals
    of a millimetre."""
    assert_figures(
        positioning_figures(load(f"iso230_2_{dataset}")), expected_um(dataset, "ISO 230-2")
    )


@pytest.mark.parametrize("dataset", ["ecmc_11358_axis1", "ecmc_20211110"])
def test_vdi_3441_of_real_stages(dataset):
    """data/iso230_2_expected.csv, VDI/DGQ 3441 rows."""
    assert_figures(vdi_3441_figures(load(f"iso230_2_{dataset}")), expected_um(dataset, "VDI"))


def test_figures_that_can_be_checked_by_hand():
    """First line of data/iso230_2_synthetic.csv: s = sqrt(1/2) um everywhere, so R = 4 s + |B|."""
    runs = load("iso230_2_synthetic")
    iso = positioning_figures(runs)
    hand = {
        "B": 9.0,
        "B_mean": 4.8,
        "R_fwd": 2.828427,
        "R_bwd": 2.828427,
        "R": 11.828427,
        "E_fwd": 8.0,
        "E_bwd": 11.0,
    }
    hand |= {"E": 15.0, "M": 8.5, "A_fwd": 10.828427, "A_bwd": 13.828427, "A": 17.828427}
    assert_figures(iso, hand)
    vdi = {
        "P": 19.242641,
        "Pa": 8.5,
        "Umax": 9.0,
        "Umean": 4.8,
        "Psmax": 4.242641,
        "Psmean": 4.242641,
    }
    assert_figures(vdi_3441_figures(runs), vdi)
    assert iso.s_up_um == pytest.approx(np.full(5, np.sqrt(0.5)))


def test_three_sigma_edition_widens_only_the_scatter():
    """ISO 230-2:1988: A = max(x+3s) - min(x-3s), R = 6s (theory.md 8.5); systematic figures are the
    same."""
    runs = load("iso230_2_synthetic")
    old, new = positioning_figures(runs, "iso-230-2-1988"), positioning_figures(runs)
    assert old.R_up == pytest.approx(6 * np.sqrt(0.5))
    assert pytest.approx(15 + 6 * np.sqrt(0.5)) == old.A
    assert (old.E, old.M, old.B) == (new.E, new.M, new.B)


def test_every_result_says_how_far_its_formulae_can_be_trusted():
    runs = load("iso230_2_synthetic")
    sources = [
        positioning_figures(runs),
        positioning_figures(runs, "asme-b5.54"),
        diagonal_figures({"ppp": runs}),
        vdi_3441_figures(runs),
    ]
    assert [figures.standard.split(":")[0] for figures in sources] == [
        "ISO 230-2",
        "ASME B5.54-2005",
        "ISO 230-6",
        "VDI/DGQ 3441",
    ]
    assert all("recalled" in figures.source_status for figures in sources)


def test_machine_figure_is_the_worst_diagonal():
    quiet = load("iso230_2_synthetic")
    loud = PositioningRuns(
        target_mm=quiet.target_mm, up_um=2 * quiet.up_um, down_um=2 * quiet.down_um
    )
    figures = diagonal_figures({"ppp": quiet, "npp": loud})
    assert (figures.E_d, figures.B_d) == (30.0, 18.0)
    assert figures.diagonals["ppp"].E == 15.0


def test_diagonals_without_repeats_have_no_repeatability():
    quiet = load("iso230_2_synthetic")
    once = PositioningRuns(
        target_mm=quiet.target_mm, up_um=quiet.up_um[:, :1], down_um=quiet.down_um[:, :1]
    )
    figures = diagonal_figures({"ppp": quiet, "npp": once})
    assert (figures.R_d, figures.A_d) == (None, None)
    assert figures.E_d is not None


def test_single_direction_gives_no_bidirectional_figure():
    runs = load("iso230_2_synthetic")
    figures = positioning_figures(PositioningRuns(target_mm=runs.target_mm, up_um=runs.up_um))
    assert (figures.E, figures.B, figures.M, figures.R, figures.A) == (None,) * 5
    assert figures.E_up == 8.0
    with pytest.raises(DataError, match="in each direction"):
        vdi_3441_figures(PositioningRuns(target_mm=runs.target_mm, up_um=runs.up_um))


tables = arrays(np.float64, (6, 3), elements=st.floats(-30, 30, width=32))


@given(tables, tables, st.floats(-100, 100))
def test_figures_do_not_see_the_zero_and_bound_each_other(up, down, shift_um):
    target = np.linspace(0, 500, 6)
    here = positioning_figures(PositioningRuns(target_mm=target, up_um=up, down_um=down))
    there = positioning_figures(
        PositioningRuns(target_mm=target, up_um=up + shift_um, down_um=down + shift_um)
    )
    for name in ("E", "M", "B", "R", "A", "E_up", "A_down"):
        assert getattr(here, name) == pytest.approx(getattr(there, name), abs=1e-9)
    slack = 1e-9
    assert here.E + slack >= here.M
    assert max(here.E_up, here.E_down, here.B) <= here.E + slack
    assert here.A + slack >= here.E
    assert max(here.R_up, here.R_down, here.B) <= here.R + slack


def test_passes_become_runs():
    """Odd passes are outward, even ones return; rows in any order."""
    target = [0.0, 100.0, 100.0, 0.0, 0.0, 100.0, 100.0, 0.0]
    runs, findings = arrange_runs(
        target, [1, 1, 2, 2, 3, 3, 4, 4], [0, 1, 5, 4, 0, 3, 7, 4], common_zero=True
    )
    assert findings == ()
    assert runs.up_um.tolist() == [[0, 0], [1, 3]]
    assert runs.down_um.tolist() == [[4, 4], [5, 7]]


def test_passes_that_restart_at_zero_have_lost_the_reversal_value():
    runs, findings = arrange_runs(
        [0.0, 100.0, 100.0, 0.0], [1, 1, 2, 2], [0, 1, 0, -1], common_zero=False
    )
    assert runs.down_um is None
    assert [finding.key for finding in findings] == ["iso230-plan.zero"]


def test_outward_passes_alone_need_no_common_zero():
    runs, findings = arrange_runs(
        [0.0, 100.0, 0.0, 100.0], [1, 1, 3, 3], [0, 1, 0, 2], common_zero=False
    )
    assert runs.up_um.tolist() == [[0, 0], [1, 2]]
    assert (runs.down_um, findings) == (None, ())


@pytest.mark.parametrize("passes", [[1, 1, 3], [2, 2, 4]])
def test_table_with_a_hole_is_refused(passes):
    with pytest.raises(DataError, match="up_um"):
        arrange_runs([0.0, 100.0, 0.0], passes, [0, 1, 0], common_zero=True)


@pytest.mark.parametrize(
    ("targets", "runs", "expected"),
    [
        (np.linspace(0, 500, 5), 5, []),
        (np.linspace(0, 2000, 9), 5, ["9 targets on 2000 mm; 10 are needed"]),
        (np.linspace(0, 500, 5), 3, ["3 runs per direction; 5 are needed"]),
        (np.linspace(0, 3000, 13), 1, []),
        (
            np.linspace(0, 3000, 11),
            1,
            [
                (
                    "the interval between targets is 300 mm; an axis longer than 2000 mm needs "
                    "an interval of at most 250 mm"
                )
            ],
        ),
    ],
)
def test_plan_thinner_than_the_standard_is_said(targets, runs, expected):
    """ISO 230-2: five targets a metre and five runs up to 2 m; longer axes one run, 250 mm
    (theory.md 8.1)."""
    findings = positioning_figures(
        PositioningRuns(target_mm=targets, up_um=np.zeros((len(targets), runs)))
    ).findings
    assert [finding.text for finding in findings] == expected
