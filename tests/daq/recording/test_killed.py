"""A daemon that is killed at any moment, and the next one that goes on: at once, or when the
machine has driven on meanwhile."""

import bisect
import functools
import itertools

import numpy as np
import pytest

from stepdiag.daq.log.codec import time_of
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import Nowhere
from stepdiag.daq.recording.verdicts import Verdicts
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.driven import WALL_OFFSET_NS, Program, machine_of, survey_file
from testkit.fault_cases import COUNTED
from testkit.timeline import Timeline

SETUPS, STOPS, MOVE_S = ("linear-x", "linear-y"), 3, 0.3
HANDSHAKE = "[plc.handshake]\nenabled = true\n"
TAKEN_S = 0.45
"""So long after the machine has left, a stop is in the log whatever happens."""
WINDOW_S = 0.53
"""A machine that stands for so long once the next daemon listens stands long enough."""
DRIVEN = [
    (setup, number, stop) for setup in SETUPS for number in (1, 2) for stop in range(STOPS)
]


class Bench:
    """A survey there and back; every stop that the machine comes to, with its time and its
    count."""

    def __init__(self, waits_at=None, seconds=0.0):
        program = Program(machine_of(5), back=True)
        for setup in SETUPS:
            program.drive(setup)
        self.at = [index for index, each in enumerate(program.stops) if each.counts]
        if waits_at is not None:
            program.stops[self.at[waits_at]].seconds += seconds
        times = Timeline(program.stops, move_s=MOVE_S).schedule()
        self.stands = [times[index] for index in self.at]
        self.counts = [(65530 + number) % 65536 for number in range(1, len(self.at) + 1)]
        self.events = list(program.events())

    def where(self, stop):
        """Return which of the stops driven a captured one is, by its time; None where the machine
        stood at none."""
        middle_s = (stop.window_from_ns + stop.window_to_ns) * 0.5e-9
        at = bisect.bisect([begin for begin, _ in self.stands], middle_s) - 1
        longer_s = (
            1.0 if at == len(self.stands) - 1 else 0.1
        )  # nothing moves after the last one
        return at if at >= 0 and middle_s <= self.stands[at][1] + longer_s else None


@functools.cache
def plain():
    """Return the survey as it is driven where no machine waits."""
    return Bench()


def moments(count, seed):
    """Return drawn moments of a survey in seconds, one in each of so many equal parts: all of its
    phases have their turn."""
    last = plain().stands[-1][1]
    return (np.arange(count) + np.random.default_rng(seed).uniform(size=count)) * last / count


def gone_on(survey, text, first, events):
    begun = first.as_round(Verdicts())
    second = Session(
        survey,
        text,
        begun,
        Nowhere(),
        on_outcome=lambda _: None,
        wall_offset_ns=lambda: WALL_OFFSET_NS,
    )
    for event in events:
        second.consume(event)
    second.close("the bench has ended")
    return second, len(begun.stops)


def killed(tmp_path, text, at_s):
    """Yield each moment in seconds with a session that was killed then: of one that goes on."""
    survey = parse_survey(text, "survey.toml")
    first = Session(
        survey,
        text,
        Round(tmp_path, {}),
        Nowhere(),
        on_outcome=lambda _: None,
        wall_offset_ns=lambda: WALL_OFFSET_NS,
    )
    events = iter(plain().events)
    for moment_s in at_s:
        for event in events:
            if time_of(event) * 1e-9 > moment_s:
                events = itertools.chain([event], events)
                break
            first.consume(event)
        yield survey, moment_s, first


def assert_true(bench, passes):
    """What counts as a pass was driven as that pass: each stop where it says, in the direction that
    it says."""
    for each in passes:
        for index, stop in each.chosen().items() if each.whole else ():
            at = bench.where(stop)
            assert at is not None
            setup, number, driven = DRIVEN[at]
            turn = index == 0 and (number, driven) == (
                each.number - 1,
                STOPS - 1,
            )  # the return pass may begin with the stop before
            assert turn or (setup, number % 2, driven) == (
                each.route.setup,
                each.number % 2,
                index,
            )


@pytest.mark.parametrize("pause_s", [0.0, 2.0], ids=["at-once", "later"])
@pytest.mark.parametrize("signals", ["", COUNTED], ids=["all", "counted"])
def test_what_is_whole_after_a_kill_was_driven_so_and_only_what_nobody_saw_is_missing(
    tmp_path, signals, pause_s
):
    """Where the machine stands when it is seen again, and how far its counter went on, say whether
    it is still on its way out."""
    text, bench = survey_file(back=True, setups=SETUPS, signals=signals), plain()
    at_s = np.sort(
        np.append(
            moments(4, seed=1), [begin + 0.4 for begin, _ in bench.stands[STOPS - 1 :: STOPS]]
        )
    )
    for survey, moment_s, first in killed(tmp_path, text, at_s):
        from_s = moment_s + pause_s
        second, _ = gone_on(
            survey,
            text,
            first,
            [each for each in bench.events if time_of(each) * 1e-9 > from_s],
        )
        assert_true(bench, second.book.passes)
        if signals:
            # where the first stops of a pass are missed, nobody knows which ones are seen: the pass
            # stays open
            continue
        seen = {bench.where(stop) for stop in second.as_round(Verdicts()).stops}
        for at, (begin, end) in enumerate(bench.stands):
            assert at in seen or not (
                end + TAKEN_S < moment_s or end - max(begin, from_s) > WINDOW_S
            ), (moment_s, DRIVEN[at])


@pytest.mark.parametrize("signals", ["", COUNTED], ids=["all", "counted"])
def test_with_the_handshake_a_kill_costs_nothing_and_no_machine_waits_in_vain(
    tmp_path, signals
):
    """It stands at its stop until somebody tells it, and goes on then."""
    text = survey_file(back=True, setups=SETUPS, signals=signals) + HANDSHAKE
    for survey, moment_s, first in killed(tmp_path, text, moments(6, seed=2)):
        at = next(index for index, (_, end) in enumerate(plain().stands) if end > moment_s)
        from_s = moment_s + 1.0
        waiting = Bench(at, max(0.0, from_s - max(moment_s, plain().stands[at][0])) + 0.6)
        second, before = gone_on(
            survey,
            text,
            first,
            [each for each in waiting.events if time_of(each) * 1e-9 > from_s],
        )
        told = {
            second.owed,
            *(stop.stop_count for stop in second.as_round(Verdicts()).stops[before:]),
        }
        assert set(waiting.counts[at:]) <= told, moment_s
        assert [
            (each.route.setup, each.number, each.whole) for each in second.book.passes
        ] == [(setup, number, True) for setup in SETUPS for number in (1, 2)]
        assert_true(waiting, second.book.passes)
