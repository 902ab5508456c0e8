"""Which readings share a zero, and what they are relative to."""

import msgspec
import numpy as np
import pytest

from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.tabulate import tabulate
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.captured import stops_of
from testkit.timeline import survey_text

BACKLASH_MM = 0.008
SURVEY = parse_survey(survey_text(setups=("ppp", "npp"), back=True), "survey.toml")


def back(*, lost_mm=0.0, **marks):
    """Return the stops of the return pass, approached from the other side; ``marks`` are put on its
    first stop."""
    stops = [
        msgspec.structs.replace(stop, reading_mm=stop.reading_mm - BACKLASH_MM + lost_mm)
        for stop in stops_of(outward=False)
    ]
    return [msgspec.structs.replace(stops[0], **marks), *stops[1:]]


def table(*parts):
    book = PassBook(SURVEY)
    for part in parts:
        book.add_all(part)
    return tabulate(SURVEY, book.passes)


def test_the_way_back_keeps_the_zero_of_the_way_out():
    readings = table(stops_of(), back())
    assert set(readings.zero.tolist()) == {1}
    outward, returned = (
        readings.reading_mm[readings.pass_number == number] for number in (1, 2)
    )
    assert outward[0] == 0.0
    assert returned[::-1] - outward == pytest.approx(-BACKLASH_MM)


def test_a_lost_count_starts_a_zero_of_its_own():
    readings = table(stops_of(), back(lost_mm=4.2, broken="beam lost"))
    numbers = (
        readings.zero[readings.pass_number == 1],
        readings.zero[readings.pass_number == 2],
    )
    assert [set(number.tolist()) for number in numbers] == [{1}, {2}]
    assert readings.reading_mm[readings.pass_number == 2][0] == 0.0


def test_a_count_that_nobody_watched_joins_nothing():
    """The beam may have been cut while the daemon was down: the difference would be taken for
    backlash."""
    readings = table(stops_of(), back(unwatched="the daemon was not running"))
    assert len(set(readings.zero.tolist())) == 2


def test_a_count_lost_and_joined_within_the_outward_pass_reaches_back_to_its_first_stop():
    """Stop 5 was measured before and after the loss; the return pass counts on from the second
    stretch."""
    begun, again = stops_of(only=range(6)), stops_of(only=range(5, 10), zero=3.0)
    again[0] = msgspec.structs.replace(again[0], broken="beam lost")
    readings = table(begun, again, back(lost_mm=3.0))
    assert set(readings.zero.tolist()) == {1}
    outward, returned = (
        readings.reading_mm[readings.pass_number == number] for number in (1, 2)
    )
    assert returned[::-1] - outward == pytest.approx(-BACKLASH_MM)


def test_another_setup_has_a_zero_of_its_own():
    readings = table(stops_of(), back(), stops_of("npp"))
    first = np.flatnonzero(np.array(readings.setup) == "npp")[0]
    assert readings.reading_mm[first] == 0.0
