"""The direction of a pass at the first standstill of a log, after stops that no log has seen."""

import pytest

from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.naming.finder import PassFinder
from stepdiag.daq.capture.naming.route import route_of
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.file import parse_survey
from testkit.timeline import survey_text

SURVEY = parse_survey(survey_text(n=10, back=True), "survey.toml")
OUT = route_of(SURVEY.planned, "ppp", 1)
LAST = len(OUT) - 1


def begun(next_stop, at, count):
    """Return the direction and the next stop of a pass out, left before a stop, when the machine is
    seen at a stop of the outward route with a count; the count before was 100."""
    x_mm, y_mm, z_mm = OUT.planned_mm(at)
    start = CaptureStart(hints={"ppp": PassHint(next_stop=next_stop)}, last_count=100)
    signals = Signals(stopped=True, stop_count=count, x_mm=x_mm, y_mm=y_mm, z_mm=z_mm)
    walk = PassFinder(SURVEY, start).follow(signals)
    return walk.route.way, walk.expected


@pytest.mark.parametrize("twice", [0, 1], ids=["once", "twice"])
@pytest.mark.parametrize("at", [1, 14, LAST - 1])
def test_the_counter_shows_a_turn_that_no_log_has_seen(at, twice):
    """From before stop 5 out over the last stop, which counts once or twice, and back."""
    passed = (LAST - 4) + (LAST - at) + twice
    assert begun(5, at, 100 + passed) == ("back", 0)


@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("at", [5, 9, 25, LAST])
def test_missed_stops_of_one_outage_do_not_turn_a_pass(at, counted):
    """A restart of the computer misses twenty stops in a row."""
    assert begun(5, at, 100 + at - 4 if counted else None)[0] == (
        "back" if at == LAST and not counted else "out"
    )


def test_a_program_begun_anew_at_the_other_end_is_the_pass_back():
    assert begun(5, LAST, None) == ("back", 0)
    assert begun(5, LAST, 400) == ("back", 0)
