"""Renishaw .rtl by its public description (docs/lasers.md): tolerant in order and white space,
strict in counts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.readings.readings import make_readings
from stepdiag.base.readings.rtl import parse_rtl, render_rtl, rtl_readings, with_runs

FILE = """HEADER::
File type : Linear
Owner : somebody
Version no : 1
TARGET DATA::
Filetype : ISO
Target-count : 4
Targets :
0.0 100.0 200.0
300.0
Flags : 0 0 2 0
USER-TEXT::
Machine : mill
Axis : X
RUNS::
Run-count : 2
DEVIATIONS::
Run Target Data:
1 1 0.0
1 2 1.5
1 3 -2.0
1 4 3.0
2 4 3.5
2 3 -1.0
2 2 2.0
2 1 0.5
EQUIPMENT::
ENVIRONMENT::
EOF::
"""


def diagonals():
    """Two corners of a volume of 300 x 200 x 100, as any survey has them."""
    return make_readings(
        setup=["ppp", "ppp"],
        pass_number=[1, 1],
        stop=[0, 1],
        position_mm=[[0, 0, 0], [300, 200, 100]],
        reading_mm=[0, 1],
    )


def test_a_file_of_two_runs_is_read_with_its_targets_deviations_and_axis():
    file = parse_rtl(FILE, "x.rtl")
    assert file.targets_mm.tolist() == [0, 100, 200, 300]
    assert file.deviations_um.tolist() == [[0, 1.5, -2, 3], [0.5, 2, -1, 3.5]]
    assert file.axis == "x"
    assert file.both_ways
    assert file.texts["machine"] == "mill"


def test_order_and_white_space_do_not_matter():
    blocks = FILE.split("RUNS::\n")
    turned = (
        "RUNS::\n"
        + blocks[1].split("EQUIPMENT::")[0].replace(" ", "\t  ")
        + blocks[0]
        + "EOF::\n"
    )
    assert np.array_equal(
        parse_rtl(turned.replace("\n", "\r\n"), "x.rtl").deviations_um,
        parse_rtl(FILE, "x.rtl").deviations_um,
    )


def test_runs_join_a_survey_as_passes_out_and_back():
    rows, setup = rtl_readings(parse_rtl(FILE, "x.rtl"), "", (0.0, 0.0, 0.0), "x.rtl")
    joined = with_runs(diagonals(), [(setup, rows)], "readings.csv")
    passes = {str(key): at for key, at in joined.passes().items()}
    out, back = (
        passes[f"linear run X (linear-x), pass {way}"] for way in ("1 out", "2 back")
    )
    assert joined.position_mm[out, 0].tolist() == [0, 100, 200, 300]
    assert joined.reading_mm[out] == pytest.approx([0.0, 100.0015, 199.998, 300.003])
    assert joined.position_mm[back, 0].tolist() == [300, 200, 100, 0]
    assert joined.reading_mm[back] == pytest.approx([0.0, -100.0045, -200.0015, -300.003])


def test_one_way_runs_are_all_outward():
    text = FILE.replace("Flags : 0 0 2 0", "Flags : 0 1 2 0")
    rows, _ = rtl_readings(parse_rtl(text, "x.rtl"), "", (0.0, 0.0, 0.0), "x.rtl")
    assert sorted({number for number, *_ in rows}) == [1, 3]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("Target-count : 4", "Target-count : 5", "as many numbers as Target-count states"),
        ("Run-count : 2", "Run-count : 3", "no deviation of run 3 at target 1"),
        ("2 1 0.5\n", "", "no deviation of run 2 at target 1"),
        ("2 1 0.5", "2 2 0.5", "every target once in a run"),
        ("2 1 0.5", "2 9 0.5", "target 1 to 4"),
        ("2 1 0.5", "2 1 0,5", "a number with a decimal point"),
        ("1 4 3.0", "1 4 3.0 9", "run, target and deviation"),
        ("1 4 3.0", "1 4 300000", "a deviation in µm"),
        ("File type : Linear", "File type : Angular", "expected lengths"),
        ("0.0 100.0 200.0", "0.0 200.0 100.0", "ascending or descending"),
        ("RUNS::\n", "", "a section RUNS"),
        ("EOF::\n", "", "cut off"),
        ("Run-count : 2", "Run-count : -2", "a whole number"),
    ],
)
def test_what_cannot_be_right_is_refused(old, new, said):
    with pytest.raises(DataError, match=said):
        parse_rtl(FILE.replace(old, new), "x.rtl")


def test_what_has_no_place_is_refused():
    file = parse_rtl(FILE, "x.rtl")
    with pytest.raises(UsageError, match="axis 'X'"):
        rtl_readings(file, "linear-y", (0, 0, 0), "x.rtl")
    with pytest.raises(UsageError, match="add the axis: linear-x"):
        rtl_readings(
            parse_rtl(FILE.replace("Axis : X", "Axis : C"), "x.rtl"), "", (0, 0, 0), "x.rtl"
        )
    rows, setup = rtl_readings(file, "", (0.0, 500.0, 0.0), "x.rtl")
    with pytest.raises(UsageError, match="give a point of the measured line"):
        with_runs(diagonals(), [(setup, rows)], "readings.csv")
    inside, _ = rtl_readings(file, "", (0.0, 50.0, 0.0), "x.rtl")
    with pytest.raises(UsageError, match="the setup linear-x once"):
        with_runs(diagonals(), [(setup, inside), (setup, inside)], "readings.csv")


@given(
    targets=st.lists(st.integers(0, 3000), min_size=2, max_size=9, unique=True),
    runs=st.integers(1, 4),
    deviations=st.lists(st.floats(-90, 90), min_size=36, max_size=36),
)
def test_what_is_written_is_read_again(targets, runs, deviations):
    """To the nanometre, in which the file is written."""
    at = sorted(targets)
    columns = {
        name: [] for name in ("setup", "pass_number", "stop", "position_mm", "reading_mm")
    }
    for run in range(runs):
        order = at if run % 2 == 0 else at[::-1]
        for stop, target in enumerate(order):
            off = deviations[run * 9 + at.index(target)] * 1e-3
            for name, value in zip(
                columns,
                ("linear-y", run + 1, stop, [1.0, target, 2.0], target + off),
                strict=True,
            ):
                columns[name].append(value)
    readings = make_readings(**columns)
    file = parse_rtl(render_rtl(readings, "linear-y", {"Machine": "a\nb"}), "y.rtl")
    rows, setup = rtl_readings(file, "", (1.0, 0.0, 2.0), "y.rtl")
    assert setup == "linear-y"
    for (key, index), number in zip(
        readings.passes().items(), range(1, runs + 1), strict=True
    ):
        again = [reading for run, _, _, reading in rows if run == number]
        relative = readings.reading_mm[index] - readings.reading_mm[index[0]]
        assert key.number == number
        assert again == pytest.approx(relative.tolist(), abs=2e-7)


@given(st.text(max_size=400) | st.builds(lambda cut: FILE[:cut], st.integers(0, len(FILE))))
def test_any_text_is_read_or_refused(text):
    try:
        parse_rtl(text, "x.rtl")
    except DataError:
        return
