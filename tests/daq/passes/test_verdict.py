"""What is doubted in the end: by the solver, of the conditions; and what stands in for a sensor is
in the budget."""

import msgspec
import pytest

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.findings import Finding, in_words
from stepdiag.base.messages import message
from stepdiag.daq.capture.captured_stop import marked
from stepdiag.daq.capture.conditions import CONDITIONS
from stepdiag.daq.passes.doubt import DRIVEN_AGAIN, acceptance_of
from stepdiag.daq.passes.held import assumed_conditions, held_conditions, with_held
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.verdict import assumed_findings, settled_findings, suspected
from stepdiag.daq.recording.verdicts import Judgement, Verdicts
from stepdiag.daq.survey.file import parse_survey
from stepdiag.texts.patterns import sentences
from testkit.exact.captured import stops_of
from testkit.timeline import survey_text

UNCOMPENSATED = survey_text().replace("compensated = true\n", "")


def book_of(stops, text=UNCOMPENSATED):
    passes = PassBook(parse_survey(text, "survey.toml"))
    passes.add_all(stops)
    return passes


def error(**place):
    return Finding(
        code="too-many-outliers",
        severity="error",
        text="the stops contradict each other",
        **place,
    )


def test_an_error_that_names_no_setup_keeps_every_pass_open():
    passes = book_of(stops_of())
    passes.suspect(suspected(passes, [error()]))
    assert [(doubt.place, doubt.code) for doubt in passes.doubts()] == [
        ("ppp/1", "too-many-outliers")
    ]
    assert not passes.complete()
    assert [each.severity for each in settled_findings(passes, [error()], stated={})] == [
        "error"
    ]
    passes.accept(acceptance_of(passes.doubts()[0], reason="seen", name="me", time_s=0.0))
    assert passes.complete()
    assert [each.severity for each in settled_findings(passes, [error()], stated={})] == [
        "warning"
    ]


def test_an_error_that_names_the_passes_among_which_the_data_do_not_tell_keeps_those_alone_open():
    """Who was told of two had to drive all of them."""
    passes = book_of(
        [*stops_of("ppp"), *stops_of("npp"), *stops_of("pnp")],
        survey_text(setups=("ppp", "npp", "pnp")),
    )
    found = error(among=("npp/1", "pnp/1"))
    passes.suspect(suspected(passes, [found]))
    assert [doubt.place for doubt in passes.doubts()] == ["npp/1", "pnp/1"]
    assert found.as_json()["among"] == ["npp/1", "pnp/1"]
    assert {each.severity for each in settled_findings(passes, [found], stated={})} == {
        "error"
    }


@pytest.mark.parametrize("known", [True, False])
def test_what_was_driven_again_because_the_solver_said_so_is_that_pass_in_a_replay_too(known):
    """A book that hears of it only afterwards takes it for a further pass, and asks for the first
    one once more."""
    first = stops_of()
    book = book_of(first)
    doubts = tuple(suspected(book, [error(among=("ppp/1",))]))
    later_ns = 10**12
    again = [
        msgspec.structs.replace(
            each,
            window_from_ns=each.window_from_ns + later_ns,
            window_to_ns=each.window_to_ns + later_ns,
        )
        for each in first
    ]
    again[0] = msgspec.structs.replace(again[0], broken="beam lost")
    replayed = PassBook(parse_survey(UNCOMPENSATED, "survey.toml"))
    judged = Judgement(time_s=0.0, stops=book.stops, reason="", doubts=doubts)
    replayed.foretell(Verdicts(judgements=(judged,) if known else ()).suspicions)
    replayed.add_all([*first, *again])
    replayed.suspect(doubts)
    assert [each.number for each in replayed.passes] == ([1] if known else [1, 3])
    assert replayed.complete() is known


def doubted(stop, *names, read):
    stated = message("value", value=20.0, unit="C")
    for name in names:
        unknown = message("air-unknown", name=CONDITIONS[name], read=read, stated=stated)
        stop = marked(
            stop,
            unknown
            if read
            else message("air-unknown.silent", name=CONDITIONS[name], stated=stated),
        )
    return stop


@pytest.mark.parametrize("read", ["0 C", ""])
@pytest.mark.parametrize(
    ("stated", "still"),
    [
        ({"air_temperature_c": 20.0}, True),
        ({"relative_humidity_percent": 50.0}, True),
        ({"air_temperature_c": 20.0, "air_pressure_hpa": 1013.0}, False),
    ],
)
def test_what_was_stated_settles_the_doubts_of_it_alone(stated, still, read):
    stops = stops_of()
    stops[3] = doubted(stops[3], "air_temperature_c", "air_pressure_hpa", read=read)
    assert (
        bool(
            [
                each
                for each in settled_findings(book_of(stops), [], stated=stated)
                if each.code == "air-unknown"
            ]
        )
        is still
    )


def held_at(stop, name, value):
    return msgspec.structs.replace(stop, held=(name,), **{name: value})


def test_a_held_value_is_in_the_budget_with_its_age():
    """Pressure held for an hour: (2 + 5) hPa / sqrt 3, 0.27 ppm a hPa (Edlen's equation, known to
    0.01 ppm)."""
    stops = [msgspec.structs.replace(stop, air_pressure_hpa=1013.0) for stop in stops_of()]
    stops[9] = msgspec.structs.replace(
        held_at(stops[9], "air_pressure_hpa", 1013.0), time_s=stops[8].time_s + 3600.0
    )
    passes = book_of(stops)
    (held,) = held_conditions(passes)
    assert (held.name, held.stops) == ("air_pressure_hpa", 1)
    assert held.u == pytest.approx(7.0 / 3**0.5)
    usual, survey = Assumptions(), parse_survey(UNCOMPENSATED, "s")
    assert with_held(usual, survey, [held]).index_setup == pytest.approx(
        0.27e-6 * held.u, rel=0.02
    )
    assert with_held(usual, parse_survey(survey_text(), "s"), [held]) == usual, (
        "a laser that puts its air right itself"
    )
    assert held_conditions(passes, {"air_pressure_hpa": 1010.0}) == ()
    (found,) = settled_findings(passes, [], stated={})
    assert "The uncertainty of the result includes u = 4 hPa" in found.text


def test_air_that_nobody_told_is_assumed_aloud():
    """Pressure is no signal of this machine: what the survey file says counts at each stop, and how
    unsure that is is in U and is said."""
    stops = [
        msgspec.structs.replace(stop, air_temperature_c=20.0, relative_humidity_percent=50.0)
        for stop in stops_of()
    ]
    passes, survey = book_of(stops), parse_survey(UNCOMPENSATED, "s")
    (one,) = assumed_conditions(passes, survey)
    assert (one.name, one.stops) == ("air_pressure_hpa", len(stops))
    (found,) = assumed_findings(survey, len(stops), [one])
    assert (found.code, found.severity) == ("air-unknown", "warning")
    assert "stops. 1013.25 hPa of [environment] is assumed" in found.text
    assert in_words(found, "de").startswith("Luftdruck: kein Wert an 10 von 10 Messpunkten")
    usual = Assumptions()
    assert with_held(usual, survey, [one]).index > 1e-6 > usual.index
    assert assumed_conditions(passes, survey, {"air_pressure_hpa": 1010.0}) == ()
    assert assumed_conditions(passes, parse_survey(survey_text(), "s")) == (), (
        "a laser that puts its air right itself"
    )
    by_hand = parse_survey(UNCOMPENSATED + '\n[environment]\nsource = "fixed"\n', "s")
    assert assumed_conditions(passes, by_hand) == (), "a person said it"


@pytest.mark.parametrize("key", sorted(DRIVEN_AGAIN))
def test_a_message_that_names_what_is_driven_again_is_not_given_the_words_twice(key):
    assert "again" in "".join(part for part, _ in sentences()[key]["en"])
