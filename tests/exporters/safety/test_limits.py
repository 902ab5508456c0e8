"""Limits of tables grow with the travel; a limit that the profile states, and one that the control
has, stand as they are."""

import tempfile
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import SafetyError
from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.base.volume import Volume
from stepdiag.exporters.export.export import export
from stepdiag.exporters.tables.controller import plausible_slope_um_mm
from stepdiag.exporters.tables.profile import LimitsSection
from testkit.exact.results import made_result

TODAY = date(2026, 6, 1)
TRAVEL = st.floats(1.0, 20_000.0)


def machine_of(edge_mm, n, values):
    return made_result(
        values,
        volume=Volume(
            origin_mm=(0.0, 0.0, 0.0), size_mm=(edge_mm, edge_mm, edge_mm), increments=n
        ),
    )


def refused(result, step_mm):
    """Return the code that refuses a quick look of a result, None where it is written."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            export(
                result,
                "siemens",
                None,
                step_mm=step_mm,
                out_dir=Path(folder) / "out",
                today=TODAY,
            )
        except SafetyError as refusal:
            return refusal.code
    return None


class TestSizes:
    def test_a_travel_of_half_a_metre_has_the_limits_of_the_template(self):
        limits = LimitsSection().at(500.0)
        assert (limits.value_um, limits.warn_value_um, limits.change_um) == (
            400.0,
            200.0,
            40.0,
        )

    @given(TRAVEL, TRAVEL)
    def test_a_longer_travel_has_limits_as_large_at_least(self, one, other):
        shorter, longer = (
            LimitsSection().at(travel_mm) for travel_mm in sorted((one, other))
        )
        assert shorter.value_um <= longer.value_um
        assert shorter.warn_value_um <= longer.warn_value_um
        assert shorter.change_um <= longer.change_um
        assert longer.change_um < longer.warn_value_um < longer.value_um

    @given(TRAVEL)
    def test_a_stated_limit_stands(self, travel_mm):
        limits = LimitsSection(value_um=70.0, warn_value_um=7.0, change_um=3.0).at(travel_mm)
        assert (limits.value_um, limits.warn_value_um, limits.change_um) == (70.0, 7.0, 3.0)

    @pytest.mark.parametrize("edge_mm", [2000.0, 4000.0, 10_000.0])
    def test_a_long_machine_off_by_25_um_a_metre_is_exported(self, edge_mm):
        assert (
            refused(
                machine_of(edge_mm, 10, {"EXX": np.linspace(0.0, 0.025 * edge_mm, 11)}),
                edge_mm / 10,
            )
            is None
        )

    @pytest.mark.parametrize(
        ("um_m", "code"),
        [(390.0, None), (410.0, "value-large"), (810.0, "value-large.limit")],
    )
    @pytest.mark.parametrize("edge_mm", [500.0, 1000.0, 4000.0])
    def test_the_limit_is_the_same_slope_on_every_travel(self, edge_mm, um_m, code):
        assert (
            refused(
                machine_of(
                    edge_mm, 10, {"EXX": np.linspace(0.0, um_m * edge_mm / 1000.0, 11)}
                ),
                edge_mm / 10,
            )
            == code
        )


class TestSlope:
    @given(st.floats(0.01, 5000.0))
    def test_far_apart_it_is_the_slope_of_guideways_and_close_together_that_of_noise(
        self, apart_mm
    ):
        assert plausible_slope_um_mm(apart_mm) == pytest.approx(0.8 + 6.0 / apart_mm)

    @pytest.mark.parametrize(
        ("edge_mm", "n", "code"), [(500.0, 10, "slope-steep"), (60.0, 20, None)]
    )
    def test_noise_of_2_um_is_steep_nowhere_but_50_um_are(self, edge_mm, n, code):
        noise = 2.0 * (np.arange(n + 1) % 2)
        assert refused(machine_of(edge_mm, n, {"EXX": noise}), edge_mm / n) is None
        if code is not None:
            assert refused(machine_of(edge_mm, n, {"EXX": 25.0 * noise}), edge_mm / n) == code

    def test_a_finer_table_does_not_make_an_outlier_plausible(self):
        """A bump of 51 µm at a target between others 50 mm beside it is one at points every 5 mm
        too."""
        bump = [0.0, 0.0, 0.0, 0.0, 0.0, 51.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        assert refused(machine_of(500.0, 10, {"EXX": bump}), 5.0) == "slope-steep"


@settings(max_examples=25)
@given(st.floats(60.0, 5000.0), st.integers(2, 40), st.integers(0, 2**32 - 1))
def test_no_ordinary_machine_is_refused_for_its_size(edge_mm, n, seed):
    """Scale 40 µm/m, squareness 60 urad, shapes of 10 µm and 1 µm of scatter at every value: twice
    the usual sizes of the class."""
    draw, at = np.random.default_rng(seed), np.linspace(0.0, 1.0, n + 1)
    values = {}
    for name in DISPLACEMENTS:
        slope_um = (
            draw.uniform(-1.0, 1.0)
            * (40.0 if name[1] == name[2] else 60.0)
            * edge_mm
            / 1000.0
        )
        shape_um = draw.uniform(-10.0, 10.0) * min(1.0, edge_mm / 500.0)
        values[name] = (
            slope_um * at + shape_um * np.sin(np.pi * at) + draw.uniform(-1.0, 1.0, n + 1)
        )
        values[name] -= values[name][0]
    assert refused(machine_of(edge_mm, n, values), edge_mm / n) is None
