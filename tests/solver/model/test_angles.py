"""The angles file (contract 4)."""

import numpy as np
import pytest

from stepdiag.base.errors import DataError
from stepdiag.base.volume import Volume
from stepdiag.solver.model.angles import angle_at_nodes, parse_angles, render_angles

TEXT = """axis,position_mm,EA_urad,EB_urad,EC_urad,u_urad
x,100,,2.5,-3,0.5
x,0,,0.5,1,0.5
x,300,,4.5,,0.5
y,0,1,,,
y,300,7,,,
"""
VOLUME = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(300.0, 300.0, 300.0), increments=3)


def test_an_empty_field_is_unknown_and_an_empty_column_no_function():
    angles = parse_angles(TEXT)
    assert set(angles) == {"EBX", "ECX", "EAY"}
    assert angles["EBX"].position_mm.tolist() == [0.0, 100.0, 300.0]
    assert angles["ECX"].value_urad.tolist() == [1.0, -3.0]
    assert np.isnan(angles["EAY"].u_urad).all()


def test_angles_are_relative_to_the_low_end_and_linear_between_positions():
    value, u = angle_at_nodes(parse_angles(TEXT)["EBX"], "EBX", VOLUME)
    assert value == pytest.approx([2.0, 3.0, 4.0])
    assert u == pytest.approx([0.5, 0.5, 0.5])


def test_rendering_and_parsing_are_inverse():
    text = render_angles(parse_angles(TEXT))
    assert render_angles(parse_angles(text)) == text
    assert text.splitlines()[1] == "x,0.000000,,0.500000,1.000000,0.500000"


def test_a_function_must_reach_over_the_volume():
    with pytest.raises(
        DataError,
        match=r"angles: ECX: expected positions from 0 to 300 mm, the whole volume, found 0 to "
        r"100 mm",
    ):
        angle_at_nodes(parse_angles(TEXT)["ECX"], "ECX", VOLUME)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("y,0", "w,0", r"line 5: axis: expected x, y or z, found 'w'"),
        ("y,0,1,,,\n", "", r"EAY: expected values at two positions at least, found one"),
        ("x,100", "x,0", r"EBX: expected every position once, found 0 mm twice"),
        ("2.5", "2,5", r"line 2: expected 6 fields, found 7"),
        ("2.5", "many", r"line 2: EB_urad: expected a finite number, found 'many'"),
        ("EA_urad", "roll", r"no column EA_urad"),
    ],
)
def test_what_is_no_angles_file_is_refused(old, new, message):
    with pytest.raises(DataError, match=message):
        parse_angles(TEXT.replace(old, new), "head.csv")
