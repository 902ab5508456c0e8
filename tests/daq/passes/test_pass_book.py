"""From captured stops to passes: what is whole, what must be driven again."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.daq.passes.doubt import Doubt, acceptance_of
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.captured import stops_of
from testkit.timeline import survey_text


def book(**plan):
    return PassBook(parse_survey(survey_text(**plan), "survey.toml"))


def broken(stop):
    return msgspec.structs.replace(stop, broken="beam lost")


def test_out_and_back_make_the_survey_whole():
    passes = book(setups=("ppp", "npp"), back=True)
    assert passes.next_setup() == "ppp"
    passes.add_all(stops_of("ppp"))
    hint = passes.start(skip_open_dwell=True).hints["ppp"]
    assert not hint.outward
    assert hint.turn is not None
    assert passes.open_passes("ppp") == [2]
    passes.add_all(stops_of("ppp", outward=False))
    assert passes.next_setup() == "npp"
    passes.add_all(stops_of("npp"))
    passes.add_all(stops_of("npp", outward=False))
    assert passes.complete()
    assert [each.number for each in passes.of("npp")] == [1, 2]


def test_without_return_passes_repeats_are_odd():
    passes = book()
    passes.add_all(stops_of())
    assert passes.complete()
    passes.add_all(stops_of())
    assert [each.number for each in passes.passes] == [1, 3]


def test_a_pass_goes_on_where_a_killed_daemon_left_it():
    passes = book()
    passes.add_all(stops_of(only=range(5)))
    hint = passes.start(skip_open_dwell=False).hints["ppp"]
    assert (hint.next_stop, hint.outward) == (5, True)
    assert hint.last_reading_mm == pytest.approx(stops_of()[4].reading_mm)
    passes.add_all(stops_of(only=range(5, 10)))
    assert passes.complete()


def test_a_broken_count_costs_the_rest_of_the_pass():
    passes = book()
    first, second = stops_of(only=range(5)), stops_of(only=range(5, 10), zero=3.3)
    passes.add_all([*first, broken(second[0]), *second[1:]])
    (only,) = passes.passes
    assert only.missing == [5, 6, 7, 8, 9]
    assert "beam lost" in str(only.why_incomplete())
    assert "from stop 5 on" in str(only.why_incomplete())


@given(zero=st.floats(-50, 50), overlap=st.integers(0, 4))
def test_a_stop_measured_on_both_sides_joins_them(zero, overlap):
    """After the break the program goes back to a stop that was measured before: the readings get
    one zero again."""
    passes = book()
    first, second = stops_of(only=range(5)), stops_of(only=range(overlap, 10), zero=zero)
    passes.add_all([*first, broken(second[0]), *second[1:]])
    (only,) = passes.passes
    assert only.whole
    readings = {index: stop.reading_mm for index, stop in only.chosen().items()}
    assert [readings[k] - readings[0] for k in range(10)] == pytest.approx(
        [stop.reading_mm for stop in stops_of()], abs=1e-9
    )


def test_refused_stops_count_as_missing():
    passes = book()
    stops = stops_of()
    stops[3] = msgspec.structs.replace(stops[3], refused="wrong-axis-order")
    passes.add_all(stops)
    assert passes.passes[0].missing == [3]
    assert "stops 4 are missing" in str(passes.passes[0].why_incomplete())
    passes.add_all(stops_of())
    assert passes.complete()
    assert len(passes.passes) == 1


def unwatched(stop):
    return msgspec.structs.replace(stop, unwatched="no sample was received for 9.0 s")


def test_a_count_that_nobody_watched_is_used_and_doubted():
    passes = book()
    first, second = stops_of(only=range(5)), stops_of(only=range(5, 10))
    passes.add_all([*first, unwatched(second[0]), *second[1:]])
    (only,) = passes.passes
    assert only.whole
    assert [bool(only.doubt(k)) for k in range(10)] == [False] * 5 + [True] * 5
    assert str(only.why_doubtful()).startswith(
        "stops 6–10 may be wrong (no sample was received for 9.0 s before stop 6)"
    )


@given(zero=st.floats(-0.05, 0.05), overlap=st.integers(0, 4))
def test_a_stop_measured_again_ends_the_doubt(zero, overlap):
    """The operator goes back over the place where nobody watched: what the count lost meanwhile is
    now known."""
    passes = book()
    first, second = stops_of(only=range(7)), stops_of(only=range(overlap, 10), zero=zero)
    passes.add_all(
        [
            *first[:5],
            unwatched(
                msgspec.structs.replace(first[5], reading_mm=first[5].reading_mm + zero)
            ),
            *second,
        ]
    )
    (only,) = passes.passes
    assert only.whole
    assert not only.why_doubtful()
    readings = {index: stop.reading_mm for index, stop in only.chosen().items()}
    assert [readings[k] - readings[0] for k in range(10)] == pytest.approx(
        [stop.reading_mm for stop in stops_of()], abs=1e-9
    )


@pytest.mark.parametrize("why", ["broken", "unwatched"])
def test_a_refused_stop_carries_its_break_on(why):
    """The first stop after the break is not used; those after it are of the new stretch all the
    same."""
    passes = book()
    first, second = stops_of(only=range(5)), stops_of(only=range(5, 10))
    second[0] = msgspec.structs.replace(
        second[0], refused="wrong-axis-order", **{why: "something"}
    )
    passes.add_all([*first, *second])
    (only,) = passes.passes
    assert only.missing == ([5] if why == "unwatched" else [5, 6, 7, 8, 9])
    assert [bool(only.doubt(k)) for k in (4, 6)] == [False, why == "unwatched"]


def test_the_journal_hears_reading_and_deviation_of_every_stop():
    passes = book()
    first, *_, last = stops_of()
    passes.add_all(stops_of()[:-1])
    off = msgspec.structs.replace(last, reading_mm=last.reading_mm + 0.005)
    passes.add(off)
    assert passes.last_stop(off) == 9
    assert passes.deviation(off) == (
        pytest.approx(off.reading_mm - first.reading_mm),
        pytest.approx(5.0),
    )
    assert passes.deviation(msgspec.structs.replace(last, reading_mm=None)) == (None, None)


@pytest.mark.parametrize("stop", [None, 4])
def test_what_the_solver_suspects_keeps_its_pass_open_until_it_is_driven_again_or_accepted(
    stop,
):
    """Words in words wherever a doubt is, whether it names a stop or the pass as a whole."""
    passes = book()
    passes.add_all(stops_of())
    taken_ns = max(each.window_from_ns for each in stops_of()) if stop is None else stop
    doubt = Doubt(
        setup="ppp",
        pass_number=1,
        stop=stop,
        code="pass-wanders",
        why="contradicts the others",
        taken_ns=taken_ns,
    )
    passes.suspect([doubt])
    (only,) = passes.passes
    assert passes.doubts() == (doubt,)
    assert not passes.complete()
    assert passes.whole()
    assert (
        str(only.why_incomplete())
        == "contradicts the others: drive the pass again, or accept the finding"
    )
    passes.accept(acceptance_of(doubt, reason="known", name="Kim", time_s=1.0))
    assert passes.complete()
    assert [word.name for _, word in passes.accepted()] == ["Kim"]
