"""The fit to the volume: the best that curves can do, what products add, and nothing new where
there are no angles."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.result import ROTATIONS, Result
from stepdiag.base.volume import Vector, Volume, grid_points_mm
from stepdiag.exporters.tables.curves import FUNCTIONS, Curve, curves_of
from stepdiag.exporters.tables.fit import Product, fitted
from stepdiag.exporters.tables.tables import Law, Multiplier, Table, mean_correction_um
from testkit.exact.results import made_result

VOLUME = Volume(origin_mm=(-200.0, 50.0, -100.0), size_mm=(500.0, 400.0, 300.0), increments=6)
POINTS = grid_points_mm(VOLUME, 13)
CHAINS = ("FXYZ", "XFYZ", "XYFZ", "YXFZ", "XYZF")


def drawn(seed: int, chain: str = "FXYZ", angle_urad: float = 10.0) -> Result:
    """Return a machine with errors of 8 µm and angles of about ``angle_urad``, zero at the first
    position of each axis."""
    rng = np.random.default_rng(seed)

    def wave(size: float) -> np.ndarray:
        along = np.linspace(0.0, 1.0, VOLUME.increments + 1)
        return (
            size * sum(rng.normal() * np.sin(k * np.pi * along) for k in (1, 2))
            + rng.normal() * size * along
        )

    straight = {name: wave(8.0) for name in FUNCTIONS}
    shapes = {
        name: value if name[1] == name[2] else value - np.linspace(0.0, value[-1], len(value))
        for name, value in straight.items()
    }
    squareness = {name: float(rng.normal(0.0, 20.0)) for name in ("C0Y", "B0Z", "A0Z")}
    angles = {name: wave(angle_urad) for name in ROTATIONS}
    return made_result(
        shapes, squareness=squareness, angles=angles, chain=chain, volume=VOLUME
    )


def left_um(
    result: Result,
    curves: tuple[Curve, ...],
    products: tuple[Product, ...] = (),
    points: Vector = POINTS,
) -> Vector:
    """Return the error vectors that perfect tables leave, without rigid motion."""
    left = error_field_um(result, points)
    for curve in curves:
        left[:, "XYZ".index(curve.output_axis)] -= curve.at(
            points[:, "XYZ".index(curve.input_axis)]
        )
    for product in products:
        along = np.interp(
            points[:, "XYZ".index(product.input_axis)], product.position_mm, product.value_um
        )
        lever = (
            points[:, "XYZ".index(product.by_axis)] - product.middle_mm
        ) / product.half_mm
        left[:, "XYZ".index(product.output_axis)] -= along * lever
    return without_rigid_motion(VOLUME, points, left)


def rms_um(left: Vector) -> float:
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


class TestCurves:
    @pytest.mark.parametrize("chain", CHAINS)
    def test_nothing_of_one_axis_is_left(self, chain: str) -> None:
        """What the fit leaves has no mean along any axis: no other nine curves leave less (the
        condition of least squares)."""
        result = drawn(1, chain)
        left = left_um(result, fitted(result).curves).reshape(13, 13, 13, 3)
        for axis in range(3):
            others = tuple({0, 1, 2} - {axis})
            assert np.max(np.abs(left.mean(axis=others))) < 0.15, (
                axis
            )  # the grid's mean is not the integral's

    @pytest.mark.parametrize("chain", CHAINS)
    def test_far_less_is_left_than_by_the_curves_on_the_corner_lines(
        self, chain: str
    ) -> None:
        result = drawn(2, chain)
        corner, volume = (
            rms_um(left_um(result, curves))
            for curves in (curves_of(result), fitted(result).curves)
        )
        assert volume < 0.75 * corner

    @settings(max_examples=8)
    @given(
        seed=st.integers(0, 10_000),
        name=st.sampled_from(FUNCTIONS),
        size=st.floats(0.3, 3.0),
        waves=st.integers(1, 4),
    )
    def test_any_other_curve_leaves_more(
        self, seed: int, name: str, size: float, waves: int
    ) -> None:
        result = drawn(seed)
        best = fitted(result).curves
        other = [
            replace(curve, forward_um=curve.forward_um + _wave(curve, size, waves))
            if curve.name == name
            else curve
            for curve in best
        ]
        assert rms_um(left_um(result, tuple(other))) > rms_um(left_um(result, best))

    def test_without_angles_the_curves_are_those_of_the_result(self) -> None:
        result = drawn(3)
        plain = replace(result, errors={name: result.errors[name] for name in FUNCTIONS})
        for ours, known in zip(fitted(plain).curves, curves_of(plain), strict=True):
            assert ours is known or (
                ours.parts == known.parts
                and np.array_equal(ours.forward_um, known.forward_um)
            )
        assert fitted(plain).products == ()

    def test_what_was_added_is_named_and_its_uncertainty_counts(self) -> None:
        result = drawn(4)
        known = {curve.name: curve for curve in curves_of(result)}
        for curve in fitted(result).curves:
            assert (
                set(known[curve.name].parts) < set(curve.parts) or curve.name == "EZZ"
            )  # no arm of this chain moves Z along Z
            assert np.all(
                np.interp(known[curve.name].position_mm, curve.position_mm, curve.u_um)
                >= known[curve.name].u_um
            )

    def test_the_reversal_stays(self) -> None:
        result = drawn(5)
        back = made_result(
            reversal={"EXX": [0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.5]}, volume=VOLUME
        ).reversal
        (curve,) = [
            c for c in fitted(replace(result, reversal=back)).curves if c.name == "EXX"
        ]
        assert curve.reverse_um is not None
        np.testing.assert_allclose(
            np.interp(
                curve.position_mm, VOLUME.nodes_mm(0), [0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.5]
            ),
            curve.forward_um - curve.reverse_um,
            atol=1e-9,
        )

    @pytest.mark.parametrize(
        "into",
        [
            {"C0Y": "EXY", "B0Z": "EXZ", "A0Z": "EYZ"},
            {"C0Y": "EYX", "B0Z": "EZX", "A0Z": "EZY"},
        ],
    )
    def test_the_slopes_stand_where_the_profile_wants_the_squareness(
        self, into: dict[str, str]
    ) -> None:
        """The other curve of each pair ends where it began, and no more is left than the other way
        round."""
        result = drawn(6)
        curves = {curve.name: curve for curve in fitted(result, fold=into).curves}
        others = [
            name for name in FUNCTIONS if name[1] != name[2] and name not in into.values()
        ]
        for name in others:
            assert curves[name].mean_um[-1] - curves[name].mean_um[0] == pytest.approx(
                0.0, abs=1e-9
            )
        both = rms_um(left_um(result, fitted(result).curves))
        assert rms_um(left_um(result, tuple(curves.values()))) == pytest.approx(
            both, rel=1e-6
        )


ZONE = {"Y": (350.0, 450.0), "Z": (0.0, 100.0)}


class TestWorkingZone:
    def test_less_is_left_where_the_work_lies(self) -> None:
        result = drawn(7)
        work = np.all(
            [
                (POINTS[:, "XYZ".index(axis)] >= low) & (POINTS[:, "XYZ".index(axis)] <= high)
                for axis, (low, high) in ZONE.items()
            ],
            axis=0,
        )
        there = POINTS[work]
        whole, zone = (
            rms_um(left_um(result, fitted(result, zone=each).curves, points=there))
            for each in (None, ZONE)
        )
        assert zone < 0.8 * whole

    @pytest.mark.parametrize(
        "zone", [(0.0, 100.0), (100.0, 100.0), (200.0, 100.0), (300.0, 500.0)]
    )
    def test_a_zone_that_was_not_measured_is_refused(self, zone: tuple[float, float]) -> None:
        with pytest.raises(UsageError, match=r"axes\.Y\.working_mm"):
            fitted(drawn(7), zone={"Y": zone})


class TestProducts:
    @pytest.mark.parametrize("chain", CHAINS)
    def test_curves_and_products_hold_everything(self, chain: str) -> None:
        """Errors of rigid bodies are of this form: nothing more is left to a lattice."""
        result = drawn(8, chain)
        found = fitted(result)
        assert rms_um(left_um(result, found.curves, found.products)) < 0.02 * rms_um(
            left_um(result, found.curves)
        )

    def test_the_most_valuable_comes_first_and_says_its_worth(self) -> None:
        result = drawn(9)
        found = fitted(result)
        assert [p.rms_um for p in found.products] == sorted(
            (p.rms_um for p in found.products), reverse=True
        )
        without, with_first = (
            rms_um(left_um(result, found.curves, products))
            for products in ((), found.products[:1])
        )
        assert np.sqrt(without**2 - with_first**2) == pytest.approx(
            found.products[0].rms_um, rel=0.2
        )

    def test_an_active_product_is_part_of_the_machine(self) -> None:
        """Measured with a product table on, the machine without it errs by what the table moved."""
        result = drawn(10)
        shape = np.array([0.0, 4.0, -3.0, 2.0])
        active = Table(
            kind="cec",
            input_axis="X",
            output_axis="Z",
            position_mm=np.linspace(-200.0, 300.0, 4),
            value_um=shape,
            quantum_um=0.1,
            law=Law(sense="as-error"),
            reference_mm=-200.0,
            multiplier=Multiplier(
                axis="Y", position_mm=np.array([50.0, 450.0]), value=np.array([-1.0, 1.0])
            ),
        )
        bare = error_field_um(result, POINTS) - mean_correction_um([active], POINTS)
        found = fitted(result, active=[active])
        left = (
            bare
            + left_um(result, found.curves, found.products)
            - without_rigid_motion(VOLUME, POINTS, error_field_um(result, POINTS))
        )
        assert rms_um(without_rigid_motion(VOLUME, POINTS, left)) < 0.05

    def test_an_active_product_that_bends_is_refused(self) -> None:
        bent = Multiplier(
            axis="Y",
            position_mm=np.array([50.0, 100.0, 450.0]),
            value=np.array([-1.0, 0.9, 1.0]),
        )
        active = Table(
            kind="cec",
            input_axis="X",
            output_axis="Z",
            position_mm=np.array([0.0, 1.0]),
            value_um=np.array([0.0, 1.0]),
            quantum_um=0.1,
            law=Law(sense="as-error"),
            reference_mm=0.0,
            multiplier=bent,
        )
        with pytest.raises(UsageError, match=r"EZX\*Y"):
            fitted(drawn(10), active=[active])


def _wave(curve: Curve, size: float, waves: int) -> Vector:
    along = (curve.position_mm - curve.position_mm[0]) / (
        curve.position_mm[-1] - curve.position_mm[0]
    )
    return size * np.sin(waves * np.pi * along)
