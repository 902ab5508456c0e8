"""What people watch: both ways of a setup on one zero, one sign, one numbering, the mirror's tilt taken out."""

import msgspec
import numpy as np
import pytest

from stepdiag.daq.capture.place.route import make_route
from stepdiag.daq.passes.alignment import tilt_effect_um
from stepdiag.daq.passes.deviations import RecentStops
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.service.time_left import seconds_left
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.captured import stops_of
from testkit.timeline import survey_text

BACKLASH_MM = 0.008
SURVEY = parse_survey(survey_text(setups=("ppp", "npp"), back=True), "survey.toml")


def returned(lost_mm: float = 0.0, **marks: str):
    """Return the stops of the way back, approached from the other side; ``marks`` are put on its first stop."""
    stops = [msgspec.structs.replace(stop, reading_mm=stop.reading_mm - BACKLASH_MM + lost_mm) for stop in stops_of(outward=False)]
    return [msgspec.structs.replace(stops[0], **marks), *stops[1:]]


def shown(*parts):
    """Return the stops shown after some stretches of stops."""
    book = PassBook(SURVEY)
    for part in parts:
        book.add_all(part)
    return RecentStops().of(SURVEY, book)


def test_the_way_back_shows_the_backlash_over_the_stops_of_the_way_out() -> None:
    """On one unbroken count 8 um of backlash stand at every stop, numbered as on the way out."""
    stops = shown(stops_of(), returned())
    out, back = ([one for one in stops if one.pass_number == number] for number in (1, 2))
    assert [one.place for one in out] == list(range(10))
    assert [one.place for one in back] == list(range(9, -1, -1))
    assert [one.deviation_um for one in out] == pytest.approx([0.0] * 10, abs=1e-6)
    assert [one.deviation_um for one in back] == pytest.approx([-1e3 * BACKLASH_MM] * 10, abs=1e-6)


def test_a_way_back_on_another_count_is_hung_onto_the_far_end() -> None:
    """Where the count was lost on the turn nothing is known of the backlash, and 4 mm of another zero are none."""
    back = [one for one in shown(stops_of(), returned(lost_mm=4.2, broken="beam lost")) if one.pass_number == 2]
    assert [one.deviation_um for one in back] == pytest.approx([0.0] * 10, abs=1e-6)


def test_a_tilted_mirror_is_not_shown_as_error_of_the_machine() -> None:
    """1 mrad makes steps of tens of um within a diagonal; what is left of them is nothing."""
    route = make_route(SURVEY.volume, "ppp", SURVEY.axis_order, outward=True)
    effect = tilt_effect_um(route, (1.0, -0.4), range(len(route)))
    assert np.ptp(effect) > 20.0
    tilted = [msgspec.structs.replace(one, reading_mm=one.reading_mm + effect[one.stop] * 1e-3) for one in stops_of()]
    assert [one.deviation_um for one in shown(tilted)] == pytest.approx([0.0] * 10, abs=0.05)


def test_the_time_left_counts_setting_up() -> None:
    """Before the first stop it is the plan's; a setup begun is set up."""
    book = PassBook(SURVEY)
    fresh = seconds_left(SURVEY, book)
    assert fresh > 2 * 30 * 60
    book.add_all(stops_of())
    assert fresh - seconds_left(SURVEY, book) > 30 * 60
