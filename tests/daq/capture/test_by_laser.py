"""A machine without signals, by events: stops are named by the geometry, and what the laser cannot
tell is said."""

import struct

import numpy as np
import pytest

from stepdiag.base.errors import UsageError
from stepdiag.daq.capture.by_laser import ByLaser
from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.outcome import Ended
from stepdiag.daq.survey.file import laser_decoder, parse_survey
from stepdiag.daq.timing.stream import Break, StreamBuffer
from testkit.examples import spread
from testkit.routes import make_route

SURVEY = """
[survey]
name = "quiet"
machine = "m"
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 2
[plan]
dwell_s = 1.0
[laser]
format = "line"
port = "/dev/null"
[laser.line]
pattern = '(?P<position>[-+0-9.]+) (?P<counter>[0-9]+) (?P<beam>[0-9.]+)'
counter_modulus = 0
rate_hz = 100
[plc]
transport = "none"
[environment]
source = "fixed"
"""
RATE_HZ = 100
MOVE_S = 0.3


class Bench:
    """A laser whose readings are laid down second by second."""

    def __init__(self, text=SURVEY, **hint):
        self.survey = parse_survey(text, "survey")
        self.laser = StreamBuffer(laser_decoder(self.survey))
        breaks = hint.pop("breaks", ())
        start = CaptureStart(hints={"ppp": PassHint(**hint)}, breaks=breaks)
        self.by_laser = ByLaser(self.survey, start, self.laser)
        self.out, self.back = (
            make_route(self.survey.volume, "ppp", "xyz", outward=way) for way in (True, False)
        )
        self.count, self.level, self.dwells, self.said = 0, 0.0, [], []
        self.watched = True

    def _send(self, values, beam=1.0):
        for value in values:
            self.count += 1
            now_ns = 1_000_000_000 + self.count * 1_000_000_000 // RATE_HZ
            self.laser.feed(f"{value:.6f} {self.count} {beam}\n".encode(), now_ns)
            if self.watched:
                dwells, outcomes = self.by_laser.look(now_ns)
                self.dwells += dwells
                self.said += outcomes

    def stand(self, level_mm, seconds=1.0):
        self._send(np.linspace(self.level, level_mm, int(MOVE_S * RATE_HZ)))
        self.level = level_mm
        self._send([level_mm] * int(seconds * RATE_HZ))

    def lose(self):
        self._send([self.level] * 5, beam=0.0)

    def drive(self, route, zero, stops=None):
        for stop in range(len(route)) if stops is None else stops:
            self.stand(zero + float(route.nominal_mm[stop]))

    def named(self, route):
        return [route.find(dwell.signals.commanded_mm, 0) for dwell in self.dwells]

    @property
    def codes(self):
        return [each.kind if isinstance(each, Ended) else each.code for each in self.said]


def test_a_pass_is_named_from_its_first_step_on_and_its_windows_lie_in_the_standstills():
    bench = Bench()
    bench.stand(-40.0)
    bench.drive(bench.out, 3.0)
    bench.stand(500.0)
    assert bench.named(bench.out) == list(range(7))
    assert all(dwell.to_ns - dwell.from_ns > 0.8e9 for dwell in bench.dwells)
    assert not bench.said or bench.codes == ["between-stops"]


def test_a_machine_that_stands_for_ever_at_its_last_stop_is_taken():
    bench = Bench()
    bench.drive(bench.out, 0.0)
    bench.stand(float(bench.out.nominal_mm[-1]), seconds=4.0)
    assert bench.named(bench.out) == list(range(7))


def test_the_way_back_begins_at_the_last_stop_or_at_the_one_before():
    last = float(Bench().out.nominal_mm[-1])
    for overrun in (True, False):
        bench = Bench(outward=False, known={6: 10.0 + last, 0: 10.0})
        bench.level = 10.0 + last
        if overrun:
            bench.stand(10.0 + last + 5.0, seconds=0.2)
            bench.drive(bench.back, 10.0 + last)
        else:
            bench.drive(bench.back, 10.0 + last, range(1, 7))
        bench.stand(-70.0)
        assert bench.named(bench.back) == list(range(0 if overrun else 1, 7))


def test_a_feed_hold_is_no_stop_and_a_missed_stop_is_known_by_the_distance():
    bench = Bench()
    bench.drive(bench.out, 0.0, [0, 1])
    bench.stand(float(bench.out.nominal_mm[1:3].mean()))
    bench.drive(bench.out, 0.0, [3, 4])
    bench.stand(900.0)
    assert bench.named(bench.out) == [0, 1, 3, 4]
    assert "between-stops" in bench.codes


@pytest.mark.parametrize("watched", [True, False])
def test_a_shaken_standstill_is_one_stop(watched):
    """Seen as it happens, or all at once after a computer that stood still."""
    bench = Bench()
    bench.watched = watched
    bench.drive(bench.out, 0.0, [0, 1])
    bench._send([bench.level + 0.006] * 3)
    bench._send([bench.level] * 100)
    bench.watched = True
    bench.drive(bench.out, 0.0, [2])
    bench.stand(900.0)
    assert bench.named(bench.out) == [0, 1, 2]
    assert bench.dwells[1].to_ns - bench.dwells[1].from_ns > 1.9e9, "both parts of it"


def test_a_wrong_sign_is_named_and_nothing_is_measured():
    bench = Bench()
    bench.drive(bench.back, 0.0, [0, 1, 2])
    bench.stand(900.0)
    assert bench.dwells == []
    assert bench.codes[0] == "wrong-laser-sign"


def test_a_pass_driven_once_more_from_its_beginning_is_known_by_its_direction():
    bench = Bench(outward=False, known={6: 200.0, 0: 13.0}, next_stop=3)
    bench.drive(bench.out, 77.0, [0, 1, 2])
    bench.stand(900.0)
    assert bench.named(bench.out) == [0, 1, 2]


def test_a_lost_count_ends_the_pass_and_is_of_no_matter_before_it():
    bench = Bench()
    bench.stand(5.0)
    bench.lose()
    bench.drive(bench.out, 0.0, [0, 1, 2])
    bench.lose()
    bench.stand(900.0, seconds=3.0)
    assert bench.codes == ["aborted"]
    assert bench.named(bench.out) == [0, 1, 2]


def test_a_count_lost_at_the_first_stop_of_the_way_back_ends_the_pass():
    """Where that stop is known, the pass has begun with it."""
    last = float(Bench().out.nominal_mm[-1])
    bench = Bench(outward=False, known={6: 10.0 + last, 0: 10.0})
    bench.level = 10.0 + last
    bench.stand(10.0 + last + 5.0, seconds=0.2)
    bench.stand(10.0 + last)
    bench.stand(10.0 + last - 40.0, seconds=0.1)
    bench.lose()
    bench.stand(900.0, seconds=3.0)
    assert bench.named(bench.back) == [0]
    assert bench.codes == ["aborted"]


def test_a_count_lost_before_the_first_stop_of_the_way_back_leaves_it_to_its_first_step():
    last = float(Bench().out.nominal_mm[-1])
    bench = Bench(outward=False, known={6: 10.0 + last, 0: 10.0})
    bench.level = 10.0 + last
    bench.stand(10.0 + last + 5.0, seconds=0.2)
    bench.lose()
    bench.drive(bench.back, 77.0)
    bench.stand(900.0)
    assert bench.named(bench.back) == list(range(7))
    assert bench.codes == []


def test_a_count_lost_before_the_last_stop_ends_the_pass():
    bench = Bench()
    bench.drive(bench.out, 0.0, range(6))
    bench.lose()
    bench.stand(900.0, seconds=3.0)
    assert bench.named(bench.out) == list(range(6))
    assert bench.codes == ["aborted"]


def test_a_count_lost_after_the_last_stop_is_of_no_matter():
    """The program has ended, and somebody takes the mirror off."""
    bench = Bench()
    bench.drive(bench.out, 0.0)
    bench.lose()
    bench.stand(900.0, seconds=3.0)
    assert bench.named(bench.out) == list(range(7))
    assert bench.codes == []


@pytest.mark.parametrize(
    ("change", "short_s", "long_s"),
    [
        (("dwell_s = 1.0", "dwell_s = 2.0"), 0.9, 1.2),
        (("[laser]\n", "[stop]\nsettle_s = 0.5\nmin_window_s = 0.4\n[laser]\n"), 0.7, 1.1),
        (("[laser]\n", "[stop]\nsettle_s = 0.1\nmin_window_s = 0.2\n[laser]\n"), 0.4, 0.7),
    ],
)
def test_a_plateau_too_short_for_a_stop_is_none(change, short_s, long_s):
    """It lasts half a dwell at least, and for the time that a machine settles and a window
    takes."""
    for seconds, wanted in ((short_s, [0, 1, 3]), (long_s, [0, 1, 2, 3])):
        bench = Bench(SURVEY.replace(*change))
        for stop in range(4):
            bench.stand(float(bench.out.nominal_mm[stop]), seconds if stop == 2 else 2.0)
        bench.stand(900.0)
        assert bench.named(bench.out) == wanted, seconds


@pytest.mark.parametrize(("dwell_s", "until_s"), [(1.0, 2.5), (2.0, 5.0)])
def test_a_standstill_of_so_many_dwells_is_taken_while_it_lasts(dwell_s, until_s):
    bench = Bench(SURVEY.replace("dwell_s = 1.0", f"dwell_s = {dwell_s}"))
    bench.drive(bench.out, 0.0, [0])
    for stop, more_s in ((1, -0.3), (2, 0.6)):
        bench.stand(float(bench.out.nominal_mm[stop]), until_s + more_s)
        assert bench.named(bench.out) == list(range(3 if more_s > 0 else 0)), more_s


def test_one_step_too_many_is_said_on_the_way_back():
    last = float(Bench().out.nominal_mm[-1])
    bench = Bench(outward=False, known={6: last, 0: 0.0})
    bench.level = last
    bench.stand(last - bench.back.step_mm(0, 1))
    bench.stand(last)
    assert "place-unknown" in bench.codes


def test_a_count_that_was_lost_between_two_passes_leaves_the_next_to_its_first_step():
    bench = Bench(outward=False, known={6: 500.0}, breaks=(Break(0, "beam lost"),))
    bench.drive(bench.back, 12.0, [0, 1, 2])
    bench.stand(900.0)
    assert bench.named(bench.back) == [0, 1, 2]


def telegram(index, readings):
    """A telegram of a quDIS: positions in mm with the count of the marker's edges."""
    words = []
    for mm, edges in readings:
        whole = round(mm * 1e9) & (1 << 48) - 1
        words += [
            whole & 0xFFFFFF | (edges & 0x7F) << 24,
            whole >> 24 | edges >> 7 << 24 | 1 << 31,
        ]
    return struct.pack(f"<5i{len(words)}I", 16 + 4 * len(words), 4, 0x0F00, index, 0, *words)


def test_the_marker_of_a_qudis_tells_the_standstills_and_counts_them():
    """The relay closes half a second after the machine stands: only from then on it counts, and a
    hold without the relay not."""
    text = SURVEY.replace('format = "line"', 'format = "qudis"').replace(
        "[laser.line]", "[laser.qudis]\naverage = 8\nmarker = true"
    )
    survey = parse_survey(
        "\n".join(
            line
            for line in text.splitlines()
            if not line.startswith(("pattern", "counter", "rate"))
        ),
        "survey",
    )
    laser = StreamBuffer(laser_decoder(survey))
    by_laser = ByLaser(survey, CaptureStart(hints={"ppp": PassHint()}), laser)
    route = make_route(survey.volume, "ppp", "xyz", outward=True)
    rate_hz, track, edges = 25_000 / 2**8, [], 0
    for stop in (0, 1, 2, 2.5, 3, 4):
        level = float(np.interp(stop, range(7), route.nominal_mm))
        closed = stop != 2.5
        track += [(level - 0.5, edges)] * 15 + [(level, edges)] * 49
        edges += closed
        track += [(level, edges)] * 98
        edges += closed
        track += [(level, edges)] * 10
    track += track[-1:] * 40
    dwells = []
    for first in range(0, len(track), 8):
        now_ns = 1_000_000_000 + int((first + 8) / rate_hz * 1e9)
        laser.feed(telegram(first, track[first : first + 8]), now_ns)
        dwells += by_laser.look(now_ns)[0]
    assert [route.find(dwell.signals.commanded_mm, 0) for dwell in dwells] == [0, 1, 2, 3, 4]
    assert [dwell.signals.stop_count for dwell in dwells] == [1, 2, 3, 4, 5]
    assert all(0.8e9 < dwell.to_ns - dwell.from_ns < 1.05e9 for dwell in dwells)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (
            (
                "[environment]\n",
                "[plc.signals.stopped]\naddress = 1\ntype = 'bit'\n[environment]\n",
            ),
            "plc.signals",
        ),
        (
            ("[environment]\n", "[plc.handshake]\nenabled = true\n[environment]\n"),
            "plc.handshake.enabled",
        ),
        (('source = "fixed"', 'source = "plc"'), "environment.source"),
    ],
)
def test_what_a_silent_machine_cannot_give_is_refused_by_field(change, field):
    with pytest.raises(UsageError, match=field):
        parse_survey(SURVEY.replace(*change), "survey")


FAULTS = ["none", "idle", "hold", "missed", "missed second", "short", "slip", "reverses"]
DRAWS = len(spread(range(10), 2))


def faulty(kind, true, read, rng):
    """Return the standstills of a pass with one fault as (true stop, reading, seconds)."""
    at = int(rng.integers(2, len(read) - 1))
    stands = [(stop, float(reading), 1.0) for stop, reading in zip(true, read, strict=True)]
    if kind == "idle":
        idle = rng.uniform(20, 90, int(rng.integers(1, 4)))
        return [*((None, float(read[0] - off), 1.0) for off in idle), *stands]
    if kind == "hold":
        held = read[at - 1] + rng.uniform(0.2, 0.8) * (read[at] - read[at - 1])
        return [*stands[:at], (None, float(held), 1.0), *stands[at:]]
    if kind == "short":
        return [*stands[:at], (None, float(read[at]), 0.3), *stands[at + 1 :]]
    if kind == "slip":
        return [
            *stands[:at],
            *((stop, reading + 0.3, seconds) for stop, reading, seconds in stands[at:]),
        ]
    missed = {"missed": at, "missed second": 1}.get(kind)
    return [stand for number, stand in enumerate(stands) if number != missed]


@pytest.mark.parametrize("kind", FAULTS)
def test_drawn_passes_with_one_fault_are_named_right(kind):
    """Out as a first pass or back on one count, in drawn boxes; machine and mirror are off by 1e-4
    and 1e-3 of the way."""
    rng = np.random.default_rng(7)
    for _ in range(DRAWS):
        size, n = (
            np.round(rng.uniform((200, 150, 80), (600, 400, 300))),
            int(rng.integers(2, 5)),
        )
        text = SURVEY.replace("[300.0, 200.0, 100.0]", str(size.tolist()))
        text = text.replace("increments = 2", f"increments = {n}")
        nominal = Bench(text).out.nominal_mm
        steps = np.diff(nominal) * (1 - 1e-3 * rng.uniform())
        steps *= 1 + 1e-4 * rng.normal(0, 1, len(steps))
        out = np.concatenate(([0.0], np.cumsum(steps))) + rng.uniform(-500, 500)
        bench, read = Bench(text), out
        if back := kind == "reverses" or rng.random() < 0.5:
            bench = Bench(text, outward=False, known=dict(enumerate(out.tolist())))
            bench.level, read = float(out[-1]), out[::-1] + rng.normal(0, 0.003, len(out))
        first = int(kind == "reverses")
        if back and not first:
            bench.stand(float(read[0]) + 5.0, 0.15)
        stands = faulty(kind, range(first, len(read)), read[first:], rng)
        for _, reading, seconds in stands:
            bench.stand(reading, seconds)
        bench.stand(stands[-1][1] - 900.0)
        route = bench.back if back else bench.out
        assert bench.named(route) == [stop for stop, *_ in stands if stop is not None]
