"""What the machine says of itself beside its stops: a heartbeat that stands still, an alarm."""

import struct
from dataclasses import dataclass, field

from stepdiag.base.findings import Finding
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.survey.file import parse_survey
from testkit.timeline import Timeline, diagonal, survey_text


@dataclass
class Troubled(Timeline):
    """A machine whose registers stand still in one span, and which reports an alarm in another."""

    frozen: tuple = (0.0, 0.0)
    alarm: tuple = (0.0, 0.0)
    _image: list = field(default_factory=list)

    def registers(self, now, heartbeat):
        data = super().registers(now, heartbeat // 20)
        if self.alarm[0] <= now < self.alarm[1]:
            heartbeat_, count, bits = struct.unpack(">HHH", data[:6])
            data = struct.pack(">HHH", heartbeat_, count, bits | 4) + data[6:]
        if not self.frozen[0] <= now < self.frozen[1]:
            self._image[:] = [data]
        return self._image[0]


def run(timeline):
    """Return the stops by number, and the findings."""
    survey = parse_survey(survey_text(), "survey.toml")
    capture = Capture(survey, PassBook(survey).start(skip_open_dwell=False))
    outcomes = [
        outcome for event in timeline.events() for outcome in capture.feed(event)
    ] + capture.finish()
    return {each.stop: each for each in outcomes if isinstance(each, CapturedStop)}, [
        each for each in outcomes if isinstance(each, Finding)
    ]


def test_no_stop_is_taken_from_registers_that_stand_still():
    """Frozen in the dwell of stop 3 until the machine stands at stop 5: what the registers said
    meanwhile is not believed."""
    timeline = Troubled(diagonal("ppp"), seed=1)
    (arrived, left), (_, gone) = timeline.schedule()[3], timeline.schedule()[4]
    timeline.frozen = (arrived + 0.6, gone + 0.6)
    stops, findings = run(timeline)
    assert [each.code for each in findings][:1] == ["heartbeat-still"]
    assert "stop 4 of 10" in findings[0].text
    assert stops[3].window_to_ns * 1e-9 < left
    for index, stop in stops.items():
        error_um = (
            stop.reading_mm - stops[0].reading_mm - timeline.stops[index].reading
        ) * 1e3
        assert abs(error_um) < 0.6 or stop.doubts, index
    assert set(range(10)) - stops.keys() <= {4}


def test_an_alarm_is_named_with_its_time_and_the_stop_after_it_is_doubted():
    timeline = Troubled(diagonal("ppp"), seed=1)
    _, left = timeline.schedule()[3]
    timeline.alarm = (left + 0.1, left + 0.3)
    stops, (alarm,) = run(timeline)
    assert alarm.code == "machine-alarm"
    assert "stop 5 of 10" in alarm.text
    assert "at 00:00:0" in alarm.text
    assert [index for index, stop in stops.items() if stop.doubts] == [4]
    assert stops[4].doubt_codes == ("machine-alarm",)
