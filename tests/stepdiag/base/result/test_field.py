"""The error field of a result against the written-out chain of the theory and against exact rigid
motions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.result import (
    DISPLACEMENTS,
    ROTATIONS,
    SQUARENESS,
    Function,
    Quantity,
    Result,
    Scale,
)
from stepdiag.base.volume import Volume

VOLUME = Volume(origin_mm=(10.0, -20.0, 5.0), size_mm=(500.0, 400.0, 300.0), increments=4)


def a_result(
    chain: str, values: dict[str, np.ndarray], squareness: dict[str, float]
) -> Result:
    nodes = {letter: VOLUME.nodes_mm(axis) for axis, letter in enumerate("XYZ")}
    errors = {
        name: Function(
            position_mm=nodes[name[2]],
            value=values.get(name),
            u=None,
            unit="um" if name in DISPLACEMENTS else "urad",
        )
        for name in (*DISPLACEMENTS, *ROTATIONS)
    }
    return Result(
        volume=VOLUME,
        chain=chain,
        method="test",
        errors=errors,
        setups={},
        findings=(),
        squareness={
            name: Quantity(value=squareness.get(name), u=None) for name in SQUARENESS
        },
        scale={letter: Scale(value=None, u=None, identified=False) for letter in "XYZ"},
    )


def test_squareness_displaces_as_the_contract_says() -> None:
    """Contract 1: dX = -C0Y y, dX = +B0Z z, dY = -A0Z z, from the low corner."""
    corner = np.array([[510.0, 380.0, 305.0]])
    each = {
        name: error_field_um(a_result("FXYZ", {}, {name: 10.0}), corner)[0]
        for name in SQUARENESS
    }
    assert each["C0Y"] == pytest.approx([-4.0, 0, 0])
    assert each["B0Z"] == pytest.approx([3.0, 0, 0])
    assert each["A0Z"] == pytest.approx([0, -3.0, 0])


@given(st.integers(0, 2**32 - 1))
def test_chain_fxyz_is_the_one_written_out(seed: int) -> None:
    """Theory 2.2, FXYZ: Px = .. - y az(x) + z (ay(x)+ay(y)); Py = .. - z (ax(x)+ax(y)); Pz = .. + y
    ax(x)."""
    random = np.random.default_rng(seed)
    values = {name: random.normal(0, 10, 5) for name in (*DISPLACEMENTS, *ROTATIONS)}
    fraction = random.integers(0, 5, (20, 3))
    points = np.array(VOLUME.origin_mm) + np.array(VOLUME.size_mm) * fraction / 4
    _, y, z = ((points - np.array(VOLUME.origin_mm)) * 1e-3).T

    def at(name: str) -> np.ndarray:
        return values[name][fraction[:, "XYZ".index(name[2])]]

    expected = np.column_stack(
        [
            at("EXX") + at("EXY") + at("EXZ") - y * at("ECX") + z * (at("EBX") + at("EBY")),
            at("EYX") + at("EYY") + at("EYZ") - z * (at("EAX") + at("EAY")),
            at("EZX") + at("EZY") + at("EZZ") + y * at("EAX"),
        ]
    )
    np.testing.assert_allclose(
        error_field_um(a_result("FXYZ", values, {}), points), expected, atol=1e-9
    )


@given(st.lists(st.floats(-50, 50), min_size=6, max_size=6))
def test_a_rigid_motion_leaves_nothing(motion: list[float]) -> None:
    """A shift of the workpiece and a small turn about any point vanish to rounding."""
    points = np.array(VOLUME.origin_mm) + np.random.default_rng(1).uniform(
        0, 1, (30, 3)
    ) * np.array(VOLUME.size_mm)
    errors = np.array(motion[:3]) + np.cross(np.array(motion[3:]), points * 1e-3)
    assert np.abs(without_rigid_motion(VOLUME, points, errors)).max() < 1e-9


def test_what_is_no_rigid_motion_stays() -> None:
    """A scale error is not taken for a motion."""
    points = np.array(VOLUME.origin_mm) + np.random.default_rng(2).uniform(
        0, 1, (200, 3)
    ) * np.array(VOLUME.size_mm)
    errors = np.column_stack([20e-3 * points[:, 0], np.zeros(200), np.zeros(200)])
    assert np.ptp(without_rigid_motion(VOLUME, points, errors)[:, 0]) == pytest.approx(
        20e-3 * np.ptp(points[:, 0]), rel=0.05
    )
