"""The virtual machine against first principles, the theory notes and readings made by another
program."""

import csv
from pathlib import Path

import numpy as np
import pytest

from stepdiag.virtual.drive.sequence import (
    Box,
    driven_pass,
    outward_direction,
    outward_stops_mm,
    register_of,
)
from stepdiag.virtual.drive.setups import Alignment, aligned_setup
from stepdiag.virtual.physics.air import refractive_index, saturation_pressure_pa
from stepdiag.virtual.physics.environment import Course, Environment
from stepdiag.virtual.physics.error_functions import (
    AXES,
    Amplitudes,
    ErrorSet,
    Table,
    random_errors,
)
from stepdiag.virtual.physics.machine import Machine
from testkit.ordinary.measured import Conditions, simulate_pass

DATA = Path(__file__).parents[2] / "data"
LOW, SIZE = (0.0, 0.0, 0.0), (500.0, 400.0, 300.0)
BOX = Box(origin_mm=LOW, size_mm=SIZE, increments=10)
PERFECT = ErrorSet(low_mm=LOW, size_mm=SIZE)


def rows(name):
    lines = [
        line
        for line in (DATA / name).read_text(encoding="utf-8").splitlines()
        if not line.startswith("#")
    ]
    return list(csv.DictReader(lines))


def golden_errors(*, angles: bool) -> ErrorSet:
    """The machine behind the golden surveys: tables at the eleven nodes of each axis."""
    functions = {}
    sources = [("expected", "true_um"), ("angular_truth", "urad")][: 2 if angles else 1]
    for name, unit in sources:
        for row in rows(f"golden_stepdiag_{name}.csv"):
            key = f"E{row['component'].upper()}{row['axis']}"
            length = {"X": 1000.0, "Y": 800.0, "Z": 500.0}[row["axis"]]
            positions, values = functions.setdefault(key, ([], []))
            positions.append(length * int(row["node"]) / 10)
            values.append(float(row[unit]))
    tables = {
        name: Table(tuple(position), tuple(value))
        for name, (position, value) in functions.items()
    }
    return ErrorSet(low_mm=LOW, size_mm=(1000.0, 800.0, 500.0), functions=tables)


@pytest.mark.parametrize(
    ("survey", "angles"), [("separable", False), ("rigidbody_FXYZ", True)]
)
@pytest.mark.parametrize("diagonal", ["ppp", "npp", "pnp", "ppn"])
def test_the_golden_surveys_are_reproduced_to_a_nanometre(survey, angles, diagonal):
    """Readings of another exact simulation (theory 11): 31 readings, only the two unknown tilts of
    each set-up are fitted."""
    golden = [
        row for row in rows(f"golden_stepdiag_{survey}.csv") if row["diagonal"] == diagonal
    ]
    wanted = np.array([float(row["reading_mm"]) for row in golden])
    box = Box(size_mm=(1000.0, 800.0, 500.0), increments=10)
    machine = Machine(errors=golden_errors(angles=angles))

    def reading(tilt):
        taken = simulate_pass(
            machine,
            box,
            diagonal,
            alignment=Alignment(mirror_mrad=tuple(tilt), beam_mrad=tuple(tilt)),
        )
        return taken.reading_mm

    stops = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in golden])
    assert np.allclose(driven_pass(box, diagonal, 1).stop_mm, stops)
    tilt = np.zeros(2)
    for _ in range(4):
        jacobian = np.stack(
            [(reading(tilt + step) - reading(tilt)) / 1e-3 for step in 1e-3 * np.eye(2)],
            axis=1,
        )
        tilt = tilt + np.linalg.lstsq(jacobian, wanted - reading(tilt), rcond=None)[0]
    assert np.hypot(*tilt) == pytest.approx(0.4, abs=0.01)
    assert np.max(np.abs(reading(tilt) - wanted)) < 1e-6


ARMS = {
    "FXYZ": ([0, 1, 1], [0, 0, 1], [0, 0, 0]),
    "XFYZ": ([1, 1, 1], [0, 0, 1], [0, 0, 0]),
    "XYFZ": ([1, 1, 1], [0, 1, 1], [0, 0, 0]),
    "XYZF": ([1, 1, 1], [0, 1, 1], [0, 0, 1]),
    "FYXZ": ([0, 0, 1], [1, 0, 1], [0, 0, 0]),
    "YFXZ": ([0, 0, 1], [1, 1, 1], [0, 0, 0]),
}


@pytest.mark.parametrize("chain", ARMS)
def test_the_exact_chain_has_the_abbe_arms_of_the_theory(chain):
    """Theory 2.2: E(P) = sum of delta_a + alpha_a x (r_a + t); the exact composition differs by
    products of errors only."""
    errors = random_errors(3, LOW, SIZE, Amplitudes(angle_urad=20.0))
    offset = np.array([10.0, -20.0, -120.0])
    machine = Machine(errors=errors, chain=chain, tool_offset_mm=tuple(offset))
    points = np.random.default_rng(1).uniform(LOW, SIZE, size=(200, 3))
    expected = np.zeros((200, 3))
    for axis, arm in enumerate(ARMS[chain]):
        still = np.zeros(200)
        alpha = errors.rotation_urad(axis, points[:, axis], still)
        lever_m = (points * arm + offset) * 1e-3
        expected += errors.displacement_um(axis, points[:, axis], still) + np.cross(
            alpha, lever_m
        )
    assert np.max(np.abs(expected)) > 15.0
    assert np.max(np.abs(machine.error_at(points) - expected)) < 0.003


def test_squareness_moves_the_tool_as_the_contract_says():
    """Contract 1: dX = -C0Y y, dX = +B0Z z, dY = -A0Z z."""
    errors = ErrorSet(
        low_mm=LOW, size_mm=SIZE, squareness_urad={"C0Y": 20.0, "B0Z": 30.0, "A0Z": 50.0}
    )
    error = Machine(errors=errors).error_at(np.array([[500.0, 400.0, 300.0]]))[0]
    assert error == pytest.approx([-20.0 * 0.4 + 30.0 * 0.3, -50.0 * 0.3, 0.0], abs=1e-9)


def test_truth_moves_the_slopes_of_straightness_into_the_squareness():
    """A slope of EXY is a tilted Y axis: Y = (s, 1, 0) and C0Y = -s."""
    tables = {
        "EXY": Table((0.0, 400.0), (0.0, 8.0)),
        "EYX": Table((0.0, 250.0, 500.0), (0.0, 3.0, 5.0)),
    }
    truth = ErrorSet(low_mm=LOW, size_mm=SIZE, functions=tables, squareness_urad={"C0Y": 7.0})
    found = Machine(errors=truth).truth(10)
    assert found.squareness_urad["C0Y"] == pytest.approx(7.0 - 20.0 - 10.0)
    assert found.errors["EXY"] == pytest.approx(0.0)
    assert found.errors["EYX"][[0, 5, 10]] == pytest.approx([0.0, 0.5, 0.0])


def test_truth_keeps_the_slope_of_positioning():
    errors = ErrorSet(
        low_mm=(-100.0, 0.0, 0.0),
        size_mm=SIZE,
        functions={"EXX": Table((-100.0, 400.0), (2.0, 12.0))},
    )
    truth = Machine(errors=errors).truth(5)
    assert truth.errors["EXX"] == pytest.approx([0.0, 2.0, 4.0, 6.0, 8.0, 10.0])
    assert truth.scale_um_m["X"] == pytest.approx(20.0)
    assert truth.position_mm["X"][0] == -100.0


def deviation_um(taken, direction):
    nominal = (taken.position_mm - taken.position_mm[0]) @ direction
    return (taken.reading_mm - nominal) * 1e3


def test_a_tilted_mirror_shifts_every_step_and_no_whole_cycle():
    """Theory 4.2: to first order each step changes by nu.(e_a step), and the three sum to zero; the
    ray sees no end effect."""
    tilted = simulate_pass(
        Machine(errors=PERFECT), BOX, "ppp", alignment=Alignment(mirror_mrad=(0.5, -0.3))
    )
    deviation = deviation_um(tilted, outward_direction(BOX, "ppp"))
    assert np.max(np.abs(deviation)) > 10.0
    assert np.max(np.abs(deviation[::3])) < 1e-6


def test_a_misaligned_beam_is_a_second_order_matter():
    """Theory 4.2: 1 mrad on a diagonal of R mm lengthens the ray to the mirror by R beta^2 / 2 at
    its end."""
    taken = simulate_pass(
        Machine(errors=PERFECT), BOX, "npp", alignment=Alignment(beam_mrad=(1.0, 0.0))
    )
    deviation = deviation_um(taken, outward_direction(BOX, "npp"))
    assert deviation[-1] == pytest.approx(np.linalg.norm(SIZE) * 0.5e-6 * 1e3, rel=1e-3)
    assert np.max(np.abs(np.diff(deviation))) < 0.03


def test_mirror_flatness_gives_the_same_three_values_in_every_cycle():
    """Theory 4.2: the spot visits the same three places of the mirror in every cycle."""
    flat = simulate_pass(
        Machine(errors=PERFECT), BOX, "pnp", alignment=Alignment(flatness_um=0.3)
    )
    deviation = deviation_um(flat, outward_direction(BOX, "pnp"))
    assert np.max(np.abs(deviation)) > 0.02
    for phase in range(3):
        assert np.ptp(deviation[phase::3]) < 1e-6


def test_a_corner_cube_does_not_see_rotations_about_its_vertex():
    tables = {
        "EBX": Table((0.0, 500.0), (0.0, 50.0)),
        "ECX": Table((0.0, 500.0), (0.0, -80.0)),
    }
    machine = Machine(errors=ErrorSet(low_mm=LOW, size_mm=SIZE, functions=tables))
    at_tool = simulate_pass(machine, BOX, "linear-x")
    offset = simulate_pass(
        machine, BOX, "linear-x", alignment=Alignment(target_mm=(0.0, 0.0, -100.0))
    )
    assert deviation_um(at_tool, np.eye(3)[0]) == pytest.approx(0.0, abs=1e-6)
    assert deviation_um(offset, np.eye(3)[0])[-1] == pytest.approx(-50.0 * 0.1, abs=0.001)


def test_a_laser_on_the_floor_does_not_see_the_axes_that_carry_the_work():
    machine = Machine(errors=PERFECT, chain="XYFZ")
    taken = simulate_pass(machine, BOX, "ppp", alignment=Alignment(stand="floor"))
    expected = (taken.position_mm[:, 2] - taken.position_mm[0, 2]) * outward_direction(
        BOX, "ppp"
    )[2]
    assert taken.reading_mm == pytest.approx(expected, abs=1e-9)


def test_reversal_splits_about_the_mean():
    errors = ErrorSet(
        low_mm=LOW, size_mm=SIZE, reversal={"EXX": Table((0.0, 500.0), (-4.0, -6.0))}
    )
    machine = Machine(errors=errors)
    point = np.array([[250.0, 0.0, 0.0]])
    forward, backward, mean = (
        machine.error_at(point, direction=np.array([d, 1.0, 1.0]))[0, 0]
        for d in (1.0, -1.0, 0.0)
    )
    assert (forward, backward, mean) == pytest.approx((-2.5, 2.5, 0.0))


def test_a_warm_machine_is_longer_by_its_coefficient():
    warm = Environment(material_c=Course(start=22.0, per_hour=1.0))
    machine = Machine(errors=PERFECT, expansion_um_m_c=(11.7, 0.0, 0.0), environment=warm)
    error = machine.error_at(np.array([[500.0, 400.0, 300.0]]), time_s=3600.0)[0]
    assert error == pytest.approx([11.7 * 3.0 * 0.5, 0.0, 0.0], abs=1e-9)


def test_drift_moves_the_tool_with_time():
    machine = Machine(errors=PERFECT, drift_um_h=(0.0, 0.0, 6.0))
    taken = simulate_pass(
        machine, BOX, "linear-z", conditions=Conditions(seconds_per_stop=360.0)
    )
    assert deviation_um(taken, np.eye(3)[2])[-1] == pytest.approx(6.0, abs=1e-6)


NIST = [
    (20.0, 101325.0, 50.0, 321.456, 1.000283543),
    (20.0, 101325.0, 50.0, 1700.0, 1.000268041),
    (-20.0, 101325.0, 50.0, 633.0, 1.00031489),
    (20.0, 101325.0, 50.0, 633.0, 1.000271373),
    (26.7982, 101325.0, 50.0, 633.0, 1.000264994),
    (60.45, 101325.0, 50.0, 633.0, 1.000235516),
    (20.0, 10000.0, 50.0, 633.0, 1.000026385),
    (20.0, 140000.0, 50.0, 633.0, 1.000375169),
    (20.0, 101325.0, 0.0, 633.0, 1.0002718),
    (20.0, 101325.0, 100.0, 633.0, 1.000270949),
]


@pytest.mark.parametrize(("t", "p", "rh", "nm", "index"), NIST)
def test_air_index_is_that_of_the_nist_page(t, p, rh, nm, index):
    """NIST Engineering Metrology Toolbox, Ciddor, CO2 450 ppm (instruments.md 3)."""
    assert refractive_index(t, p / 100.0, rh, nm) == pytest.approx(index, abs=1.1e-8)


def test_saturation_pressure_at_twenty_degrees():
    """IAPWS value as computed in instruments.md 3."""
    assert saturation_pressure_pa(20.0) == pytest.approx(2339.2148, abs=1e-3)


def test_an_uncompensated_laser_reads_the_optical_length_and_its_dead_path_breathes():
    falling = Environment(pressure_hpa=Course(start=1013.25, per_hour=-5.0))
    machine = Machine(errors=PERFECT, environment=falling)
    setup = aligned_setup(
        machine, BOX, "linear-x", Alignment(assumed_index=1.0, standoff_mm=1000.0)
    )
    still = np.zeros((2, 3))
    indicated = machine.indicated_mm(setup, still, time_s=np.array([0.0, 3600.0]))
    assert indicated[0] == pytest.approx(1000.0 * refractive_index(20.0, 1013.25, 50.0))
    assert (indicated[1] - indicated[0]) * 1e3 == pytest.approx(
        1000.0 * 1e3 * 0.268e-6 * -5.0, rel=0.01
    )


def test_random_machines_are_repeatable_and_as_large_as_asked():
    first, again = (
        random_errors(7, LOW, SIZE, Amplitudes(straightness_um=6.0, angle_urad=10.0))
        for _ in range(2)
    )
    nodes = np.linspace(0.0, 500.0, 501)
    for name in ("EYX", "EZX"):
        assert np.max(np.abs(first.functions[name](nodes))) == pytest.approx(6.0, rel=1e-3)
    for name in (f"E{c}{a}" for a in AXES for c in "ABC"):
        values = first.functions[name](np.linspace(0.0, SIZE[AXES.index(name[2])], 501))
        assert values[0] == 0.0
        assert 2.0 < np.max(np.abs(values)) <= 10.0
        assert np.array_equal(
            values, again.functions[name](np.linspace(0.0, SIZE[AXES.index(name[2])], 501))
        )


def test_stops_visit_the_corners_of_the_box_in_steps():
    """Contract 1: ``n`` axes start at their high end, one axis moves at a time, 3n+1 stops, the
    return pass in reverse."""
    box = Box(origin_mm=(10.0, 20.0, 30.0), size_mm=(4.0, 6.0, 8.0), increments=2)
    expected = [
        (10, 26, 30),
        (12, 26, 30),
        (12, 23, 30),
        (12, 23, 34),
        (14, 23, 34),
        (14, 20, 34),
        (14, 20, 38),
    ]
    assert outward_stops_mm(box, "pnp") == pytest.approx(np.array(expected, dtype=float))
    assert outward_stops_mm(box, "pnp", "zxy")[1] == pytest.approx([10.0, 26.0, 34.0])
    back = driven_pass(box, "pnp", 2)
    assert back.stop_mm == pytest.approx(np.array(expected[::-1], dtype=float))
    assert back.approach == pytest.approx([-1.0, 1.0, -1.0])


def test_setups_have_the_numbers_of_the_contract_and_no_others():
    assert [register_of(name) for name in ("ppp", "ppn+2", "linear-y", "fourdof-z")] == [
        1,
        4,
        12,
        23,
    ]
    with pytest.raises(ValueError, match="found 'nnn'"):
        register_of("nnn")


def test_a_chain_must_name_every_axis_once():
    with pytest.raises(ValueError, match="found 'XYZ'"):
        Machine(errors=PERFECT, chain="XYZ")
