"""Neutral curves: signs of the squareness, folding into one axis of a pair, reversal, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.exporters.tables.curves import FUNCTIONS, curves_of
from testkit.exact.results import VOLUME, made_result

POINTS = np.array(
    [
        [x, y, z]
        for x in (-200.0, -37.0, 200.0)
        for y in (0.0, 111.0, 400.0)
        for z in (-100.0, 20.0, 100.0)
    ]
)
SQUARE = {"C0Y": 20.0, "B0Z": 8.0, "A0Z": -15.0}
ERRORS = {
    "EXX": [0, 3, 1, -2, 5],
    "EYX": [0, 1, 2, 1, 0],
    "EZY": [0, -3, 2, 1, 0],
    "EXZ": [0, 1, -2, 1, 0],
    "EZZ": [0, 1, 2, 4, 3],
}


def curve_field_um(curves) -> np.ndarray:
    """The displacement that the curves describe, shape (N, 3)."""
    field = np.zeros(POINTS.shape)
    for curve in curves:
        field[:, "XYZ".index(curve.output_axis)] += curve.at(
            POINTS[:, "XYZ".index(curve.input_axis)]
        )
    return field


class TestSquareness:
    def test_curves_are_the_error_field_of_the_solver(self):
        """contract 1: dX = -C0Y y, dX = +B0Z z, dY = -A0Z z: folded as by default, nothing is left,
        not even a rigid motion."""
        result = made_result(ERRORS, squareness=SQUARE)
        np.testing.assert_allclose(
            curve_field_um(curves_of(result)), error_field_um(result, POINTS), atol=1e-9
        )

    @pytest.mark.parametrize("c0y", ["EXY", "EYX"])
    @pytest.mark.parametrize("b0z", ["EXZ", "EZX"])
    @pytest.mark.parametrize("a0z", ["EYZ", "EZY"])
    def test_folding_into_the_other_axis_differs_by_a_rigid_motion_only(self, c0y, b0z, a0z):
        """A squareness is one number for two axes: which of them is straightened is a turn of the
        workpiece."""
        result = made_result(ERRORS, squareness=SQUARE)
        field = curve_field_um(
            curves_of(result, FUNCTIONS, {"C0Y": c0y, "B0Z": b0z, "A0Z": a0z})
        )
        left = without_rigid_motion(VOLUME, POINTS, field - error_field_um(result, POINTS))
        assert np.max(np.abs(left)) < 1e-9

    def test_each_squareness_is_in_exactly_one_curve(self):
        parts = [
            part
            for curve in curves_of(made_result(squareness=SQUARE))
            for part in curve.parts
        ]
        assert sorted(part for part in parts if part in SQUARE) == ["A0Z", "B0Z", "C0Y"]

    def test_folding_into_a_foreign_pair_is_refused(self):
        with pytest.raises(UsageError, match=r"squareness_into\.C0Y: expected EXY or EYX"):
            curves_of(made_result(), FUNCTIONS, {"C0Y": "EZZ"})


class TestWhatIsNotIdentified:
    def test_a_missing_function_is_refused_by_name(self):
        """contract 4: never filled with a guess."""
        with pytest.raises(DataError, match="EZY"):
            curves_of(made_result({"EZY": None}))

    def test_a_missing_squareness_is_refused_only_where_it_is_needed(self):
        result = made_result(squareness={"B0Z": None})
        assert len(curves_of(result, ["EXX", "EYX"])) == 2
        with pytest.raises(DataError, match="B0Z"):
            curves_of(result, ["EXZ"])

    def test_a_shape_without_slope_says_so(self):
        assert not curves_of(made_result(shape_only=["EXX"]), ["EXX"])[0].slope_known

    def test_a_name_that_is_no_function_is_refused(self):
        with pytest.raises(UsageError, match="EAX"):
            curves_of(made_result(), ["EAX"])


class TestReversal:
    def test_mean_and_reversal_value(self):
        """The result's reversal is approach in + minus approach in -; half of it belongs to each
        direction."""
        curve = curves_of(
            made_result({"EXX": [0, 1, 2, 3, 4]}, reversal={"EXX": [0, 4, 4, 4, 8]}), ["EXX"]
        )[0]
        np.testing.assert_allclose(curve.mean_um, [0, 1, 2, 3, 4])
        np.testing.assert_allclose(curve.forward_um, [0, 3, 4, 5, 8])
        assert curve.reverse_um is not None
        np.testing.assert_allclose(curve.reverse_um, [0, -1, 0, 1, 0])

    def test_outside_the_measured_range_the_end_is_held(self):
        """What was not measured is not extrapolated."""
        curve = curves_of(made_result({"EXX": [0, 1, 2, 3, 4]}), ["EXX"])[0]
        assert curve.at(np.array([-999.0, 999.0])).tolist() == [0.0, 4.0]


def test_reversal_that_is_no_more_than_chance_makes_no_second_direction():
    """0.8 µm known to 0.3 µm (k = 1) is within three standard uncertainties."""
    curve = curves_of(
        made_result({"EXX": [0, 1, 2, 3, 4]}, reversal={"EXX": [0.8] * 5}), ["EXX"]
    )[0]
    assert curve.reverse_um is None


def test_reversal_without_its_constant_part_makes_no_second_direction():
    """Passes that share no zero: u is 0 at the first position, because the value there is a
    convention."""
    result = made_result({"EXX": [0, 1, 2, 3, 4]}, reversal={"EXX": [0, 4, 4, 4, 8]})
    relative = replace(result.reversal["EXX"], u=np.array([0.0, 0.3, 0.3, 0.3, 0.3]))
    assert (
        curves_of(replace(result, reversal={"EXX": relative}), ["EXX"])[0].reverse_um is None
    )
