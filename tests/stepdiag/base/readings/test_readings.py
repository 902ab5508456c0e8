"""The table of readings and its CSV (contract 4)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError
from stepdiag.base.readings.readings import make_readings, parse_readings, render_readings
from stepdiag.base.setups import SETUP_NAMES
from testkit.exact.surveys import DATA, Bench

HEADER = "setup,pass,stop,x_mm,y_mm,z_mm,reading_mm\n"
GOOD = (
    HEADER + "linear-x,1,0,0,0,0,0\nlinear-x,1,1,10,0,0,10.001\nlinear-x,1,2,20,0,0,20.002\n"
)


def test_the_golden_survey_is_read_as_it_is_shipped():
    """Column `diagonal` for `setup`, no `pass`, further columns, a comment line."""
    readings = parse_readings(
        (DATA / "golden_stepdiag_separable.csv").read_text(encoding="utf-8")
    )
    assert len(readings) == 4 * 31
    assert set(readings.setup) == {"ppp", "npp", "pnp", "ppn"}
    assert set(readings.pass_number.tolist()) == {1}
    assert readings.reading_mm[1] == 72.735914070
    assert np.isnan(readings.u_um).all()


numbers = st.floats(-5000, 5000).map(lambda value: round(value, 6))


@st.composite
def tables(draw):
    names = draw(st.lists(st.sampled_from(SETUP_NAMES), min_size=1, max_size=3, unique=True))
    stops = [
        (name, number, stop)
        for name in names
        for number in range(1, draw(st.integers(1, 2)) + 1)
        for stop in range(draw(st.integers(1, 4)))
    ]
    count = len(stops)
    column = st.lists(numbers, min_size=count, max_size=count)
    sparse = st.lists(
        st.one_of(st.just(float("nan")), numbers.map(abs)), min_size=count, max_size=count
    )
    return make_readings(
        setup=[name for name, _, _ in stops],
        pass_number=[number for _, number, _ in stops],
        stop=[stop for _, _, stop in stops],
        position_mm=np.column_stack([draw(column) for _ in range(3)]),
        reading_mm=draw(column),
        u_um=draw(sparse),
        temperature_c=draw(sparse),
        time_s=draw(sparse),
        beam_mm=np.where(
            np.array(draw(sparse))[:, None] > 1,
            np.column_stack([draw(column) for _ in range(3)]),
            np.nan,
        ),
    )


@given(tables(), st.randoms())
def test_rendering_and_parsing_are_inverse_and_byte_stable_in_any_order_of_rows(
    readings, random
):
    text = render_readings(readings)
    header, *lines = text.splitlines()
    random.shuffle(lines)
    again = parse_readings("\n".join([header, *lines]))
    assert render_readings(again) == text
    assert np.allclose(np.sort(again.reading_mm), np.sort(readings.reading_mm), atol=1e-9)


@pytest.mark.parametrize(
    "disguise",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "# made by hand\n\n" + text + "\n\n",
    ],
)
def test_marks_of_other_programs_do_not_matter(disguise):
    assert render_readings(parse_readings(disguise(GOOD))) == GOOD


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a header and at least one row"),
        (HEADER, "expected a header and at least one row"),
        (GOOD.replace(",", ";"), "line 1: header: expected columns separated by commas"),
        (GOOD.replace("reading_mm", "reading_um"), "no column reading_mm"),
        (GOOD.replace("pass,", "setup,"), "'setup' twice"),
        (
            GOOD.replace("10.001", "10,001"),
            "line 3: expected 7 fields, found 8; a decimal comma",
        ),
        (
            GOOD.replace("10.001", '"10,001"'),
            "reading_mm: expected a finite number, found '10,001'; write decimals with a point",
        ),
        (GOOD.replace("10.001", "nan"), "line 3: reading_mm: expected a finite number"),
        (GOOD.replace("10.001", "inf"), "line 3: reading_mm: expected a finite number"),
        (
            GOOD.replace(",10.001", ""),
            "line 3: expected 7 fields, found 6; the row was cut off",
        ),
        (
            GOOD.replace("x,1,2", "x,1,4"),
            (
                "linear run X (linear-x), pass 1 out: expected at most one missing stop for "
                "every 10 stops of a pass, found 2 of 5"
            ),
        ),
        (GOOD.replace("x,1,2", "x,1,99999999"), "stops missing, the first is `stop = 2`"),
        (GOOD.replace("x,1,0", "x,1,3"), "expected a row with `stop = 0`, found `stop = 1`"),
        (
            GOOD.replace("x,1,2", "x,1,1"),
            "linear run X (linear-x), pass 1 out: expected one row with `stop = 1`, found two or",
        ),
        (GOOD.replace("x,1,2", "x,1,-2"), "line 4: stop: expected a whole number from 0 up"),
        (GOOD.replace("x,1,2", "x,0,2"), "line 4: pass: expected a whole number from 1 up"),
        (GOOD.replace("linear-x,1,2", "linearx,1,2"), "line 4: setup: expected one of"),
        (GOOD.replace("linear-x,1,2", "linearx,1,2"), "did you mean 'linear-x'?"),
        (GOOD.replace("linear-x", "ppp+0"), "expected one of"),
        (GOOD.replace('"', "") + '"linear-x,1,3,1,1,1,1\n', "line 5"),
    ],
)
def test_what_is_no_table_of_readings_is_refused_with_its_place(text, message):
    with pytest.raises(DataError) as refusal:
        parse_readings(text, "day.csv")
    assert str(refusal.value).startswith("day.csv")
    assert message in str(refusal.value)


def test_a_negative_uncertainty_and_half_a_beam_are_refused():
    with pytest.raises(DataError, match=r"line 2: u_um: expected a finite number from 0 up"):
        parse_readings("setup,stop,x_mm,y_mm,z_mm,reading_mm,u_um\nppp,0,0,0,0,0,-1\n")
    with pytest.raises(DataError, match=r"line 2: beam: expected all of"):
        parse_readings(
            "setup,stop,x_mm,y_mm,z_mm,reading_mm,beam_x_mm,beam_y_mm,beam_z_mm\nppp,0,0,0,0,0,1,"
            ",1\n"
        )


@given(st.text(alphabet='setup,pasx_ymzrdigl0123456789.;-#"\n\r\t\ufeff', max_size=200))
def test_any_text_is_a_table_or_one_kind_of_refusal(text):
    for attempt in (text, HEADER + text):
        try:
            parse_readings(attempt)
        except DataError:
            continue


def test_columns_that_hold_nothing_are_not_written():
    readings = Bench(states_u=False).survey(["linear-x"])
    assert (
        render_readings(readings).splitlines()[0]
        == HEADER.strip() + ",time_s,beam_x_mm,beam_y_mm,beam_z_mm"
    )
