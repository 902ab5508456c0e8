"""The figures of the standards as they stand in a result."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.readings.readings import make_readings
from stepdiag.base.result.typed import written
from stepdiag.base.volume import Volume
from stepdiag.solver.methods.standard_figures import linear_runs, standards_report
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import DATA, DIAGONALS, Bench
from testkit.stops import linear_stops_mm

BOX = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(400.0, 300.0, 200.0), increments=4)


def run_of(deviations_um):
    """Return a linear run along X, one pass out for each row of deviations."""
    stops = linear_stops_mm(BOX, "linear-x")
    count, passes = len(stops), len(deviations_um)
    return make_readings(
        setup=["linear-x"] * (count * passes),
        pass_number=np.repeat(2 * np.arange(passes) + 1, count),
        stop=np.tile(np.arange(count), passes),
        position_mm=np.tile(stops, (passes, 1)),
        reading_mm=(stops[:, 0] + np.array(deviations_um) * 1e-3).ravel(),
    )


def test_linear_runs_are_targets_by_outward_runs():
    layout = lay_out(run_of([[0, 1, 2, 3, 4], [0, 2, 3, 4, 6]]), volume=BOX)
    runs = linear_runs(layout)["linear-x"].runs
    assert runs.target_mm == pytest.approx([0, 100, 200, 300, 400])
    assert runs.up_um == pytest.approx(
        np.array([[0, 0], [1, 2], [2, 3], [3, 4], [4, 6]]), abs=1e-6
    )
    assert runs.down_um is None


def test_report_states_the_figures_and_how_well_the_standard_is_known():
    """E_up is the range of the means (0 to 5 µm); R_up = 2 k s with s = sqrt(2) um at the last
    target (ISO 230-2: k = 2; 1988: k = 3)."""
    report = written(
        standards_report(lay_out(run_of([[0, 1, 2, 3, 4], [0, 2, 3, 4, 6]]), volume=BOX))
    )
    by_name = {figures["standard"]: figures for figures in report["linear-x"]}
    assert by_name["ISO 230-2:2014"]["E_up"] == pytest.approx(5.0)
    assert by_name["ISO 230-2:2014"]["R_up"] == pytest.approx(4 * np.sqrt(2.0))
    assert by_name["ISO 230-2:1988"]["R_up"] == pytest.approx(6 * np.sqrt(2.0))
    assert all("recalled" in figures["source_status"] for figures in report["linear-x"])


def both_ways(backlash_um, *, stretches=(1, 1, 1, 1, 1), noise_um=0.0):
    """Return five runs out and back along X whose ways differ by the backlash, each pair on the
    count named."""
    stops = linear_stops_mm(BOX, "linear-x")
    rng = np.random.default_rng(1)
    columns = {
        name: []
        for name in ("setup", "pass_number", "stop", "position_mm", "reading_mm", "zero")
    }
    for pair, zero in enumerate(stretches):
        for way, points in enumerate((stops, stops[::-1])):
            error_um = (
                0.01 * points[:, 0]
                + (0.5 - way) * backlash_um
                + rng.normal(0, noise_um, len(points))
            )
            columns["setup"] += ["linear-x"] * len(points)
            columns["pass_number"] += [2 * pair + way + 1] * len(points)
            columns["stop"] += range(len(points))
            columns["position_mm"] += points.tolist()
            columns["reading_mm"] += (points[:, 0] + 1e-3 * error_um).tolist()
            columns["zero"] += [zero] * len(points)
    return lay_out(make_readings(**columns), volume=BOX)


def test_both_directions_on_one_count_give_the_bidirectional_figures():
    """4 µm over 400 mm and 3 µm of backlash: E_up 4, B 3, E 7, M 4 (ISO 230-2); VDI 3441: Pa 4, U
    3."""
    report = written(standards_report(both_ways(3.0)))["linear-x"]
    iso = report[0]
    found = {
        name: iso[name] for name in ("E_up", "E_down", "E", "B", "B_mean", "M", "R", "A")
    }
    assert found == pytest.approx(
        {
            "E_up": 4.0,
            "E_down": 4.0,
            "E": 7.0,
            "B": 3.0,
            "B_mean": 3.0,
            "M": 4.0,
            "R": 3.0,
            "A": 7.0,
        }
    )
    vdi = next(figures for figures in report if figures["standard"].startswith("VDI"))
    assert (vdi["Pa"], vdi["U_max"], vdi["P"]) == pytest.approx((4.0, 3.0, 7.0))


@pytest.mark.parametrize(("runs", "told"), [(1, False), (2, True)])
def test_vdi_asks_for_two_runs_each_way(runs, told):
    report = written(standards_report(both_ways(3.0, stretches=(1,) * runs)))["linear-x"]
    assert any(figures["standard"].startswith("VDI") for figures in report) is told


def test_every_figure_comes_with_its_uncertainty_and_length_counts_in_none_of_backlash():
    iso = written(
        standards_report(both_ways(3.0, noise_um=0.3), Assumptions(reduced_to_20_c=True))
    )["linear-x"][0]
    assert iso["lengths"] == "at 20 C"
    as_it_is = written(standards_report(both_ways(3.0, noise_um=0.3)))["linear-x"][0]
    assert as_it_is["lengths"] == "as measured"
    # how warm the machine was is uncertain at 20 C only
    assert as_it_is["U"]["E"] < iso["U"]["E"]
    assert set(iso["U"]) == {
        "E_up",
        "E_down",
        "E",
        "M",
        "B",
        "B_mean",
        "R_up",
        "R_down",
        "R",
        "A_up",
        "A_down",
        "A",
    }
    assert iso["U"]["B"] < iso["U"]["M"] < iso["U"]["E"] < iso["U"]["A"]
    assert abs(iso["B_mean"] - 3.0) < iso["U"]["B_mean"]


def test_runs_on_another_count_do_not_pretend_to_share_the_zero():
    """Two of five pairs were driven after the count had been lost: the three that share one are
    evaluated."""
    report = written(standards_report(both_ways(3.0, stretches=(1, 1, 1, 2, 2))))["linear-x"][
        0
    ]
    assert report["runs"] == 3
    assert report["B"] == pytest.approx(3.0)


def test_a_run_from_the_high_end_has_the_same_backlash():
    """The laser at the far end: readings grow towards the low end, the approach in + is then the
    way back."""
    stops = linear_stops_mm(BOX, "linear-x")
    columns = {
        "position_mm": [*stops[::-1].tolist(), *stops.tolist()],
        "pass_number": [1] * 5 + [2] * 5,
        "stop": [*range(5)] * 2,
    }
    error_um = np.concatenate([np.full(5, -1.5), np.full(5, 1.5)])
    along = 400.0 - np.array(columns["position_mm"])[:, 0]
    layout = lay_out(
        make_readings(
            setup=["linear-x"] * 10,
            reading_mm=along - 1e-3 * error_um,
            zero=[1] * 10,
            **columns,
        ),
        volume=BOX,
    )
    assert written(standards_report(layout))["linear-x"][0]["B"] == pytest.approx(3.0)


def test_step_diagonals_are_not_called_iso_230_6():
    report = written(standards_report(lay_out(Bench(seed=1).survey())))
    assert "diagonals" not in report
    assert "step diagonals" in report["step-diagonals"][0]["standard"]
    assert all("step diagonals" in report[name][0]["standard"] for name in DIAGONALS)


def as_readings(name, setup="linear-x"):
    """Return a public table of runs as the rows of a survey: along X, or along a body diagonal on
    which all axes move together."""
    lines = [
        line
        for line in (DATA / f"{name}.csv").read_text(encoding="utf-8").splitlines()
        if not line.startswith(("#", '"#'))
    ]
    rows = list(csv.DictReader(lines))
    targets = sorted({float(row["target_mm"]) for row in rows})
    way = np.ones(3) / np.sqrt(3.0) if setup.startswith("body") else np.eye(3)[0]
    columns = {
        key: []
        for key in ("setup", "pass_number", "stop", "position_mm", "reading_mm", "zero")
    }
    for row in sorted(
        rows, key=lambda row: (int(row["cycle"]), row["direction"] == "reverse")
    ):
        back, along = row["direction"] == "reverse", float(row["target_mm"]) - targets[0]
        stop = targets.index(float(row["target_mm"]))
        columns["setup"].append(setup)
        columns["pass_number"].append(2 * int(row["cycle"]) - (not back))
        columns["stop"].append(len(targets) - 1 - stop if back else stop)
        columns["position_mm"].append((along * way).tolist())
        columns["reading_mm"].append(float(row["reference_mm"]) - targets[0])
        columns["zero"].append(1)
    return make_readings(**columns), targets[-1] - targets[0]


NAMES = {
    "R_fwd": "R_up",
    "R_bwd": "R_down",
    "E_fwd": "E_up",
    "E_bwd": "E_down",
    "A_fwd": "A_up",
    "A_bwd": "A_down",
}
NAMES |= {"Umax": "U_max", "Umean": "U_mean", "Psmax": "Ps_max", "Psmean": "Ps_mean"}


@pytest.mark.parametrize("dataset", ["ecmc_11358_axis1", "ecmc_20211110"])
def test_published_readings_give_the_published_figures_as_runs_of_a_survey(dataset):
    """tests/data/iso230_2_expected.csv through the door: rows of a linear run in, ISO 230-2 and
    VDI/DGQ 3441 out, each with U."""
    readings, length = as_readings(f"iso230_2_{dataset}")
    box = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(length, 100.0, 100.0), increments=4)
    report = written(standards_report(lay_out(readings, volume=box)))["linear-x"]
    iso, vdi = (
        next(one for one in report if one["standard"].startswith(name))
        for name in ("ISO 230-2:2014", "VDI")
    )
    with (DATA / "iso230_2_expected.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["dataset"] == dataset]
    assert len(rows) == 18
    for row in rows:
        found = (vdi if row["standard"].startswith("VDI") else iso)[
            NAMES.get(row["quantity"], row["quantity"])
        ]
        assert found == pytest.approx(1e3 * float(row["value_mm"]), abs=6e-5), row["quantity"]
    assert set(iso["U"]) >= {"E", "B", "R", "A", "M"}


def test_body_diagonals_are_iso_230_6_and_the_machine_has_the_largest():
    """The same public readings on four body diagonals: E, B, R, A of each, the largest of them with
    its U as the machine's."""
    parts = [as_readings("iso230_2_ecmc_11358_axis1", f"body-{name}") for name in DIAGONALS]
    side = parts[0][1] / np.sqrt(3.0)
    mirrored = []
    for (readings, _), name in zip(parts, DIAGONALS, strict=True):
        turned = np.array([letter == "n" for letter in name])
        mirrored.append(
            replace(
                readings,
                position_mm=np.where(
                    turned, side - readings.position_mm, readings.position_mm
                ),
            )
        )
    joined = make_readings(
        setup=[setup for one in mirrored for setup in one.setup],
        **{
            key: np.concatenate([getattr(one, key) for one in mirrored])
            for key in ("pass_number", "stop", "position_mm", "reading_mm", "zero")
        },
    )
    report = written(
        standards_report(
            lay_out(
                joined, volume=Volume(origin_mm=(0.0,) * 3, size_mm=(side,) * 3, increments=4)
            )
        )
    )
    assert "step-diagonals" not in report
    (machine,) = report["diagonals"]
    assert machine["standard"] == "ISO 230-6:2002"
    for name, um in {"E_d": 15.988, "B_d": 4.564, "R_d": 8.3539, "A_d": 18.5713}.items():
        assert machine[name] == pytest.approx(um, abs=6e-5)
        assert machine["U"][name] > 0.0
    assert all(
        report[f"body-{name}"][0]["E"] == pytest.approx(15.988, abs=6e-5)
        for name in DIAGONALS
    )
