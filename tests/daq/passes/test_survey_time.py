"""When a survey was measured: a clock that was never set is named until somebody states the
time."""

from datetime import UTC, datetime, timedelta

import msgspec
import pytest

from stepdiag.daq.passes.doubt import TimeStated
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.survey_time import BUILT, clock_findings, span_s
from stepdiag.daq.service.finding_list import finding_list
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.captured import stops_of
from testkit.timeline import survey_text

SET = BUILT + timedelta(days=400)


def book(began: datetime) -> PassBook:
    passes = PassBook(parse_survey(survey_text(), "survey.toml"))
    passes.add_all(
        msgspec.structs.replace(stop, time_s=began.timestamp() + 60 * stop.stop)
        for stop in stops_of()
    )
    return passes


@pytest.mark.parametrize(
    ("began", "named"),
    [
        (datetime(1970, 1, 1, tzinfo=UTC), True),
        (datetime(2000, 1, 1, tzinfo=UTC), True),
        (BUILT - timedelta(seconds=1), True),
        (BUILT, False),
        (SET, False),
    ],
)
def test_a_time_before_the_program_was_built_is_no_time(began: datetime, named: bool) -> None:
    passes = book(began)
    assert [(found.code, found.severity) for found in clock_findings(passes)] == [
        ("clock-unset", "warning")
    ] * named
    assert [found.code for found in finding_list(passes, ())] == ["clock-unset"] * named, (
        "page and status show the same"
    )


def test_before_the_first_stop_the_clock_of_now_counts() -> None:
    empty = PassBook(parse_survey(survey_text(), "survey.toml"))
    assert [found.code for found in finding_list(empty, (), 0.0)] == ["clock-unset"]
    assert not finding_list(empty, (), SET.timestamp())
    assert not finding_list(empty, ())
    assert not finding_list(book(SET), (), 0.0), (
        "a clock that is lost afterwards changes nothing of the survey"
    )


def test_a_time_that_is_stated_takes_the_place_of_the_clocks() -> None:
    passes = book(datetime(1970, 1, 1, tzinfo=UTC))
    passes.time_stated = TimeStated(
        begun_s=SET.timestamp(), name="Kim", reason="shift book", time_s=0.0
    )
    assert span_s(passes) == (SET.timestamp(), SET.timestamp() + 9 * 60)
    (found,) = clock_findings(passes)
    assert found.severity == "info"
    assert "Kim entered" in found.text
    assert found.text.endswith("as the time of the first stop: shift book")
