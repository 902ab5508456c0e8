"""Two effects of a survey, in its time and its registers: axes that grow, and positions that
scatter where the machine stands still."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.solver.model.effects import (
    GROWTH,
    TIME_CONSTANTS_H,
    angle_shapes,
    effects_of,
    growth_waves,
)
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import Bench

READINGS = Bench(seed=1, increments=4).survey(passes=(1, 2))


def effects(readings, **assumed):
    layout, usual = lay_out(readings), Assumptions(**assumed)
    return {
        effect.name: effect
        for effect in effects_of(layout, "FXYZ", angle_shapes(layout, {}, usual), usual)
    }


def test_growth_is_about_the_mean_of_the_survey_and_settles():
    waves = growth_waves(lay_out(READINGS))
    assert waves.shape == (len(READINGS), len(TIME_CONSTANTS_H))
    assert np.mean(waves, axis=0) == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.argmax(waves, axis=0) == np.argmin(lay_out(READINGS).hours))
    steps = np.abs(np.diff(waves[np.argsort(lay_out(READINGS).hours)], axis=0))
    assert np.sum(steps[: len(steps) // 2]) > np.sum(steps[len(steps) // 2 :])


def test_growth_lengthens_each_axis_along_its_travel_and_moves_it_by_its_bearing():
    """Of k time constants: k columns an axis for its length, k for its bearing, 20 µm/m usual."""
    layout, growth = lay_out(READINGS), effects(READINGS)[GROWTH]
    assert growth.sought
    assert growth.count == 6 * len(TIME_CONSTANTS_H)
    run = np.flatnonzero(
        layout.setup_index == [setup.name for setup in layout.setups].index("linear-x")
    )
    own, others = (
        growth.pattern_um[run][:, : len(TIME_CONSTANTS_H)],
        growth.pattern_um[run][:, len(TIME_CONSTANTS_H) : 3 * len(TIME_CONSTANTS_H)],
    )
    along_m = 1e-3 * (layout.position_mm[run, 0] - layout.volume.origin_mm[0])
    assert own == pytest.approx(20.0 * along_m[:, None] * growth_waves(layout)[run])
    assert not np.any(others)


@pytest.mark.parametrize(
    "change",
    [{"time_s": np.full(len(READINGS), np.nan)}, {"time_s": np.full(len(READINGS), 5.0)}],
)
def test_without_times_there_is_no_growth_to_tell(change):
    assert GROWTH not in effects(replace(READINGS, **change))


def test_a_machine_that_is_said_not_to_grow_has_none():
    assert GROWTH not in effects(READINGS, growth_um_m=0.0)


def reported_beside(moves_um, stops_um):
    """Return the readings with positions that scatter from move to move, and from stop to stop
    while an axis stands."""
    layout, rng = lay_out(READINGS), np.random.default_rng(1)
    order = np.concatenate(list(READINGS.passes().values()))
    moved_mm = 1e-3 * moves_um * rng.normal(size=int(layout.arrival.max()) + 2)
    position = READINGS.position_mm + 1e-3 * stops_um * rng.normal(
        size=READINGS.position_mm.shape
    )
    position[order] += np.where(layout.arrival >= 0, moved_mm[layout.arrival], 0.0)
    return replace(READINGS, position_mm=position)


def test_registers_that_scatter_from_stop_to_stop_may_do_so_alone():
    """One amount for the scatter while an axis stands, which cannot be the machine, and one for
    what its moves end beside each other by."""
    readings = reported_beside(0.0, 1.0)
    layout, pattern = lay_out(readings), effects(readings)["registers"].pattern_um
    assert pattern.shape[1] == 2
    along_um = np.sum(layout.beside_mm * layout.direction, axis=1) * 1e3
    assert np.corrcoef(np.sum(pattern, axis=1), -along_um)[0, 1] > 0.8


def test_registers_that_stay_as_long_as_the_axis_stands_have_one_amount():
    assert effects(reported_beside(1.0, 0.0))["registers"].count == 1


def test_a_rounded_program_is_no_scatter_of_registers():
    """The same at each target, and in G91 a straight line of each pass."""
    rounded = replace(
        READINGS, position_mm=READINGS.position_mm + 1e-3 * np.sin(READINGS.position_mm)
    )
    grown = replace(READINGS, position_mm=READINGS.position_mm * (1.0 + 1e-5))
    assert "registers" not in effects(rounded)
    assert "registers" not in effects(grown)


def test_commanded_positions_have_no_scatter_of_registers():
    assert "registers" not in effects(READINGS)
