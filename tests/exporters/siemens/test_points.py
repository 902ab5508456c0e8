"""The points of a table as they are read, and which curves find room."""

import pytest

from stepdiag.base.errors import DataError
from stepdiag.exporters.siemens.ini import Assignment
from stepdiag.exporters.siemens.points import read_points
from stepdiag.exporters.siemens.products import _most_valuable


def written(*values):
    return {
        number: Assignment(
            name="V", index=(str(number),), value=str(value), where=f"line {number}"
        )
        for number, value in enumerate(values)
    }


def test_a_table_that_ends_off_its_grid_ends_there():
    """controllers.md 3.2: MAX 25 with STEP 10 is a last position of 25 mm, half-way between two
    points."""
    points = read_points(written(0.0, 0.001, 0.002, 0.004), 10.0, 0.0, 25.0, "EEC")
    assert points.position_mm.tolist() == [0.0, 10.0, 20.0, 25.0]
    assert points.value_um == pytest.approx([0.0, 1.0, 2.0, 3.0])


def test_a_table_that_ends_just_before_its_grid_needs_no_further_point():
    points = read_points(written(0.0, 0.001, 0.002), 10.0, 0.0, 29.5, "EEC")
    assert points.value_um == pytest.approx([0.0, 1.0, 2.0, 2.0])


def test_every_point_up_to_the_last_must_stand_there():
    told = written(0.0, 0.001, 0.002, 0.003, 0.004)
    del told[2]
    with pytest.raises(DataError, match="expected points 0 to 3, found no point 2"):
        read_points(told, 10.0, 0.0, 30.0, "EEC")


def test_the_most_valuable_curve_is_so_for_each_table_that_it_takes():
    """3 µm in two tables are worth less than 2.5 µm in one; what does not fit leaves its room to
    the next."""
    worth, tables_of = {"EXX": 3.0, "EYX": 2.5, "EZX": 2.4}, {"EXX": 2, "EYX": 1, "EZX": 1}
    assert _most_valuable(worth, tables_of, 2) == ("EYX", "EZX")
    assert _most_valuable(worth, tables_of, 3) == ("EYX", "EZX")
    assert _most_valuable(worth, tables_of, 4) == ("EXX", "EYX", "EZX")
    assert _most_valuable(worth, {"EXX": 1, "EYX": 2, "EZX": 1}, 2) == ("EXX", "EZX")
    assert _most_valuable(worth, tables_of, 0) == ()
    assert _most_valuable(worth, tables_of, -1) is None
    assert _most_valuable(worth, tables_of, None) == ("EXX", "EYX", "EZX")
