"""Ordinary machines and shops: drawn within their table, the same for the same seed, with a truth
that their readings support."""

import ast
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import testkit.ordinary
from stepdiag.virtual.drive.registers import PositionRegisters
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.physics.environment import Course, Environment
from stepdiag.virtual.physics.error_functions import (
    AXES,
    ROTATIONS,
    Amplitudes,
    ErrorSet,
    Table,
    random_errors,
)
from stepdiag.virtual.physics.growth import Growth
from stepdiag.virtual.physics.machine import Machine
from testkit.ordinary.arrivals import Scatter
from testkit.ordinary.machines import (
    CHAINS,
    FIGURES,
    LARGEST_ANGLE_URAD,
    QUALITIES,
    REPEATABILITY_UM,
    REVERSAL_UM,
    SHARES,
    draw_machine,
)
from testkit.ordinary.shop import (
    NOISE_UM,
    RUNS,
    Beam,
    Shop,
    draw_shop,
    drive_survey,
    mean_machine,
)

SIZE_MM = (300.0, 200.0, 100.0)
BOX = Box(size_mm=SIZE_MM, increments=3)
PERFECT = Machine(errors=ErrorSet(low_mm=BOX.origin_mm, size_mm=SIZE_MM))
STILL = Beam(noise_um=0.0, largest_mrad=0.0)
POINTS = np.random.default_rng(3).uniform(size=(40, 3)) * SIZE_MM


def drawn(seed, **options):
    rng = np.random.default_rng(seed)
    machine = draw_machine(rng, **options)
    return machine, draw_shop(rng, machine)


@pytest.fixture(scope="module")
def many():
    return [drawn(seed) for seed in range(300)]


def test_ordinary_machines_share_no_code_with_what_they_prove():
    """They stand outside the program, where its contract of layers does not reach: of the program
    they import the virtual machine alone."""
    files = sorted(Path(testkit.ordinary.__path__[0]).glob("*.py"))
    nodes = [
        node
        for file in files
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
    ]
    imported = {node.module for node in nodes if isinstance(node, ast.ImportFrom)} | {
        name.name for node in nodes if isinstance(node, ast.Import) for name in node.names
    }
    allowed = ("stepdiag.virtual.", "testkit.ordinary.")
    assert len(files) > 1
    assert {
        name
        for name in imported
        if not f"{name}.".startswith(allowed)
        and name.split(".")[0] not in {"numpy", *sys.stdlib_module_names}
    } == set()


def test_every_figure_has_a_mark_and_a_source():
    for name, figure in FIGURES.items():
        assert figure.good <= figure.ordinary <= figure.poor, name
        assert figure.source, name


def test_the_classes_have_their_shares(many):
    for quality, share in zip(QUALITIES, SHARES, strict=True):
        assert np.mean([machine.quality == quality for machine, _ in many]) == pytest.approx(
            share, abs=0.08
        )


def test_machines_lie_within_the_table(many):
    for machine, shop in many:
        errors = machine.machine.errors
        assert all(300.0 <= length <= 1000.0 for length in errors.size_mm)
        assert machine.machine.chain in CHAINS
        assert all(
            REPEATABILITY_UM[0] <= um <= REPEATABILITY_UM[1]
            for um in machine.repeatability_um
        )
        assert 5 <= shop.box.increments <= 20
        assert shop.box.decimals in (2, 3, 4)
        assert NOISE_UM[0] <= shop.beam.noise_um <= NOISE_UM[1]
        for name in ROTATIONS:
            at = np.linspace(0.0, errors.size_mm[AXES.index(name[2])], 300)
            assert np.ptp(errors.functions[name](at)) <= LARGEST_ANGLE_URAD + 0.1
        for letter in AXES:
            lost = -errors.reversal[f"E{letter}{letter}"](np.zeros(1))[0]
            assert REVERSAL_UM[0] <= lost <= REVERSAL_UM[1]


def test_the_middle_machine_of_a_class_has_the_size_of_the_table(many):
    ordinary = [machine for machine, _ in many if machine.quality == "ordinary"]
    ranges = [
        np.ptp(
            one.machine.errors.functions[name](
                np.linspace(0.0, one.machine.errors.size_mm[AXES.index(name[2])], 300)
            )
        )
        for one in ordinary
        for name in ROTATIONS
    ]
    assert np.median(ranges) == pytest.approx(FIGURES["angle"].ordinary, rel=0.15)
    assert np.median([one.repeatability_um for one in ordinary]) == pytest.approx(
        FIGURES["repeatability"].ordinary, rel=0.15
    )


def test_shops_differ_in_all_that_matters(many):
    shops = [shop for _, shop in many]
    assert {shop.overrun for shop in shops} == {"always", "turns", "never"}
    assert {shop.registers.shows for shop in shops} == {"commanded", "actual"}
    assert {shop.passes for shop in shops} == {1, 2, 4, 6}
    assert {shop.box.incremental for shop in shops} == {True, False}
    assert {machine.feedback for machine, _ in many} == {"screw", "scale"}
    assert any(max(shop.scatter.servo_um) for shop in shops)
    assert any(shop.registers.scatter_um for shop in shops)


def test_the_quality_may_be_stated_and_the_machine_be_large():
    machine, _ = drawn(4, quality="poor", large=True)
    assert machine.quality == "poor"
    assert all(1000.0 <= length <= 4000.0 for length in machine.machine.errors.size_mm)


def test_the_same_seed_draws_the_same_survey():
    one, other = (
        drive_survey(machine.machine, shop) for machine, shop in (drawn(7), drawn(7))
    )
    assert one.reading_mm.tolist() == other.reading_mm.tolist()
    assert one.position_mm.tolist() == other.position_mm.tolist()


def test_the_growth_of_the_first_hour_is_that_of_the_table():
    machines = [
        draw_machine(np.random.default_rng(seed), quality="ordinary") for seed in range(200)
    ]
    hour = [
        one.machine.growth.um_m[axis]
        * 0.5
        * one.machine.growth.share(np.array([3600.0 - one.machine.growth.begun_s]))[0]
        for one in machines
        if one.feedback == "screw"
        for axis in range(3)
    ]
    assert np.median(hour) == pytest.approx(0.65 * FIGURES["growth"].ordinary, rel=0.2)


def test_an_axis_grows_from_its_bearing():
    """20 µm/m in the end, a third of an hour's time constant: after one time constant 63 % of it,
    500 mm from the bearing."""
    grown = Growth(um_m=(20.0, 0.0, 0.0), bearing_mm=(-100.0, 0.0, 0.0), tau_s=1200.0)
    errors = ErrorSet(low_mm=(0.0, 0.0, 0.0), size_mm=(500.0, 400.0, 300.0))
    machine = Machine(errors=errors, growth=grown)
    error = machine.error_at(np.array([[400.0, 100.0, 100.0]]), time_s=1200.0)
    assert error[0] == pytest.approx([20.0 * 0.5 * (1.0 - np.exp(-1.0)), 0.0, 0.0], abs=1e-6)
    assert machine.error_at(np.array([[-100.0, 0.0, 0.0]]), time_s=1e6)[
        0, 0
    ] == pytest.approx(0.0, abs=1e-9)


def test_the_mean_machine_is_the_machine_at_a_moment_where_all_readings_are_of_that_moment():
    errors = random_errors(5, (0.0, 0.0, 0.0), SIZE_MM, Amplitudes(angle_urad=15.0))
    lost = replace(errors, reversal={"EXX": Table((0.0,), (-6.0,))})
    grown = Growth(um_m=(20.0, 10.0, 5.0), bearing_mm=(-100.0, 300.0, 0.0), tau_s=1000.0)
    hall = Environment(material_c=Course(start=21.0, per_hour=1.0))
    machine = Machine(
        errors=lost,
        chain="XYFZ",
        growth=grown,
        environment=hall,
        expansion_um_m_c=(11.7, 10.0, 9.0),
    )
    mean = mean_machine(machine, np.full(7, 1800.0), np.zeros(7))
    assert mean.error_at(POINTS) == pytest.approx(
        machine.error_at(POINTS, time_s=1800.0), abs=1e-4
    )


def test_the_mean_machine_holds_what_nobody_saw():
    machine = Machine(errors=PERFECT.errors, expansion_um_m_c=(10.0, 10.0, 10.0))
    mean = mean_machine(machine, np.zeros(4), np.array([0.0, 0.0, 1.0, 1.0]))
    assert mean.truth(2).scale_um_m == pytest.approx({"X": 5.0, "Y": 5.0, "Z": 5.0})


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), large=st.booleans())
def test_every_drawn_survey_is_near_its_geometry(seed, large):
    """No survey is broken: the laser's travel is the commanded one within the errors of a poor
    machine, the columns fit together."""
    machine, shop = drawn(seed, large=large)
    survey = drive_survey(machine.machine, shop)
    count = len(survey.setup)
    assert (
        len(survey.position_mm)
        == len(survey.reading_mm)
        == len(survey.time_s)
        == len(survey.zero)
        == len(survey.turned)
        == count
    )
    assert np.all(np.isfinite(survey.reading_mm))
    for setup in shop.setups:
        rows = np.flatnonzero(
            [
                name == setup and number == 1
                for name, number in zip(survey.setup, survey.pass_number, strict=True)
            ]
        )
        travel = survey.position_mm[rows] - survey.position_mm[rows[0]]
        along = travel @ (travel[-1] / np.linalg.norm(travel[-1]))
        assert np.max(np.abs(survey.reading_mm[rows] - along)) < 1e-3 * np.linalg.norm(
            travel[-1]
        )


def test_a_perfect_machine_in_a_perfect_shop_reads_its_travel():
    survey = drive_survey(PERFECT, Shop(box=BOX, beam=STILL))
    for row, setup in enumerate(survey.setup):
        first = survey.setup.index(setup)
        expected = (
            np.linalg.norm(survey.position_mm[row] - survey.position_mm[first])
            if setup in RUNS
            else None
        )
        assert expected is None or survey.reading_mm[row] == pytest.approx(expected, abs=1e-9)


def test_without_overrun_a_pass_begins_with_the_reading_at_which_the_one_before_ended():
    scatter = Scatter(arrival_um=(0.5, 0.5, 0.5), servo_um=(1.0, 1.0, 1.0))
    shop = Shop(
        box=BOX,
        passes=3,
        overrun="never",
        scatter=scatter,
        registers=PositionRegisters(shows="actual"),
    )
    survey = drive_survey(PERFECT, shop)
    turned = np.flatnonzero(survey.turned)
    assert [(survey.pass_number[row], survey.stop[row]) for row in turned[:2]] == [
        (2, 0),
        (3, 0),
    ]
    assert len(turned) == 2 * len(shop.setups)
    for row in turned:
        for column in (survey.reading_mm, survey.position_mm, survey.time_s):
            assert np.all(column[row] == column[row - 1])


def test_readings_are_relative_to_the_first_stop_of_their_count():
    for one_count in (True, False):
        survey = drive_survey(PERFECT, Shop(box=BOX, passes=2, one_count=one_count, seed=3))
        begins = [row for row, stop in enumerate(survey.stop) if stop == 0]
        zeros = [survey.reading_mm[row] == 0.0 for row in begins]
        assert all(zeros) != one_count
        assert (set(survey.zero) == {-1}) != one_count


def test_the_material_is_warmer_from_setup_to_setup_without_the_thermometer_seeing_it():
    machine = Machine(errors=PERFECT.errors, expansion_um_m_c=(10.0, 10.0, 10.0))
    survey = drive_survey(
        machine, Shop(box=BOX, beam=STILL, passes=1, setup_c=2.0, thermometer=True)
    )
    assert set(survey.temperature_c) == {20.0}
    ends = [
        row
        for row in range(len(survey.stop))
        if row + 1 == len(survey.stop) or survey.stop[row + 1] == 0
    ]
    grown = [
        1e6
        * (
            survey.reading_mm[row]
            / np.linalg.norm(
                survey.position_mm[row] - survey.position_mm[row - survey.stop[row]]
            )
            - 1.0
        )
        for row in ends
    ]
    assert np.std(grown) == pytest.approx(20.0, rel=0.7)


def test_what_moves_along_the_beam_is_drawn_for_each_pass():
    beam = Beam(noise_um=0.0, drift_um=5.0, wander_um=1.0, largest_mrad=0.0)
    still, moving = (
        drive_survey(PERFECT, Shop(box=BOX, beam=one, passes=1, setups=("ppp", "npp")))
        for one in (STILL, beam)
    )
    off = 1e3 * (moving.reading_mm - still.reading_mm)
    assert off[0] == 0.0
    assert np.max(np.abs(off)) > 0.5
