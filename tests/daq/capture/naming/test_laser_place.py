"""A machine that gives no position is placed by the laser's unbroken count: driven again, stopped
between, counted wrong."""

from dataclasses import replace

import pytest

from stepdiag.base.findings import Finding
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.survey.file import parse_survey
from testkit.examples import spread
from testkit.timeline import STOPPED_ONLY, Timeline, diagonal, survey_text

COUNTED = (
    STOPPED_ONLY + "[plc.signals.stop_count]\naddress = 1\n[plc.signals.setup]\naddress = 3\n"
)
SETUP_TOLD = STOPPED_ONLY + "[plc.signals.setup]\naddress = 3\n"
SIGNALS = pytest.mark.parametrize(
    "signals", [STOPPED_ONLY, COUNTED], ids=["stopped", "stopped, setup, stop_count"]
)
BOX, CUBE = (300.0, 200.0, 100.0), (200.0, 200.0, 200.0)
SIZES = pytest.mark.parametrize("size", [BOX, CUBE], ids=["box", "cube"])


def drive(stops, *, signals, size=(300.0, 200.0, 100.0), back=False, n=3, **more):
    """Return the book and the codes of one log, or of several: each pass that ends begins the next
    log."""
    survey = parse_survey(
        survey_text(signals=signals, size=size, back=back, n=n), "survey.toml"
    )
    book, codes = PassBook(survey), []
    capture = Capture(survey, book.start(skip_open_dwell=False))
    for event in Timeline(stops, **more).events():
        outcomes = capture.feed(event)
        book.add_all(each for each in outcomes if isinstance(each, CapturedStop))
        codes += [
            each.code for each in (*outcomes, *book.news()) if isinstance(each, Finding)
        ]
        if any(isinstance(each, Ended) for each in outcomes):
            seen = {"breaks": capture.left_over(), "beyond": capture.went_beyond()}
            capture = Capture(
                survey, book.start(skip_open_dwell=capture.standing is not None, **seen)
            )
    return book, codes


def assert_as_driven(each, truth, within_um=0.6):
    """Every stop in use reads what the machine truly did."""
    chosen = each.chosen()
    assert sorted(chosen) == list(range(len(truth)))
    readings = [chosen[k].reading_mm for k in range(len(truth))]
    for k, true in enumerate(truth):
        assert (
            abs(readings[k] - readings[0] - true.reading + truth[0].reading) * 1e3 < within_um
        ), k


@pytest.mark.parametrize(
    ("signals", "size", "left_at", "again_at"),
    [
        *spread(
            [
                (STOPPED_ONLY, size, *ends)
                for size in (BOX, CUBE)
                for ends in ((4, 0), (4, 3), (5, 0), (6, 0), (6, 4))
            ],
            3,
        ),
        (COUNTED, BOX, 4, 0),
        (COUNTED, CUBE, 4, 3),
        (COUNTED, BOX, 5, 0),
        (COUNTED, CUBE, 6, 0),
        (COUNTED, BOX, 6, 4),
    ],
)
def test_an_aborted_pass_is_driven_again_whole_or_from_a_stop(
    signals, size, left_at, again_at
):
    truth = diagonal("ppp", size)
    book, codes = drive(
        [*truth[: left_at + 1], *truth[again_at:]], signals=signals, size=size
    )
    (only,) = book.passes
    assert_as_driven(only, truth)
    assert "stop-again" in codes
    assert not only.doubts()
    assert [len(only.measured[k]) for k in range(10)] == [
        1 + (again_at <= k <= left_at) for k in range(10)
    ]


@SIGNALS
@SIZES
def test_a_feed_hold_between_two_stops_is_no_stop(signals, size):
    truth = diagonal("ppp", size)
    between = replace(
        truth[5], reading=0.5 * (truth[4].reading + truth[5].reading) + 3.0, counts=0
    )
    book, codes = drive([*truth[:5], between, *truth[5:]], signals=signals, size=size)
    (only,) = book.passes
    assert_as_driven(only, truth)
    assert codes.count("between-stops") == 1
    assert not only.doubts()


@pytest.mark.parametrize("signals", ["", COUNTED], ids=["with positions", "without"])
def test_a_stuck_counter_is_named_and_costs_nothing(signals):
    truth = [replace(stop, counts=0) for stop in diagonal("ppp")]
    book, codes = drive(truth, signals=signals)
    (only,) = book.passes
    assert_as_driven(only, truth)
    assert codes.count("count-stuck") == 1
    assert "count-disagrees" not in codes


@SIGNALS
def test_a_return_pass_left_in_the_middle_and_the_whole_program_again(signals):
    """Out, half of back, and the whole setup once more: no stop of one direction stands in a pass
    of the other."""
    out, back = diagonal("ppp"), diagonal("ppp", back=True)
    book, _ = drive([*out, *back[:4], *out, *back], signals=signals, back=True, noise_um=0.1)
    second = next(each for each in book.passes if each.number == 2)
    assert_as_driven(second, back)
    for each in book.passes:
        for stop in each.chosen().values():
            place = stop.stop if stop.outward else 9 - stop.stop
            offset = each.zeros()[each.measured[stop.stop][-1].stretch].offset_mm
            assert abs(stop.reading_mm - out[place].reading) < 0.01 + abs(offset)


@pytest.mark.parametrize(
    "signals", [STOPPED_ONLY, SETUP_TOLD], ids=["stopped", "stopped, setup"]
)
def test_a_quick_turn_is_another_standstill(signals):
    """Over the end and back in a third of a second: the return pass begins with what it reads
    there, 4 µm of backlash away."""
    out, back = (
        diagonal("ppp"),
        [replace(stop, reading=stop.reading - 0.004) for stop in diagonal("ppp", back=True)],
    )
    beyond = replace(
        out[-1], reading=out[-1].reading + 2.0, seconds=0.03, shown=False, counts=0
    )
    book, codes = drive([*out, beyond, *back], signals=signals, back=True, move_s=0.1)
    first, second = book.passes
    assert_as_driven(first, out)
    assert_as_driven(second, back)
    assert second.chosen()[0].reading_mm - first.chosen()[9].reading_mm == pytest.approx(
        -0.004, abs=6e-4
    )
    assert not set(codes) & {"stop-again", "between-stops", "reading-differs"}


@SIGNALS
@pytest.mark.parametrize("left_at", [3, 4])
def test_a_pass_left_and_begun_anew_after_the_beam_was_cut_is_that_pass(signals, left_at):
    """Nobody says where the machine stands, but the steps that follow are those of the
    beginning."""
    truth = diagonal("ppp")
    moved = [replace(stop, reading=stop.reading + 2.7) for stop in truth]
    cut = 1.0 + 1.3 * (left_at + 1) - 0.4
    book, codes = drive(
        [*truth[: left_at + 1], *moved],
        signals=signals,
        beam_lost=[(cut, cut + 0.2)],
        lost_mm=0.0,
    )
    (only,) = book.passes
    assert_as_driven(only, truth)
    assert only.complete, only.why_incomplete()
    assert "stop-again" in codes


@SIGNALS
@SIZES
def test_a_machine_that_stood_elsewhere_before_its_first_stop(signals, size):
    """Its stop signal means standstill, and it waits at home until the program is called."""
    truth = diagonal("ppp", size)
    home = replace(truth[0], reading=-40.0)
    book, _ = drive([home, *truth], signals=signals, size=size)
    (only,) = book.passes
    assert_as_driven(only, truth)
    assert only.complete, only.why_incomplete()


def test_where_nobody_can_tell_the_stops_are_doubted():
    """A cube by `stopped` alone, left at the last stop but one, the beam cut, begun anew: its first
    stop reads as the last one would.

    The pass once showed "complete" and was 404 mm wrong.
    """
    truth = diagonal("ppp", (200.0, 200.0, 200.0), 2)
    cut = 1.0 + 1.3 * 6 - 0.4
    book, codes = drive(
        [*truth[:6], truth[0]],
        signals=STOPPED_ONLY,
        size=(200.0,) * 3,
        n=2,
        beam_lost=[(cut, cut + 0.2)],
        lost_mm=2.7,
    )
    assert not book.complete()
    assert "place-unknown" in codes
    assert "drive the whole pass again" in str(book.passes[0].why_incomplete())


@pytest.mark.parametrize(("n", "left_at"), [(1, 2), (2, 5), (2, 4)])
def test_what_was_taken_for_the_last_stops_is_the_first_where_the_machine_goes_on_beyond_them(
    n, left_at
):
    """No step leads on from the last stop, so the log that follows knows that the pass was begun
    anew: it ends right by itself.

    Its stops were once taken one off, none of them doubted, however often the whole pass was driven
    again.
    """
    size = (200.0,) * 3
    truth = [
        replace(stop, reading=stop.reading + 0.01 * (k * k % 5))
        for k, stop in enumerate(diagonal("ppp", size, n))
    ]
    cut = 1.0 + 1.3 * (left_at + 1) - 0.4
    stops = [*truth[: left_at + 1], *truth]
    book, codes = drive(
        stops, signals=STOPPED_ONLY, size=size, n=n, beam_lost=[(cut, cut + 0.2)], lost_mm=2.7
    )
    assert "stop-again" in codes
    (only,) = book.passes
    assert_as_driven(only, truth)
    assert only.complete, only.why_incomplete()


def test_a_pass_restarted_where_nobody_can_tell_is_right_once_it_was_driven_again_whole():
    """A cube by `stopped` alone, left at stop 4, restarted at stop 2, then driven whole, the beam
    cut before both."""
    size = (200.0,) * 3
    truth = [
        replace(stop, reading=stop.reading + 0.01 * (k * k % 5))
        for k, stop in enumerate(diagonal("ppp", size, 2))
    ]
    cuts = [1.0 + 1.3 * begun - 0.4 for begun in (5, 10)]
    lost = [(cut, cut + 0.2) for cut in cuts]
    book, _ = drive(
        [*truth[:5], *truth[2:], *truth],
        signals=STOPPED_ONLY,
        size=size,
        n=2,
        beam_lost=lost,
        lost_mm=2.7,
    )
    (only,) = book.passes
    assert_as_driven(only, truth)
    assert only.complete, only.why_incomplete()


@SIGNALS
def test_a_count_lost_unseen_never_joins_what_it_does_not_reach(signals):
    """The laser jumps by 5 mm on the way to a stop: everything from there on is asked for again."""
    truth = [
        replace(stop, reading=stop.reading + 5.0 * (k >= 4))
        for k, stop in enumerate(diagonal("ppp"))
    ]
    book, codes = drive(truth, signals=signals)
    (only,) = book.passes
    assert set(only.missing) >= {5, 6, 7, 8, 9}
    assert not only.whole
    assert {"step-mismatch", "between-stops"} & set(codes)
    assert "drive the whole pass again" in str(only.why_incomplete())
