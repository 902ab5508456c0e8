"""Wang's closed form: as printed, as corrected, and where it must fail (Wang 2000; theory 3 and
11)."""

import numpy as np
import pytest

from stepdiag.base.errors import DataError
from stepdiag.base.readings.readings import make_readings, parse_readings
from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.model.vector import closure_um, diagonal_data, least_squares, wang2000
from testkit.exact.surveys import DATA, DIAGONALS, Bench, golden_shapes


def golden(name="separable"):
    return parse_readings((DATA / f"golden_stepdiag_{name}.csv").read_text(encoding="utf-8"))


def test_golden_survey_by_least_squares():
    """Theory 11: shapes to 1.8 nm, 4-term squareness 20.000 / 7.995 / -15.000 urad (xy, yz, zx;
    sign of Eq. 12), S = 6.271 um."""
    solution = least_squares(diagonal_data(lay_out(golden())))
    assert solution.theta_urad["xy"] == pytest.approx(20.000, abs=5e-4)
    assert solution.theta_urad["yz"] == pytest.approx(7.995, abs=5e-4)
    assert solution.theta_urad["zx"] == pytest.approx(-15.000, abs=5e-4)
    assert solution.scale_sum_um == pytest.approx(6.271, abs=5e-4)
    for index, (name, shape) in enumerate(golden_shapes().items()):
        axis, component = "XYZ".index(name[2]), "XYZ".index(name[1])
        assert np.max(np.abs(solution.error_um[component, axis] - shape)) < 0.002, (
            index,
            name,
        )


def test_golden_survey_as_printed():
    """Theory 11: Eq. 13 gives 30.78 / 29.55 / 2.24 urad (xy, yz, zx), because the scale sum is
    taken for squareness (E5)."""
    theta = wang2000(diagonal_data(lay_out(golden()))).theta_urad
    assert theta["xy"] == pytest.approx(30.78, abs=0.005)
    assert theta["yz"] == pytest.approx(29.55, abs=0.005)
    assert theta["zx"] == pytest.approx(2.24, abs=0.005)


def test_the_signs_of_iso_230_are_those_of_the_contract():
    """theta_xy, theta_zx, theta_yz of Eqs 12-13 are -C0Y, +B0Z, -A0Z."""
    squareness = solve(golden(), method="least-squares").squareness
    assert squareness["C0Y"].value == pytest.approx(-20.000, abs=5e-4)
    assert squareness["B0Z"].value == pytest.approx(-15.000, abs=5e-4)
    assert squareness["A0Z"].value == pytest.approx(-7.995, abs=5e-4)


def hand_made(errors_um, order="xyz"):
    """Readings of a machine with two increments of 30, 20, 60 mm per axis: d = (3, 2, 6) / 7 on
    ppp.

    ``errors_um[axis, node, component]`` is the error of an axis at its three nodes, zero at the
    first.
    """
    step = np.array([30.0, 20.0, 60.0])
    rows = []
    for setup in DIAGONALS:
        signs = np.array([1 if letter == "p" else -1 for letter in setup])
        node = np.where(signs > 0, 0, 2)
        direction = signs * step / 70.0
        nodes = [node.copy()]
        for _ in range(2):
            for letter in order:
                node["xyz".index(letter)] += signs["xyz".index(letter)]
                nodes.append(node.copy())
        actual = [
            step * at + 1e-3 * sum(errors_um[axis, at[axis]] for axis in range(3))
            for at in nodes
        ]
        rows += [
            (setup, stop, step * at, float((point - actual[0]) @ direction))
            for stop, (at, point) in enumerate(zip(nodes, actual, strict=True))
        ]
    return make_readings(
        setup=[row[0] for row in rows],
        pass_number=[1] * len(rows),
        stop=[row[1] for row in rows],
        position_mm=[row[2] for row in rows],
        reading_mm=[row[3] for row in rows],
    )


@pytest.mark.parametrize("order", ["xyz", "zxy", "yzx"])
def test_two_increments_by_hand(order):
    """With aligned mirror the printed Eqs 7 and 8 return every node value, slopes included, also
    for axes that run backwards (E7)."""
    errors = np.zeros((3, 3, 3))
    errors[:, 1:] = np.arange(1.0, 19.0).reshape(3, 2, 3) * [[[1.0], [-2.0]]]
    solution = wang2000(diagonal_data(lay_out(hand_made(errors, order))))
    assert solution.error_um == pytest.approx(errors.transpose(2, 0, 1), abs=1e-9)


def test_uniform_expansion_looks_like_squareness_to_equation_13_only():
    """Theory E5: 10 ppm on 1.0 x 0.8 x 0.5 m without any squareness reads 23.6, 47.3, 37.8 urad as
    printed, and 0 with four terms."""
    size = np.array([60.0, 40.0, 120.0])
    errors = np.zeros((3, 3, 3))
    for axis in range(3):
        errors[axis, :, axis] = 1e-2 * size[axis] * np.arange(3) / 2
    data = diagonal_data(lay_out(hand_made(errors)))
    scale_sum = 1e-2 * np.linalg.norm(size)
    x, y, z = size
    printed = {"xy": x * y, "zx": z * x, "yz": y * z}
    for plane, area in printed.items():
        assert wang2000(data).theta_urad[plane] == pytest.approx(
            1e3 * scale_sum * np.linalg.norm(size) / area
        )
        assert least_squares(data).theta_urad[plane] == pytest.approx(0.0, abs=1e-9)
    assert least_squares(data).scale_sum_um == pytest.approx(scale_sum)


def test_mirror_tilt_is_taken_for_machine_error_as_printed_and_not_by_least_squares():
    """Theory 5.1: 0.5 mrad puts hundreds of um/m of false slope on the nine functions; shapes stay
    within nanometres."""
    bench = Bench(diagonal_noise_um=0.0)
    data = diagonal_data(lay_out(bench.survey(DIAGONALS)))
    truth = bench.truth
    slopes = wang2000(data).error_um[:, :, -1] / bench.size_mm * 1e3
    assert np.max(np.abs(slopes)) > 100.0
    for name in DISPLACEMENTS:
        axis, component = "XYZ".index(name[2]), "XYZ".index(name[1])
        true = truth.errors[name] - truth.errors[name][-1] * np.linspace(0, 1, 11)
        assert np.max(np.abs(least_squares(data).error_um[component, axis] - true)) < 0.02


def test_the_closure_residual_is_noise_of_twice_a_deviation():
    """Theory E14: sigma_r = 2 sigma; nothing is left without noise, whatever the machine and the
    tilts."""
    assert (
        np.max(
            np.abs(
                closure_um(
                    diagonal_data(lay_out(Bench(diagonal_noise_um=0.0).survey(DIAGONALS)))
                )
            )
        )
        < 0.03
    )
    noisy = [
        closure_um(diagonal_data(lay_out(Bench(seed=seed).survey(DIAGONALS))))
        for seed in range(30)
    ]
    increments = np.diff(noisy, axis=2)
    assert np.std(increments) == pytest.approx(0.3 * np.sqrt(8 * 9 / 10), rel=0.1)


def test_return_passes_are_averaged_as_they_stand_at_the_same_stops():
    bench = Bench(diagonal_noise_um=0.0)
    both = diagonal_data(lay_out(bench.survey(DIAGONALS, passes=(1, 2))))
    outward = diagonal_data(lay_out(bench.survey(DIAGONALS, passes=(1,))))
    assert both.passes.tolist() == [2, 2, 2, 2]
    assert np.max(np.abs(both.by_position_um - outward.by_position_um)) < 1e-3
    assert both.end_um == pytest.approx(outward.end_um, abs=1e-3)


def test_stated_uncertainties_agree_with_the_scatter_of_many_surveys():
    """Theory 6.6: shapes from increments, squareness u = sigma_end R / (2XY)."""
    scores = {"wang2000": [], "least-squares": []}
    for seed in range(30):
        bench = Bench(seed=3, tilt_mrad=0.0)
        noise = np.random.default_rng(seed).normal(scale=3e-4, size=4 * 31)
        clean = Bench(seed=3, tilt_mrad=0.0, diagonal_noise_um=0.0).survey(DIAGONALS)
        readings = make_readings(
            setup=clean.setup,
            pass_number=clean.pass_number,
            stop=clean.stop,
            position_mm=clean.position_mm,
            reading_mm=clean.reading_mm + noise,
            u_um=np.full(len(clean), 0.3),
        )
        for method, found in scores.items():
            result = solve(readings, method=method)
            found += [
                (result.errors["EYX"].value[5] - bench.truth.errors["EYX"][5])
                / result.errors["EYX"].u[5]
            ]
            if method == "least-squares":
                found += [
                    (q.value - bench.truth.squareness_urad[name]) / q.u
                    for name, q in result.squareness.items()
                ]
    for found in scores.values():
        assert np.sqrt(np.mean(np.square(found))) == pytest.approx(1.0, abs=0.35)


@pytest.mark.parametrize("method", ["wang2000", "least-squares"])
def test_a_missing_diagonal_is_named(method):
    with pytest.raises(
        DataError,
        match="found no pnp; measure the missing diagonals, or use the method `estimate`",
    ):
        solve(Bench().survey(["ppp", "npp", "ppn"]), method=method)


def test_other_runs_are_not_used_and_that_is_said():
    found = {
        finding.key: finding
        for finding in solve(Bench().survey(), method="least-squares").findings
    }
    assert "linear-x, linear-y, linear-z" in found["method-limited.runs"].text
    assert "unidentified.sum" in found
