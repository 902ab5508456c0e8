"""The synchroniser on whole passes: every stop right, or named as doubtful, or asked for again;
never silently wrong."""

import sys
from dataclasses import replace
from pathlib import Path
from random import Random

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.findings import Finding
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.records.events import Chunk, LinkEvent, Loss
from stepdiag.daq.survey.file import parse_survey
from testkit.examples import few
from testkit.timeline import STOPPED_ONLY, Timeline, arrival, diagonal, skipped, survey_text


def run(events, *, text=None, start=None):
    """Return (stops, finding codes, ends) of a capture fed with events."""
    survey = parse_survey(text or survey_text(), "survey.toml")
    capture = Capture(survey, start or PassBook(survey).start(skip_open_dwell=False))
    outcomes = [
        outcome for event in events for outcome in capture.feed(event)
    ] + capture.finish()
    return (
        [each for each in outcomes if isinstance(each, CapturedStop)],
        [each.code for each in outcomes if isinstance(each, Finding)],
        [each for each in outcomes if isinstance(each, Ended)],
    )


def assert_right(stops, truth, *, within_um=0.6):
    """Every stop reads what the machine truly did, relative to the first."""
    assert [stop.stop for stop in stops] == list(range(len(truth)))
    for stop, true in zip(stops, truth, strict=True):
        assert (
            abs((stop.reading_mm - stops[0].reading_mm) - (true.reading - truth[0].reading))
            * 1e3
            < within_um
        )
        assert stop.position_mm == pytest.approx(true.position, abs=1e-4)


def test_a_machine_on_its_way_is_on_its_way_to_the_next_stop():
    """A stop is taken a moment after the machine has left it: meanwhile the page still measures it,
    and does not show the way to a stop that lies behind."""
    truth = diagonal("ppp")
    played = Timeline(truth, move_s=1.0)
    survey = parse_survey(survey_text(), "survey.toml")
    capture = Capture(survey, PassBook(survey).start(skip_open_dwell=False))
    stands = played.schedule()
    on_the_way = set()
    for event in played.events():
        capture.feed(event)
        now_s = arrival(event) * 1e-9
        stood = sum(end < now_s for _, end in stands)
        moves = stood > 0 and all(now_s < begin or now_s > end for begin, end in stands)
        if moves and capture.walk is not None and not (capture.at_stop or capture.ended):
            on_the_way.add(stood - capture.walk.expected)
    assert on_the_way == {0}


@few(4)
@given(
    seed=st.integers(0, 10_000),
    setup=st.sampled_from(["ppp", "npp", "pnp", "ppn"]),
    signals=st.sampled_from(["", STOPPED_ONLY]),
)
def test_a_clean_pass_is_captured_whole(seed, setup, signals):
    """Seven stops in order, each within its noise, over the wrap of the stop counter; with
    `stopped` alone as well."""
    truth = diagonal(setup, n=2)
    stops, codes, ends = run(
        Timeline(truth, seed=seed).events(),
        text=survey_text(setups=(setup,), signals=signals, n=2),
    )
    assert_right(stops, truth)
    assert codes == (["signals-absent", "signals-absent"] if signals else [])
    assert [end.kind for end in ends] == ["complete"]
    assert all(0 < stop.u_um < 0.2 and not stop.doubts and not stop.broken for stop in stops)


@few(4)
@given(seed=st.integers(0, 1000), cuts=st.integers(0, 1000))
def test_the_result_does_not_depend_on_how_the_bytes_were_cut(seed, cuts):
    """The same bytes in other chunks with the same last arrival give the same stops to the last
    bit."""
    events, text = Timeline(diagonal("ppp", n=1), seed=seed).events(), survey_text(n=1)
    whole, _, _ = run(events, text=text)
    assert len(whole) == 4
    cut, knife = [], Random(cuts)
    for event in events:
        if isinstance(event, Chunk) and knife.random() < 0.5:
            at = knife.randint(0, len(event.data))
            cut += [
                msgspec.structs.replace(event, data=part)
                for part in (event.data[:at], event.data[at:])
            ]
        else:
            cut.append(event)
    again, _, _ = run(cut, text=text)
    assert [(s.stop, s.window_from_ns, s.window_to_ns) for s in again] == [
        (s.stop, s.window_from_ns, s.window_to_ns) for s in whole
    ]
    assert [s.reading_mm for s in again] == pytest.approx(
        [s.reading_mm for s in whole], abs=1e-4
    )


def babbled(timeline, moment):
    """Return the events of a timeline with bytes on the laser's line that no instrument sends, at
    the moment of a chunk."""
    events = timeline.events()
    chunk = next(
        each for each in events if isinstance(each, Chunk) and each.arrival_ns > moment * 1e9
    )
    return [
        msgspec.structs.replace(each, data=b"what is that\r\n" + each.data)
        if each is chunk
        else each
        for each in events
    ]


def test_what_a_stream_remarks_is_said_within_a_second():
    """Not only with the next stop: a machine that stands for ever at the wrong place has none."""
    survey = parse_survey(survey_text(), "survey.toml")
    capture = Capture(survey, PassBook(survey).start(skip_open_dwell=False))
    timeline = Timeline(diagonal("ppp")[:1], lead_s=4.0)
    said_s = next(
        arrival(event) * 1e-9 for event in babbled(timeline, 1.3) if capture.feed(event)
    )
    assert 1.3 < said_s < 2.4


def test_what_a_stream_remarks_last_is_said_with_the_end():
    """Of a log that somebody ends, and of a pass that the program leaves: before that."""
    survey = parse_survey(survey_text(), "survey.toml")
    capture = Capture(survey, PassBook(survey).start(skip_open_dwell=False))
    timeline = Timeline(diagonal("ppp")[:1], lead_s=4.0)
    assert not [
        outcome
        for event in babbled(timeline, 1.3)
        if arrival(event) < 1.35e9
        for outcome in capture.feed(event)
    ]
    assert [outcome.code for outcome in capture.finish()] == ["bytes-garbled"]
    timeline = Timeline(diagonal("ppp")[:2])
    left_s = timeline.schedule()[-1][1] + 0.3
    capture = Capture(survey, PassBook(survey).start(skip_open_dwell=False))
    outcomes = [
        outcome
        for event in babbled(timeline, left_s - 0.02)
        for outcome in capture.feed(event)
    ]
    assert [type(outcome) for outcome in outcomes] == [
        CapturedStop,
        CapturedStop,
        Finding,
        Ended,
    ]


def test_what_a_stream_remarks_comes_before_what_was_lost_after_it():
    survey = parse_survey(survey_text(), "survey.toml")
    capture = Capture(survey, PassBook(survey).start(skip_open_dwell=False))
    events = [
        event
        for event in babbled(Timeline(diagonal("ppp")[:1], lead_s=4.0), 1.3)
        if arrival(event) < 1.35e9
    ]
    loss = Loss(1_350_000_000, 5, 60, "the disk is full")
    assert [outcome.code for event in (*events, loss) for outcome in capture.feed(event)] == [
        "bytes-garbled",
        "recording-gap",
    ]


@few(6)
@given(
    away_ms=st.integers(50, 300),
    stop=st.integers(1, 9),
    lost=st.sampled_from(["link", "recording"]),
)
def test_bytes_that_nobody_saw_are_a_time_without_a_watch_on_the_laser(away_ms, stop, lost):
    """The beam is cut for 10 ms meanwhile and 15 µm are gone: too little for the geometry, so the
    stop after it is named."""
    truth = diagonal("ppp")
    begins = Timeline(truth).schedule()[stop][0] - 0.45
    timeline = Timeline(truth, beam_lost=[(begins + 0.01, begins + 0.02)], lost_mm=0.015)
    begin_ns, end_ns = (int((begins + away_s) * 1e9) for away_s in (0.0, away_ms * 1e-3))
    seen = [
        each
        for each in timeline.events()
        if not (isinstance(each, Chunk) and begin_ns <= arrival(each) < end_ns)
    ]
    gone = {
        "link": [
            LinkEvent(begin_ns, "laser", "lost", "gone"),
            LinkEvent(end_ns, "laser", "connected", ""),
        ],
        "recording": [Loss(end_ns, 5, 60, "the disk is full")],
    }
    stops, codes, _ = run(sorted([*seen, *gone[lost]], key=arrival))
    assert [each.stop for each in stops if each.unwatched] == [stop]
    assert "laser-unwatched" in codes
    book = PassBook(parse_survey(survey_text(), "survey.toml"))
    book.add_all(stops)
    assert [bool(book.passes[0].doubt(index)) for index in range(10)] == [
        index >= stop for index in range(10)
    ]


DOWN = "the laser's link is down: no stop has a reading until the link is back"


@pytest.mark.parametrize("before", [False, True], ids=["in the log", "before the log"])
def test_a_link_that_is_down_is_named_once_in_place_of_every_stop_without_a_reading(before):
    """Nobody dwells longer forty times because a plug is out. One finding an outage, also of one
    that the log does not hold."""
    timeline = Timeline(diagonal("ppp"))
    away_ns, back_ns = (int(timeline.schedule()[at][0] * 1e9) + 100_000_000 for at in (0, 6))
    events = [
        each
        for each in timeline.events()
        if not (isinstance(each, Chunk) and arrival(each) < back_ns)
    ]
    events.append(LinkEvent(back_ns, "laser", "connected", ""))
    events += [] if before else [LinkEvent(away_ns, "laser", "lost", "gone")]
    survey = parse_survey(survey_text(), "survey.toml")
    start = msgspec.structs.replace(
        PassBook(survey).start(skip_open_dwell=False), down=("laser",) if before else ()
    )
    capture = Capture(survey, start)
    found = [
        each for event in sorted(events, key=arrival) for each in capture.feed(event)
    ] + capture.finish()
    said = [(each.code, each.text) for each in found if isinstance(each, Finding)]
    assert [code for code, text in said if DOWN in text] == ["samples-missing"]
    assert "stop-without-reading" not in [code for code, _ in said]
    assert [each.stop for each in found if isinstance(each, CapturedStop)] == [6, 7, 8, 9]


def test_a_stop_without_a_reading_while_the_link_is_up_is_named_as_such():
    """Samples out of range all through a dwell: that is the beam's matter, or the dwell's, and each
    stop is named."""
    truth = diagonal("ppp")
    begin, end = Timeline(truth).schedule()[4]
    timeline = Timeline(truth, beam_lost=[(begin - 0.1, end + 0.1)])
    stops, codes, _ = run(timeline.events())
    assert "stop-without-reading" in codes
    assert "samples-missing" not in codes
    assert 4 not in [each.stop for each in stops]


def test_only_standing_samples_are_used():
    """A move at 10 m/min puts 167 µm into a millisecond: no window may touch one."""
    timeline = Timeline(diagonal("ppp"), seed=3)
    stops, _, _ = run(timeline.events())
    for stop, (begin, end) in zip(stops, timeline.schedule(), strict=True):
        assert begin + 0.15 <= stop.window_from_ns * 1e-9
        assert stop.window_to_ns * 1e-9 <= end


@pytest.mark.parametrize("signals", ["", STOPPED_ONLY])
@pytest.mark.parametrize("index", [3, 8])
def test_a_stop_that_modbus_missed_is_recovered_and_marked(index, signals):
    truth = diagonal("npp")
    stops, codes, ends = run(
        Timeline(skipped(truth, index)).events(),
        text=survey_text(setups=("npp",), signals=signals),
    )
    assert_right(stops, truth)
    assert stops[index].recovered
    assert "found in the laser's readings" in str(stops[index].why())
    assert "stop-recovered" in codes
    assert sum(stop.recovered for stop in stops) == 1
    assert ends[0].kind == "complete"


def test_a_stop_that_nobody_saw_is_lost_by_name():
    """The machine drove past without standing: the counter went on, the laser shows no plateau."""
    truth = diagonal("ppp")
    hurried = [
        replace(stop, seconds=0.02 if k == 4 else 0.8, shown=k != 4)
        for k, stop in enumerate(truth)
    ]
    stops, codes, _ = run(Timeline(hurried).events())
    assert [stop.stop for stop in stops] == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert "stop-lost" in codes


def test_polls_lost_in_a_dwell_do_not_lose_the_stop():
    truth = diagonal("ppp")
    timeline = Timeline(truth)
    begin, end = timeline.schedule()[5]
    stops, codes, _ = run(replace(timeline, poll_gaps=[(begin + 0.1, begin + 0.5)]).events())
    assert_right(stops, truth)
    assert codes == []
    del end


def test_wrong_laser_sign_is_named_at_the_first_step():
    mirrored = [replace(stop, reading=-stop.reading) for stop in diagonal("ppp")]
    stops, codes, _ = run(Timeline(mirrored).events())
    assert codes[0] == "wrong-laser-sign"
    assert stops[1].refused == "wrong-laser-sign"


def test_wrong_axis_order_is_named_by_position_and_without_it_by_the_step():
    """The program moves y before x: named once, at the third stop, with positions and without."""
    truth = diagonal("ppp")
    place = (0.0, 200.0 / 3, 0.0)
    size = (300.0**2 + 200.0**2 + 100.0**2) ** 0.5
    swapped = [
        truth[0],
        replace(truth[1], position=place, reading=200.0 / 3 * 200.0 / size),
        *truth[2:],
    ]
    assert run(Timeline(swapped).events())[1] == ["wrong-axis-order"]
    stops, codes, _ = run(Timeline(swapped).events(), text=survey_text(signals=STOPPED_ONLY))
    assert codes.count("wrong-axis-order") == 1
    assert stops[1].refused


def test_a_stop_counted_twice_is_measured_again_not_numbered_anew():
    truth = diagonal("ppp")
    doubled = [*truth[:5], replace(truth[4]), *truth[5:]]
    for signals in ("", STOPPED_ONLY):
        stops, codes, ends = run(
            Timeline(doubled, move_s=0.3).events(), text=survey_text(signals=signals)
        )
        assert [stop.stop for stop in stops] == [0, 1, 2, 3, 4, 4, 5, 6, 7, 8, 9]
        assert {"stop-again", "no-move"} & set(codes) or signals
        assert ends[0].kind == "complete"


def test_beam_lost_between_stops_breaks_the_count_there():
    truth = diagonal("ppp")
    timeline = Timeline(truth)
    gap = timeline.schedule()[4][1] + 0.1
    stops, codes, _ = run(replace(timeline, beam_lost=[(gap, gap + 0.1)]).events())
    assert codes.count("beam-lost") == 1
    assert [stop.stop for stop in stops if stop.broken] == [5]
    assert "beam lost" in str(stops[5].broken)


def whole_of(stops):
    """Return the only pass of a survey with these stops."""
    book = PassBook(parse_survey(survey_text(), "survey.toml"))
    book.add_all(stops)
    (only,) = book.passes
    return only


def assert_joined(each, truth, *, within_um=0.6):
    """Every stop of a pass reads what the machine truly did, once its stretches have one zero."""
    chosen = each.chosen()
    assert sorted(chosen) == list(range(len(truth)))
    readings = [chosen[k].reading_mm for k in range(len(truth))]
    for k, true in enumerate(truth):
        assert (
            abs(readings[k] - readings[0] - true.reading + truth[0].reading) * 1e3 < within_um
        ), k


def test_beam_lost_in_a_dwell_is_measured_on_both_sides_and_costs_nothing():
    """The machine stood all the while: the readings before and after tell by how much the count
    went wrong."""
    truth = diagonal("ppp")
    timeline = Timeline([replace(stop, seconds=1.2) for stop in truth])
    begin, _ = timeline.schedule()[4]
    stops, codes, _ = run(replace(timeline, beam_lost=[(begin + 0.5, begin + 0.6)]).events())
    assert "beam-lost" in codes
    assert [stop.stop for stop in stops] == [0, 1, 2, 3, 4, 4, 5, 6, 7, 8, 9]
    assert stops[4].window_to_ns * 1e-9 < begin + 0.51
    assert stops[5].window_from_ns * 1e-9 > begin + 0.6
    assert_joined(whole_of(stops), truth)


def test_beam_lost_too_early_in_a_dwell_breaks_the_count_there():
    truth = diagonal("ppp")
    timeline = Timeline([replace(stop, seconds=1.2) for stop in truth])
    begin, _ = timeline.schedule()[4]
    stops, codes, _ = run(replace(timeline, beam_lost=[(begin + 0.16, begin + 0.3)]).events())
    assert "beam-lost" in codes
    assert [stop.stop for stop in stops if stop.broken] == [4]
    assert stops[4].window_from_ns * 1e-9 > begin + 0.3
    assert "from stop 4 on" in str(whole_of(stops).why_incomplete())


def unseen(timeline, begin, end):
    """Return the events of a timeline without those of a span in which nobody looked."""
    return [event for event in timeline.events() if not begin < arrival(event) * 1e-9 < end]


def test_a_beam_lost_while_nobody_looked_is_doubted_from_there_on():
    """The process was stopped during a move, and the beam was cut meanwhile: the data cannot tell,
    so the person is told."""
    truth = [replace(stop, seconds=3.0) for stop in diagonal("ppp")]
    timeline = Timeline(truth)
    begin = timeline.schedule()[3][1] + 0.1
    stops, codes, _ = run(
        unseen(
            replace(timeline, beam_lost=[(begin + 0.7, begin + 0.8)], lost_mm=0.05),
            begin,
            begin + 1.5,
        )
    )
    assert codes == ["samples-missing", "laser-unwatched"]
    only = whole_of(stops)
    assert [stop.stop for stop in stops if stop.unwatched] == [4]
    assert only.whole
    assert [k for k in range(10) if only.doubt(k)] == [4, 5, 6, 7, 8, 9]
    assert "no sample was received for 1.5 s before stop 5" in str(only.why_doubtful())
    assert "drive again from stop 4 on" in str(only.why_doubtful())


def test_a_beam_lost_while_nobody_looked_in_a_dwell_costs_nothing():
    truth = [replace(stop, seconds=3.0) for stop in diagonal("ppp")]
    timeline = Timeline(truth)
    begin = timeline.schedule()[4][0] + 0.8
    stops, codes, _ = run(
        unseen(replace(timeline, beam_lost=[(begin + 0.3, begin + 0.4)]), begin, begin + 1.0)
    )
    assert "laser-unwatched" in codes
    only = whole_of(stops)
    assert_joined(only, truth)
    assert not only.why_doubtful()


def test_a_loss_after_the_last_stop_of_a_log_counts_for_the_log_that_goes_on():
    """The program is left in the middle, the beam is cut while nothing is recorded, the program
    goes on."""
    truth = diagonal("ppp")
    survey = parse_survey(survey_text(), "survey.toml")
    first = Timeline(truth[:5])
    capture = Capture(survey, PassBook(survey).start(skip_open_dwell=False))
    departure = first.schedule()[4][1]
    outcomes = [
        outcome
        for event in replace(first, beam_lost=[(departure + 0.1, departure + 0.2)]).events()
        for outcome in capture.feed(event)
    ]
    book = PassBook(survey)
    book.add_all(each for each in outcomes if isinstance(each, CapturedStop))
    stops, codes, _ = run(
        Timeline(truth[5:], first_count=65535).events(),
        start=book.start(skip_open_dwell=False, breaks=capture.left_over()),
    )
    assert codes[0] == "beam-lost"
    assert [stop.stop for stop in stops if stop.broken] == [5]


def test_a_laser_set_to_zero_is_named():
    truth = diagonal("ppp")
    timeline = Timeline(truth)
    moment = timeline.schedule()[6][0] + 0.05
    stops, codes, _ = run(replace(timeline, zeroed_at=[moment]).events())
    assert "laser-reset" in codes
    assert stops[6].broken


def test_plc_started_again_with_its_counter_at_zero():
    truth = diagonal("ppp")
    reset = [replace(stop, counts=-20_005 if k == 5 else 1) for k, stop in enumerate(truth)]
    stops, codes, _ = run(Timeline(reset, first_count=20_000).events())
    assert_right(stops, truth)
    assert "count-disagrees" in codes


def test_a_program_left_in_the_middle_ends_the_pass():
    stops, _, ends = run(Timeline(diagonal("ppp")[:6]).events())
    assert len(stops) == 6
    assert ends[0].kind == "aborted"
    assert "stop 6 of 10" in str(ends[0].reason)


def test_an_unplanned_setup_is_refused_by_name_once():
    stops, codes, _ = run(
        Timeline(diagonal("pnp")).events(), text=survey_text(setups=("ppp", "npp"))
    )
    assert stops == []
    assert codes == ["unplanned-setup"]


def test_a_vibrating_stop_is_doubtful():
    stops, codes, _ = run(Timeline(diagonal("ppp"), noise_um=8.0).events())
    assert codes.count("stop-doubtful") == 10
    assert "scatter" in str(stops[0].why())


def test_a_dwell_without_beam_gives_no_reading_and_says_so():
    timeline = Timeline(diagonal("ppp"))
    begin, end = timeline.schedule()[4]
    stops, codes, _ = run(replace(timeline, beam_lost=[(begin - 0.2, end + 0.2)]).events())
    assert "stop-without-reading" in codes
    assert 4 not in [stop.stop for stop in stops]


DECODING = {"instruments", "framing", "samples.py"}
MOST_MODULES = 12


def test_a_stop_that_nothing_disturbs_passes_few_modules():
    """Beside those that decode its samples. The first stops are judged together, the last ends the
    pass."""
    survey, root = (
        parse_survey(survey_text(), "survey.toml"),
        Path(sys.modules[Capture.__module__].__file__).parents[2],
    )
    capture, made = Capture(survey, PassBook(survey).start(skip_open_dwell=False)), []
    for event in Timeline(diagonal("ppp")).events():
        passed = set()
        sys.setprofile(
            lambda frame, what, _, passed=passed: (
                passed.add(frame.f_code.co_filename) if what == "call" else None
            )
        )
        try:
            outcomes = capture.feed(event)
        finally:
            sys.setprofile(None)
        own = [
            path
            for each in passed
            if (path := Path(each)).is_relative_to(root) and not DECODING & set(path.parts)
        ]
        made += [len(own) for each in outcomes if isinstance(each, CapturedStop)]
    assert len(made) == 10
    assert max(made[4:-1]) <= MOST_MODULES, made
