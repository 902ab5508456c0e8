"""Stops of a 4-DOF run: placed by the head's own stream, whatever the laser sees; blocked and
saturated light is named."""

import struct
from dataclasses import dataclass, field

import numpy as np
import pytest

from stepdiag.base.findings import Finding
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.records.events import Chunk
from stepdiag.daq.survey.file import parse_survey
from stepdiag.virtual.instruments.head_wire import frame_checksum
from testkit.exact.heads import survey_section
from testkit.timeline import STOPPED_ONLY, Standstill, Timeline, arrival, survey_text

RATE_HZ = 200.0
FULL = 1_000_000
SPOT = 0.8
"""Normalised reading a millimetre of target movement."""
HEAD_Z = [(0.0, 0.0, 100.0 / 3 * k) for k in range(4)]


def text(*, signals="", back=False):
    head = survey_section("/dev/null1").replace("rate_hz = 250.0", f"rate_hz = {RATE_HZ}")
    return survey_text(setups=("fourdof-z",), back=back, signals=signals + head)


def stands(**changes):
    return [Standstill(place, place[2], 23, **changes) for place in HEAD_Z]


@dataclass
class HeadLine:
    """Frames of a head whose target stands at ``lateral_um`` (x, y) at each stop of the timeline,
    and swings in after each move."""

    timeline: Timeline
    lateral_um: list
    swing_um: float = 5.0
    noise_um: float = 0.3
    dark: list = field(default_factory=list)
    """Spans in seconds without light."""
    saturated: list = field(default_factory=list)

    def chunks(self):
        """Return the frames in chunks of 20 ms."""
        rng = np.random.default_rng(9)
        time = np.arange(0.0, self.timeline.duration, 1 / RATE_HZ)
        frames = [self.frame(k, t, rng) for k, t in enumerate(time)]
        return [
            Chunk(
                "head",
                int((time[min(k + 4, len(time) - 1)] + 0.002) * 1e9),
                b"".join(frames[k : k + 4]),
            )
            for k in range(0, len(time), 4)
        ]

    def frame(self, counter, t, rng):
        times = self.timeline.schedule()
        begun = [k for k, (begin, _) in enumerate(times) if begin <= t]
        index = begun[-1] if begun else 0
        swing = self.swing_um * np.exp(-max(t - times[index][0], 0.0) / 0.03)
        lateral = np.array(self.lateral_um[index]) + swing + rng.normal(0.0, self.noise_um, 2)
        light = 0.0 if any(a <= t < b for a, b in self.dark) else 1.0
        values = []
        for spot in (SPOT * 1e-3 * lateral, np.zeros(2), np.zeros(2)):
            values += [*np.round(light * FULL * spot).astype(int).tolist(), int(light * FULL)]
        status = int(any(a <= t < b for a, b in self.saturated))
        body = struct.pack("<cBI9i", b"i", status, counter, *values)
        return b"\xf4\xd0" + body + struct.pack("<H", frame_checksum(body))


def run(events, survey_file):
    survey = parse_survey(survey_file, "survey.toml")
    capture = Capture(survey, PassBook(survey).start(skip_open_dwell=False))
    outcomes = [
        outcome for event in sorted(events, key=arrival) for outcome in capture.feed(event)
    ] + capture.finish()
    stops = [each for each in outcomes if isinstance(each, CapturedStop)]
    return (
        stops,
        [each for each in outcomes if isinstance(each, Finding)],
        [each for each in outcomes if isinstance(each, Ended)],
    )


LATERAL = [(0.0, 0.0), (12.0, -7.0), (-30.0, 4.0), (55.0, 20.0)]


def assert_right(stops):
    assert [stop.stop for stop in stops] == [0, 1, 2, 3]
    for stop, (x, y) in zip(stops, LATERAL, strict=True):
        seen = np.array(stop.channels[:2]) / stop.channels[2] / SPOT * 1e3
        assert seen == pytest.approx([x, y], abs=0.2)
        assert all(0 < u < 500 for u in stop.u_channels[:2])


@pytest.mark.parametrize("signals", ["", STOPPED_ONLY])
def test_a_run_is_captured_without_any_laser(signals):
    timeline = Timeline(stands())
    stops, findings, ends = run(
        [*HeadLine(timeline, LATERAL).chunks(), *timeline.polls()], text(signals=signals)
    )
    assert_right(stops)
    assert [each.code for each in findings] == (
        ["signals-absent", "signals-absent"] if signals else []
    )
    assert [end.kind for end in ends] == ["complete"]
    assert all(
        stop.reading_mm is None and not stop.broken and not stop.doubts for stop in stops
    )


def test_a_laser_along_the_axis_gives_the_distance_and_judges_nothing():
    """A laser that is cut between the stops, or looks elsewhere, spoils no stop of the head."""
    timeline = Timeline(stands())
    cut = timeline.schedule()[1][1] + 0.1
    laser = Timeline(stands(), beam_lost=[(cut, cut + 0.1)]).laser()
    stops, findings, _ = run(
        [*HeadLine(timeline, LATERAL).chunks(), *laser, *timeline.polls()], text()
    )
    assert_right(stops)
    assert findings == []
    assert stops[1].reading_mm - stops[0].reading_mm == pytest.approx(100.0 / 3, abs=1e-3)
    elsewhere = Timeline([Standstill(place, 0.0, 23) for place in HEAD_Z]).laser()
    stops, findings, _ = run(
        [*HeadLine(timeline, LATERAL).chunks(), *elsewhere, *timeline.polls()], text()
    )
    assert_right(stops)
    assert findings == []


def test_light_blocked_all_through_a_dwell_costs_the_stop_and_is_named():
    timeline = Timeline(stands())
    begin, end = timeline.schedule()[2]
    stops, findings, _ = run(
        [
            *HeadLine(timeline, LATERAL, dark=[(begin - 0.1, end + 0.1)]).chunks(),
            *timeline.polls(),
        ],
        text(),
    )
    assert [stop.stop for stop in stops] == [0, 1, 3]
    assert [finding.code for finding in findings] == [
        "fourdof-beam-blocked",
        "stop-without-reading",
    ]
    assert "(fourdof-z) out, stop 3 of 4" in findings[0].text


def test_light_blocked_between_the_stops_costs_nothing():
    """A quadrant detector does not count: there is nothing to lose on the way."""
    timeline = Timeline(stands())
    gap = timeline.schedule()[1][1] + 0.1
    stops, findings, _ = run(
        [*HeadLine(timeline, LATERAL, dark=[(gap, gap + 0.2)]).chunks(), *timeline.polls()],
        text(),
    )
    assert_right(stops)
    assert findings == []


def test_light_blocked_for_a_moment_of_a_dwell_is_named_and_the_rest_used():
    timeline = Timeline(stands(seconds=1.5))
    begin, _ = timeline.schedule()[2]
    stops, findings, _ = run(
        [
            *HeadLine(timeline, LATERAL, dark=[(begin + 0.3, begin + 0.4)]).chunks(),
            *timeline.polls(),
        ],
        text(),
    )
    assert_right(stops)
    assert [finding.code for finding in findings] == ["fourdof-beam-blocked"]
    assert stops[2].window_from_ns * 1e-9 > begin + 0.4


def test_saturation_is_named():
    timeline = Timeline(stands())
    begin, _ = timeline.schedule()[1]
    stops, findings, _ = run(
        [
            *HeadLine(timeline, LATERAL, saturated=[(begin, begin + 0.3)]).chunks(),
            *timeline.polls(),
        ],
        text(),
    )
    assert_right(stops)
    assert [finding.code for finding in findings] == ["fourdof-out-of-range"]


def test_a_target_that_will_not_come_to_rest_is_doubtful():
    timeline = Timeline(stands())
    stops, findings, _ = run(
        [*HeadLine(timeline, LATERAL, noise_um=15.0).chunks(), *timeline.polls()], text()
    )
    assert {finding.code for finding in findings} == {"stop-doubtful"}
    assert len(stops) == 4
    assert "scatter" in str(stops[0].why())


def test_the_way_back_makes_the_second_pass():
    timeline = Timeline([*stands(), *stands()[::-1]])
    survey = parse_survey(text(back=True), "survey.toml")
    book = PassBook(survey)
    events = sorted(
        [*HeadLine(timeline, [*LATERAL, *LATERAL[::-1]]).chunks(), *timeline.polls()],
        key=arrival,
    )
    capture = Capture(survey, book.start(skip_open_dwell=False))
    for event in events:
        if capture.ended is not None:
            capture = Capture(survey, book.start(skip_open_dwell=False))
        book.add_all(each for each in capture.feed(event) if isinstance(each, CapturedStop))
    book.add_all(each for each in capture.finish() if isinstance(each, CapturedStop))
    assert [(each.number, each.complete) for each in book.passes] == [(1, True), (2, True)]
    assert book.complete()


def test_garbage_from_the_head_is_named_once():
    timeline = Timeline(stands())
    noise = [Chunk("head", int(t * 1e9), b"\xf4\xd0 no frame" * 20) for t in (0.2, 0.4)]
    stops, findings, _ = run(
        [*noise, *HeadLine(timeline, LATERAL).chunks(), *timeline.polls()], text()
    )
    assert_right(stops)
    assert [finding.code for finding in findings] == ["bytes-garbled"]


def test_with_the_handshake_a_stop_is_taken_while_the_machine_still_waits():
    timeline = Timeline(stands(seconds=3.0))
    events = sorted([*HeadLine(timeline, LATERAL).chunks(), *timeline.polls()], key=arrival)
    survey = parse_survey(text() + "[plc.handshake]\nenabled = true\n", "survey.toml")
    capture = Capture(survey, PassBook(survey).start(skip_open_dwell=False))
    taken = [
        (arrival(event) * 1e-9, each)
        for event in events
        for each in capture.feed(event)
        if isinstance(each, CapturedStop)
    ]
    assert_right([stop for _, stop in taken])
    assert all(
        when < begin + 1.5
        for (when, _), (begin, _) in zip(taken, timeline.schedule(), strict=True)
    )
