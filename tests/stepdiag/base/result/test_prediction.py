"""Intervals of the volumetric error against truths that they were not told: what was found is the
truth and its noise."""

import numpy as np
import pytest

from stepdiag.base.result.arches import Between
from stepdiag.base.result.field import Smoothed, Tabulated, field_of_um, without_rigid_motion
from stepdiag.base.result.posterior import Posterior
from stepdiag.base.result.prediction import predicted
from stepdiag.base.result.result import (
    DISPLACEMENTS,
    SQUARENESS,
    Function,
    Quantity,
    Result,
    Scale,
)
from stepdiag.base.volume import Vector, Volume

VOLUME = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=8)
POINTS = np.random.default_rng(3).uniform(size=(60, 3)) * np.asarray(VOLUME.size_mm)
NODES = {letter: VOLUME.nodes_mm(axis) for axis, letter in enumerate("XYZ")}
TRIALS = 40


def found(values: dict[str, Vector], u_um: float) -> Result:
    """Return a result with these values at the nodes, each inner one uncertain by itself."""
    uncertain = np.full(9, u_um)
    uncertain[[0, -1]] = 0.0
    return Result(
        volume=VOLUME,
        chain="FXYZ",
        method="test",
        setups={},
        findings=(),
        errors={
            name: Function(position_mm=NODES[name[2]], value=value, u=uncertain, unit="um")
            for name, value in values.items()
        },
        squareness={name: Quantity(value=0.0, u=0.0) for name in SQUARENESS},
        scale={letter: Scale(value=0.0, u=0.0, identified=True) for letter in "XYZ"},
        posterior=Posterior(
            position_mm=NODES,
            offset={},
            modes={},
            rest=dict.fromkeys(DISPLACEMENTS, uncertain),
            between_um={},
        ),
    )


def smooth(rng: np.random.Generator, size_um: float) -> dict[str, Vector]:
    """Return functions of two half waves of random size at the nodes."""
    share = np.linspace(0.0, 1.0, 9)
    return {
        name: size_um
        * (
            rng.normal() * np.sin(np.pi * share)
            + 0.5 * rng.normal() * np.sin(2 * np.pi * share)
        )
        for name in DISPLACEMENTS
    }


def rms_um(values: dict[str, Vector]) -> float:
    """Return the root mean square of the smooth machine at the points, without rigid motion."""
    functions = {
        name: Smoothed(NODES[name[2]], value[None, :]) for name, value in values.items()
    }
    left = without_rigid_motion(
        VOLUME, POINTS, field_of_um(VOLUME, "FXYZ", functions, {}, POINTS)[0]
    )
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


@pytest.mark.parametrize("size_um", [4.0, 8.0])
def test_what_was_found_holds_the_machine_and_not_its_noise(size_um: float) -> None:
    """The square sum of what is found is that of machine and noise: draws around it hold the noise
    twice, and no truth."""
    rng, u_um, held, above = np.random.default_rng(5), 1.5, 0, 0
    for _ in range(TRIALS):
        true = smooth(rng, size_um)
        noisy = {
            name: value + u_um * rng.normal(size=9) * np.r_[0, np.ones(7), 0]
            for name, value in true.items()
        }
        told = (
            predicted(found(noisy, u_um), POINTS, np.zeros_like(POINTS))
            .without_rigid_motion["before"]
            .rms_um
        )
        assert told.low_um is not None
        assert told.high_um is not None
        held += told.low_um <= rms_um(true) <= told.high_um
        above += rms_um(true) > told.value_um
    assert held >= 0.85 * TRIALS, held
    assert 0.25 * TRIALS <= above <= 0.75 * TRIALS, above


def test_what_is_taken_out_by_tables_is_left_with_the_noise_of_the_values_alone() -> None:
    rng, u_um = np.random.default_rng(6), 1.5
    noisy = found(smooth(rng, 8.0), u_um)
    straight = {
        name: Tabulated(one.position_mm, one.value[None, :])
        for name, one in noisy.errors.items()
        if one.value is not None
    }
    correction = -field_of_um(VOLUME, "FXYZ", straight, {}, POINTS)[0]
    before, after = (
        predicted(noisy, POINTS, change).without_rigid_motion
        for change in (np.zeros_like(POINTS), correction)
    )
    assert after["after"].rms_um.value_um < 0.6 * before["before"].rms_um.value_um
    assert before["after"].rms_um == before["before"].rms_um


@pytest.mark.parametrize("waves", [1, 2, 3])
def test_the_curve_between_the_values_keeps_the_mean_square_of_waves(waves: int) -> None:
    """At three waves on ten increments straight lines lose 39 % of it, the curve 9, most of that in
    the first and the last cell."""
    at, nodes = np.linspace(0.0, 500.0, 4001), np.linspace(0.0, 500.0, 11)
    kept = []
    for phase in np.linspace(0.0, 2 * np.pi, 12, endpoint=False):
        true, known = (np.sin(2 * np.pi * waves * x / 500.0 + phase) for x in (at, nodes))
        kept.append(
            (np.mean(Smoothed(nodes, known[None, :]).at(at)[0] ** 2), np.mean(true**2))
        )
    share = np.sum(kept, axis=0)
    assert share[0] / share[1] == pytest.approx(1.0, abs=0.1 if waves == 3 else 0.03)


def test_values_close_to_each_other_do_not_bend_the_curve() -> None:
    """Two values 3 mm from each other that differ by noise: a spline through both would swing by
    tens of um beside them."""
    nodes = np.sort(np.append(np.linspace(0.0, 500.0, 11), 253.0))
    value = np.zeros((1, 12))
    value[0, 6] = 0.5
    assert np.max(np.abs(Smoothed(nodes, value).at(np.linspace(0.0, 500.0, 2001)))) < 0.6


COARSE = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=4)
SPARSE = {letter: COARSE.nodes_mm(axis) for axis, letter in enumerate("XYZ")}
EVERYWHERE = np.random.default_rng(4).uniform(size=(300, 3)) * np.asarray(COARSE.size_mm)


def of_few_targets(values: dict[str, Vector], between_um: float) -> Result:
    """Return a result with values at five targets that are known, and arches of a known size
    between them."""
    none, sizes = np.zeros(5), np.array([between_um])
    return Result(
        volume=COARSE,
        chain="FXYZ",
        method="test",
        setups={},
        findings=(),
        errors={
            name: Function(position_mm=SPARSE[name[2]], value=value, u=none, unit="um")
            for name, value in values.items()
        },
        squareness={name: Quantity(value=0.0, u=0.0) for name in SQUARENESS},
        scale={letter: Scale(value=0.0, u=0.0, identified=True) for letter in "XYZ"},
        posterior=Posterior(
            position_mm=SPARSE,
            offset={},
            modes={},
            rest=dict.fromkeys(DISPLACEMENTS, none),
            between_um=dict.fromkeys(DISPLACEMENTS, sizes),
        ),
    )


def arched(values: dict[str, Vector], heights_um: Vector) -> Vector:
    """Return the field of functions that leave the curve through their values by an arch of its own
    height from each target to the next."""
    field = np.zeros_like(EVERYWHERE)
    for name, own in zip(values, heights_um, strict=True):
        at = EVERYWHERE[:, "XYZ".index(name[2])] / SPARSE[name[2]][1]
        share = at % 1.0
        field[:, "XYZ".index(name[1])] += own[at.astype(int)] * 4.0 * share * (1.0 - share)
    functions = {
        name: Smoothed(SPARSE[name[2]], value[None, :]) for name, value in values.items()
    }
    whole: Vector = field + field_of_um(COARSE, "FXYZ", functions, {}, EVERYWHERE)[0]
    return whole


def test_what_lies_between_few_targets_goes_along_with_what_was_found_or_against_it() -> None:
    """36 arches have a sign each: counted as a mean square, as if every point had its own, no
    machine of 40 lies in its interval."""
    rng, held, above = np.random.default_rng(9), 0, 0
    for _ in range(TRIALS):
        values = {
            name: np.append(0.0, 6.0 * rng.standard_normal(4)) for name in DISPLACEMENTS
        }
        field = without_rigid_motion(
            COARSE, EVERYWHERE, arched(values, 2.0 * rng.standard_normal((9, 4)))
        )
        true_um = float(np.sqrt(np.mean(np.sum(field**2, axis=1))))
        told = (
            predicted(of_few_targets(values, 2.0), EVERYWHERE, np.zeros_like(EVERYWHERE))
            .without_rigid_motion["before"]
            .rms_um
        )
        assert told.low_um is not None
        assert told.high_um is not None
        held += told.low_um <= true_um <= told.high_um
        above += true_um > told.value_um
    assert held >= 0.9 * TRIALS, held
    assert 0.25 * TRIALS <= above <= 0.75 * TRIALS, above


def test_between_many_targets_the_signs_cancel() -> None:
    """Sixteen times as many arches of the same size move the mean square by a quarter."""
    widths = []
    for cells in (4, 64):
        nodes = np.linspace(0.0, 500.0, cells + 1)
        at = np.clip(np.searchsorted(nodes, EVERYWHERE[:, 0], side="right") - 1, 0, cells - 1)
        between = Between(
            np.ones((1, len(EVERYWHERE))),
            at[None, :],
            np.zeros(1, dtype=np.int64),
            np.ones((2000, 1)),
        )
        widths.append(
            float(np.std(between.across_um2(between.met(np.ones((1, 3 * len(EVERYWHERE)))))))
        )
    assert widths[1] == pytest.approx(widths[0] / 4.0, rel=0.15)


def test_deviations_are_the_offset_the_modes_and_the_rest_value_by_value():
    """What a function has none of is nothing there, also beside one that has."""
    two, one = np.array([1.0, 2.0]), np.array([5.0])
    posterior = Posterior(
        position_mm=NODES,
        offset={"EXX": two},
        modes={"EYX": np.array([[3.0, 4.0]])},
        rest={"EYX": 0.5 * two, "C0Y": one},
        between_um={},
    )
    found = posterior.deviations()
    assert found["EXX"].tolist() == [[1.0, 2.0], *[[0.0, 0.0]] * 4]
    assert found["EYX"].tolist() == [
        [0.0, 0.0],
        [3.0, 4.0],
        [0.5, 0.0],
        [0.0, 1.0],
        [0.0, 0.0],
    ]
    assert found["C0Y"].tolist() == [[0.0], [0.0], [0.0], [0.0], [5.0]]
