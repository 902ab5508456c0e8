"""The figures of the standards as they stand in a result."""

import numpy as np
import pytest

from stepdiag.solver.geometry.volume import Volume, linear_stops_mm
from stepdiag.solver.methods.standard_figures import linear_runs, standards_report
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.readings.readings import make_readings

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
    runs = linear_runs(layout)["linear-x"]
    assert runs.target_mm == pytest.approx([0, 100, 200, 300, 400])
    assert runs.up_um == pytest.approx(np.array([[0, 0], [1, 2], [2, 3], [3, 4], [4, 6]]), abs=1e-6)
    assert runs.down_um is None


def test_report_states_the_figures_and_how_well_the_standard_is_known():
    """E_up is the range of the means (0 to 5 um); R_up = 2 k s with s = sqrt(2) um at the last target (ISO 230-2: k = 2; 1988: k = 3)."""
    report = standards_report(lay_out(run_of([[0, 1, 2, 3, 4], [0, 2, 3, 4, 6]]), volume=BOX))
    by_name = {figures["standard"]: figures for figures in report["linear-x"]}
    assert by_name["ISO 230-2:2014"]["E_up"] == pytest.approx(5.0)
    assert by_name["ISO 230-2:2014"]["R_up"] == pytest.approx(4 * np.sqrt(2.0))
    assert by_name["ISO 230-2:1988"]["R_up"] == pytest.approx(6 * np.sqrt(2.0))
    assert all("recalled" in figures["source_status"] for figures in report["linear-x"])
