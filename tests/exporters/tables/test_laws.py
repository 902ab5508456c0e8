"""What one table moves: between its points, beyond its ends, stepped, and as a product."""

import numpy as np
import pytest

from stepdiag.base.errors import UsageError
from stepdiag.base.volume import Volume
from stepdiag.exporters.tables.lattice import MOST_LINES, lattice_of
from stepdiag.exporters.tables.tables import Law, Multiplier, Table, correction_um
from testkit.exact.results import made_result


def table(**law):
    return Table(
        kind="test",
        input_axis="X",
        output_axis="X",
        position_mm=np.array([100.0, 200.0, 400.0]),
        value_um=np.array([2.0, 4.0, 10.0]),
        quantum_um=0.1,
        law=Law(sense="as-error", **law),
        reference_mm=100.0,
    )


@pytest.mark.parametrize(
    ("law", "moved"),
    [
        ({}, [-2.0, -2.0, -3.0, -7.0, -10.0, -10.0]),
        ({"ends": "extended"}, [-1.0, -2.0, -3.0, -7.0, -10.0, -13.0]),
        ({"between": "stepped"}, [-2.0, -2.0, -2.0, -4.0, -10.0, -10.0]),
    ],
)
def test_a_value_as_error_moves_the_axis_back(law, moved):
    """controllers.md 1, by hand: 0.02 µm/mm in the first section, 0.03 in the last; drawn on, held,
    or changed when a point is passed."""
    at = np.array([50.0, 100.0, 150.0, 300.0, 400.0, 500.0])
    assert correction_um(table(**law), at) == pytest.approx(moved)


@pytest.mark.parametrize(
    ("ends", "factors"), [("held", [-1.0, 0.0, 1.0]), ("extended", [-2.0, 0.0, 1.5])]
)
def test_a_lever_is_held_or_drawn_on(ends, factors):
    lever = Multiplier(
        axis="Z", position_mm=np.array([0.0, 200.0]), value=np.array([-1.0, 1.0]), ends=ends
    )
    assert lever.at(np.array([-100.0, 100.0, 250.0])) == pytest.approx(factors)
    assert lever.is_straight
    assert lever.line == pytest.approx((0.01, 100.0))


@pytest.mark.parametrize(
    ("middle", "straight"),
    [(0.0, True), (0.0009, True), (0.0011, False), (0.02, False), (-0.5, False)],
)
def test_a_lever_with_a_bend_of_a_thousandth_is_no_straight_line(middle, straight):
    lever = Multiplier(
        axis="Z",
        position_mm=np.array([0.0, 100.0, 150.0, 200.0]),
        value=np.array([-1.0, middle, 0.5, 1.0]),
    )
    assert lever.is_straight is straight


def test_a_lever_of_one_a_millimetre_is_a_straight_line_and_a_level_one_is_none():
    assert Multiplier(
        axis="Z", position_mm=np.array([0.0, 200.0]), value=np.array([-100.0, 100.0])
    ).is_straight
    assert not Multiplier(
        axis="Z", position_mm=np.array([0.0, 200.0]), value=np.array([0.5, 0.5])
    ).is_straight


def test_the_vertices_of_a_lattice_are_counted_at_both_ends():
    """Just as many sections as vertices are allowed is too many: every axis has one vertex more."""
    sections = round(MOST_LINES ** (1 / 3))
    assert sections**3 <= MOST_LINES
    volume = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(float(sections),) * 3, increments=4)
    with pytest.raises(UsageError, match=f"at most {MOST_LINES} vertices, found 1 mm"):
        lattice_of(made_result({}, volume=volume), 1.0)
