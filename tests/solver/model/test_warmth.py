"""A machine that warms during a survey: the thermometer on it brings all readings to one
temperature."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.model.warmth import at_one_temperature
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench

WARMER_C = dict(zip((*DIAGONALS, *LINEAR), np.linspace(0.0, 1.2, 7), strict=True))


def warmed(readings, *, told):
    """Return a survey whose machine warms by 0.2 K from setup to setup, with the thermometer's
    values where ``told``."""
    layout = lay_out(readings)
    setup = np.array([layout.setups[int(index)].name for index in layout.setup_index])
    warmer = np.array([WARMER_C[name] for name in setup])
    first = np.unique(layout.zero_index, return_index=True)[1]
    way_m = 1e-3 * np.linalg.norm(
        layout.position_mm - layout.position_mm[first][layout.zero_index], axis=1
    )
    along = np.sum(
        (layout.position_mm - layout.position_mm[first][layout.zero_index])
        * layout.direction,
        axis=1,
    )
    assert np.all(np.abs(along) <= 1e3 * way_m + 1e-9)
    grown = 11.7e-3 * along * warmer
    known = 20.0 + warmer if told else np.full(len(warmer), np.nan)
    return layout, replace(
        layout, deviation_um=layout.deviation_um + grown, temperature_c=known
    )


def test_readings_are_brought_to_the_mean_temperature_of_the_survey():
    cold, warm = warmed(Bench(increments=4).survey(), told=True)
    levelled = at_one_temperature(warm, Assumptions())
    mean = np.mean(warm.temperature_c) - 20.0
    first = np.unique(cold.zero_index, return_index=True)[1]
    along = np.sum(
        (cold.position_mm - cold.position_mm[first][cold.zero_index]) * cold.direction, axis=1
    )
    assert levelled.deviation_um == pytest.approx(
        cold.deviation_um + 11.7e-3 * along * mean, abs=1e-6
    )
    assert [
        finding.code
        for finding in levelled.findings
        if finding.code == "temperature-levelled"
    ] == ["temperature-levelled"]


@pytest.mark.parametrize("assumed", [Assumptions(), Assumptions(reduced_to_20_c=True)])
def test_nothing_is_taken_off_that_is_not_known_or_was_taken_off_before(assumed):
    _, warm = warmed(Bench(increments=4).survey(), told=assumed.reduced_to_20_c)
    assert at_one_temperature(warm, assumed) is warm
