"""What people watch: both ways of a setup on one zero, one sign, one numbering, the mirror's tilt
taken out."""

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.daq.passes.alignment import POSSIBLE_MRAD, mirror_tilt_mrad, tilt_effect_um
from stepdiag.daq.passes.deviations import RecentStops
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.captured import stops_of
from testkit.routes import make_route
from testkit.timeline import survey_text

BACKLASH_MM = 0.008
SURVEY = parse_survey(survey_text(setups=("ppp", "npp"), back=True), "survey.toml")


def returned(lost_mm: float = 0.0, **marks: str):
    """Return the stops of the way back, approached from the other side; ``marks`` are put on its
    first stop."""
    stops = [
        msgspec.structs.replace(stop, reading_mm=stop.reading_mm - BACKLASH_MM + lost_mm)
        for stop in stops_of(outward=False)
    ]
    return [msgspec.structs.replace(stops[0], **marks), *stops[1:]]


def shown(*parts):
    """Return the stops shown after some stretches of stops."""
    book = PassBook(SURVEY)
    for part in parts:
        book.add_all(part)
    return RecentStops().of(SURVEY, book)


def test_the_way_back_shows_the_backlash_over_the_stops_of_the_way_out() -> None:
    """On one unbroken count 8 µm of backlash stand at every stop, numbered as on the way out."""
    stops = shown(stops_of(), returned())
    out, back = ([one for one in stops if one.pass_number == number] for number in (1, 2))
    assert [one.place for one in out] == list(range(10))
    assert [one.place for one in back] == list(range(9, -1, -1))
    assert [one.deviation_um for one in out] == pytest.approx([0.0] * 10, abs=1e-6)
    assert [one.deviation_um for one in back] == pytest.approx(
        [-1e3 * BACKLASH_MM] * 10, abs=1e-6
    )


def test_a_way_back_on_another_count_is_hung_onto_the_far_end() -> None:
    """Where the count was lost on the turn nothing is known of the backlash, and 4 mm of another
    zero are none."""
    back = [
        one
        for one in shown(stops_of(), returned(lost_mm=4.2, broken="beam lost"))
        if one.pass_number == 2
    ]
    assert [one.deviation_um for one in back] == pytest.approx([0.0] * 10, abs=1e-6)


def test_a_tilted_mirror_is_not_shown_as_error_of_the_machine() -> None:
    """1 mrad makes steps of tens of um within a diagonal; what is left of them is nothing."""
    route = make_route(SURVEY.volume, "ppp", SURVEY.axis_order, outward=True)
    effect = tilt_effect_um(route, (1.0, -0.4), range(len(route)))
    assert np.ptp(effect) > 20.0
    tilted = [
        msgspec.structs.replace(one, reading_mm=one.reading_mm + effect[one.stop] * 1e-3)
        for one in stops_of()
    ]
    assert [one.deviation_um for one in shown(tilted)] == pytest.approx([0.0] * 10, abs=0.05)


@given(
    zero_mm=st.floats(-50, 50),
    overlap=st.integers(1, 8),
    tilt=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
)
def test_a_mended_pass_shows_the_tilt_and_the_deviations_of_one_zero(
    zero_mm, overlap, tilt
) -> None:
    """The count is lost, the machine goes back over some stops: no jump of the count becomes a tilt
    or a deviation."""
    route = make_route(SURVEY.volume, "ppp", SURVEY.axis_order, outward=True)
    effect_mm = tilt_effect_um(route, tilt, range(len(route))) * 1e-3
    tilted = [
        msgspec.structs.replace(one, reading_mm=one.reading_mm + effect_mm[one.stop])
        for one in stops_of()
    ]
    again = [
        msgspec.structs.replace(one, reading_mm=one.reading_mm + zero_mm)
        for one in tilted[overlap - 1 :]
    ]
    lost = msgspec.structs.replace(
        tilted[overlap], reading_mm=tilted[overlap].reading_mm + zero_mm, broken="beam lost"
    )
    book = PassBook(SURVEY)
    book.add_all([*tilted[:overlap], lost, *again])
    (only,) = book.passes
    assert mirror_tilt_mrad(route, list(only.chosen().values())) == pytest.approx(
        tilt, abs=1e-6
    )
    assert [one.deviation_um for one in RecentStops().of(SURVEY, book)] == pytest.approx(
        [0.0] * 10, abs=0.1
    )


def test_a_tilt_that_no_beam_survives_is_not_known() -> None:
    """40 mrad are the slope of something else: neither the card nor the deviations take it for the
    mirror's."""
    route = make_route(SURVEY.volume, "ppp", SURVEY.axis_order, outward=True)
    for tilt_mrad, known in ((POSSIBLE_MRAD - 0.1, True), (POSSIBLE_MRAD + 0.1, False)):
        effect_mm = tilt_effect_um(route, (tilt_mrad, 0.0), range(len(route))) * 1e-3
        book = PassBook(SURVEY)
        book.add_all(
            [
                msgspec.structs.replace(one, reading_mm=one.reading_mm + effect_mm[one.stop])
                for one in stops_of()
            ]
        )
        assert (
            mirror_tilt_mrad(route, list(book.passes[0].chosen().values())) is not None
        ) == known
