"""One standstill that Modbus shows in parts: registers that lag behind the stop signal, a stop
signal that flickers."""

import struct
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from stepdiag.base.findings import Finding
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.records.events import ModbusBlock
from stepdiag.daq.survey.file import parse_survey
from testkit.timeline import STOPPED_ONLY, Timeline, diagonal, survey_text


@dataclass
class Lagging(Timeline):
    """A PLC whose position, count or stop signal are not of one moment."""

    late_s: dict = field(default_factory=dict)
    """By how much registers lag behind the stop signal: ``position``, ``count``; and the stop
    signal behind the machine: ``signal``."""
    running_in: bool = False
    """Whether the position is told on the way, too, not of stops alone."""
    flicker: tuple = ()
    """Spans (from, to) after the arrival at every stop in which the stop signal is away."""

    def registers(self, now, heartbeat):
        data = bytearray(super().registers(now, heartbeat))
        for name, first, last in (("count", 2, 4), ("signal", 4, 6), ("position", 8, 20)):
            if name in self.late_s:
                data[first:last] = super().registers(now - self.late_s[name], heartbeat)[
                    first:last
                ]
        if self.running_in:
            data[8:20] = self.on_the_way(now - self.late_s.get("position", 0.0))
        since = next(
            (now - begin for begin, end in self.schedule() if begin <= now < end), None
        )
        if since is not None and any(begin <= since < end for begin, end in self.flicker):
            (bits,) = struct.unpack(">H", data[4:6])
            data[4:6] = struct.pack(">H", bits & ~1)
        return bytes(data)

    def on_the_way(self, now):
        """Return the registers of the position at a time, axes in a straight line from stop to
        stop."""
        times = np.ravel(self.schedule())
        places = np.repeat([stop.position for stop in self.stops], 2, axis=0)
        return struct.pack(
            ">iii", *(round(float(np.interp(now, times, axis)) * 1e4) for axis in places.T)
        )


def run(timeline, **survey):
    """Return (stops, codes, ends)."""
    parsed = parse_survey(survey_text(**survey), "survey.toml")
    capture = Capture(parsed, PassBook(parsed).start(skip_open_dwell=False))
    outcomes = [
        outcome for event in timeline.events() for outcome in capture.feed(event)
    ] + capture.finish()
    kinds = (CapturedStop, Finding, Ended)
    return tuple([each for each in outcomes if isinstance(each, kind)] for kind in kinds)


@pytest.mark.parametrize(
    "late_s",
    [
        {"position": 0.12},
        {"count": 0.12},
        {"position": 0.15, "count": 0.08},
        {"position": 0.2, "count": 0.2},
    ],
)
def test_registers_that_lag_some_polls_cost_nothing(late_s):
    """Position and count of the stop before, for some polls of every dwell: every stop is taken
    once, nothing is said."""
    truth = diagonal("ppp", n=2)
    stops, findings, ends = run(Lagging(truth, late_s=late_s), n=2)
    assert [stop.stop for stop in stops] == list(range(7))
    for stop, true in zip(stops, truth, strict=True):
        assert stop.position_mm == pytest.approx(true.position, abs=1e-4)
        assert abs((stop.reading_mm - stops[0].reading_mm) - true.reading) * 1e3 < 0.6
    assert findings == []
    assert [end.kind for end in ends] == ["complete"]


PLACED = STOPPED_ONLY + "".join(
    f'[plc.signals.{axis}_mm]\naddress = {address}\ntype = "int32"\nscale = 0.0001\n'
    for axis, address in (("x", 4), ("y", 6), ("z", 8))
)
"""A machine with positions and without a counter."""


@pytest.mark.parametrize("late_s", [0.008, 0.011, 0.015, 0.022])
@pytest.mark.parametrize("early_s", [0.014, 0.02, 0.03])
def test_a_position_of_the_stop_before_while_the_machine_arrives_costs_nothing(
    late_s, early_s
):
    """The stop signal comes some milliseconds before the machine stands, and the first poll shows
    the position of the stop before: the laser still moves."""
    truth = diagonal("ppp", n=2)
    late = {"position": late_s, "signal": -early_s}
    timeline = Lagging(truth, late_s=late, rate_hz=250.0, poll_hz=100.0, move_s=0.097)
    stops, findings, _ = run(timeline, n=2, rate_hz=250.0, signals=PLACED)
    assert [stop.stop for stop in stops] == list(range(7))
    assert {each.code for each in findings} <= {"signals-absent"}


@pytest.mark.parametrize(
    ("rate_hz", "poll_hz", "seconds"),
    [
        (40.0, 40.0, 0.8),
        (40.0, 100.0, 0.6),
        (250.0, 40.0, 0.6),
        (250.0, 100.0, 0.8),
        (1000.0, 40.0, 0.8),
        (1000.0, 100.0, 0.6),
    ],
)
def test_a_position_that_runs_in_and_a_stop_signal_of_the_scan_before_cost_nothing(
    rate_hz, poll_hz, seconds
):
    """Every poll of the lag tells another place, and the last one of a dwell says that the machine
    stands when it moves already. Each two of rate, polls and length meet."""
    truth = [replace(stop, seconds=seconds) for stop in diagonal("ppp", n=2)]
    late_s = {"position": 0.55 * seconds, "count": 0.3 * seconds, "signal": 0.015}
    timeline = Lagging(
        truth, late_s=late_s, running_in=True, rate_hz=rate_hz, poll_hz=poll_hz, move_s=0.3
    )
    stops, findings, _ = run(timeline, n=2, rate_hz=rate_hz)
    assert [stop.stop for stop in stops] == list(range(7))
    assert [stop.position_mm for stop in stops] == [
        pytest.approx(true.position, abs=1e-4) for true in truth
    ]
    assert {each.code for each in findings} <= (
        {"stop-doubtful"} if rate_hz < 100.0 else set()
    )


def test_a_poller_that_is_held_up_after_the_lag_costs_nothing():
    """Ten polls tell the stop before, for a tenth of a second; then only every ninth comes: what
    was told longest counts."""

    class HeldUp(Lagging):
        def polls(self):
            begun = [begin for begin, _ in self.schedule()]

            def late(block):
                return (
                    min(
                        (
                            (now - begin)
                            for begin in begun
                            if (now := block.send_ns * 1e-9) >= begin
                        ),
                        default=0.0,
                    )
                    > 0.1
                )

            return [
                each
                for number, each in enumerate(super().polls())
                if not late(each) or number % 9 == 0
            ]

    truth = [replace(stop, seconds=0.5) for stop in diagonal("ppp", n=2)]
    stops, findings, _ = run(
        HeldUp(truth, late_s={"position": 0.1, "count": 0.1}, poll_hz=100.0, move_s=0.3), n=2
    )
    assert [stop.stop for stop in stops] == list(range(7))
    assert [stop.position_mm for stop in stops] == [
        pytest.approx(true.position, abs=1e-4) for true in truth
    ]
    assert findings == []


@pytest.mark.parametrize("signals", ["", STOPPED_ONLY])
def test_the_longest_steady_part_of_a_flickering_dwell_counts(signals):
    """The stop signal is there for 0.1 s, away for 50 ms, then there to the end: the long part is
    measured, nothing is doubted."""
    truth = diagonal("ppp", n=2)
    timeline = Lagging(truth, flicker=((0.1, 0.15), (0.18, 0.23)))
    stops, findings, _ = run(timeline, signals=signals, n=2)
    assert [stop.stop for stop in stops] == list(range(7))
    for stop, (begin, end) in zip(stops, timeline.schedule(), strict=True):
        assert begin + 0.23 < stop.window_from_ns * 1e-9 < stop.window_to_ns * 1e-9 < end
        assert not stop.doubts
    assert {each.code for each in findings} <= {"signals-absent"}


def test_a_count_that_was_lost_on_the_way_and_reads_the_same_again_is_no_standstill():
    """The stop signal is away for less than a flicker; the beam is cut during the move, and the
    count stands by chance where it stood."""
    truth = diagonal("ppp", n=2)
    step_mm = truth[2].reading - truth[1].reading
    timeline = Timeline(truth, move_s=0.2, rate_hz=1000.0, lost_mm=-step_mm)
    left = timeline.schedule()[1][1]
    timeline.beam_lost = [(left + 0.002, left + 0.25)]
    stops, findings, _ = run(timeline, signals=STOPPED_ONLY, n=2, rate_hz=1000.0)
    assert [stop.window_from_ns * 1e-9 // 1.0 for stop in stops] == [
        begin // 1.0 for begin, _ in timeline.schedule()
    ]
    assert "beam-lost" in {each.code for each in findings}


@pytest.mark.parametrize("late_s", [0.02, 0.3, 0.45])
def test_a_stop_that_was_not_seen_to_be_left_is_another_one(late_s):
    """No poll between two dwells, nor for a while in the second: the machine moved all the same, as
    the laser and the registers say."""
    truth = diagonal("ppp")
    timeline = Timeline(truth, move_s=0.3)
    gaps = [(begin - 0.33, begin + late_s) for begin, _ in timeline.schedule()[1:]]
    events = [
        each
        for each in timeline.events()
        if not (isinstance(each, ModbusBlock) and within(each, gaps))
    ]
    parsed = parse_survey(survey_text(), "survey.toml")
    capture = Capture(parsed, PassBook(parsed).start(skip_open_dwell=False))
    outcomes = [
        outcome for event in events for outcome in capture.feed(event)
    ] + capture.finish()
    assert [each.stop for each in outcomes if isinstance(each, CapturedStop)] == list(
        range(10)
    )


def within(block, spans):
    return any(begin <= block.send_ns * 1e-9 < end for begin, end in spans)
