"""``stop_count`` and ``captured`` must meet: told again, or named, never waited for in silence."""

import pytest

from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.recording.handshake import Handshake
from stepdiag.daq.recording.rounds import next_round
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import Nowhere
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.captured import stops_of
from testkit.waiting import survey_of

SECOND = 1_000_000_000


def at(count, **more):
    return Signals(
        **{"stopped": True, "running": True, "setup": 1, "stop_count": count, **more}
    )


class Machine:
    """What a machine hears, and what is said of it."""

    def __init__(self, owed=None):
        self.heard, self.said = [], []
        self.handshake = Handshake(self.heard.append, owed, 2.0)

    def stands(self, signals, *seconds):
        for now in seconds:
            found = self.handshake.look(
                signals, round(now * SECOND), lambda: "ppp 3/9, capturing the stop"
            )
            self.said += [] if found is None else [found]


def test_a_captured_stop_is_told_once():
    machine = Machine()
    machine.stands(at(1), 0.0)
    machine.handshake.captured(stops_of()[1])
    machine.stands(at(1), 0.1)
    machine.stands(at(1, stopped=False), 0.2)
    assert machine.heard == [1]
    assert machine.said == []


def test_a_stop_that_is_not_taken_is_named_after_a_dwell_and_no_longer_than_it_lasts():
    machine = Machine()
    machine.stands(at(7), 0.0, 1.9, 2.1, 9.0)
    (said,) = machine.said
    assert said.code == "handshake-waits"
    assert "stop counter of the control: 7; answer of stepdiag: nothing" in said.text
    assert "ppp 3/9, capturing the stop" in said.text
    assert machine.handshake.alarm == said.message
    machine.stands(at(8), 9.1)
    assert not machine.handshake.alarm


def test_a_plc_that_forgot_is_told_again():
    """It has heard before and stands longer than a dwell: it is told again, and not named."""
    machine = Machine()
    for stop in stops_of()[:2]:
        machine.stands(at(stop.stop_count), stop.stop * 1.0)
        machine.handshake.captured(stop)
    machine.stands(at(1), 2.0, 3.1, 4.0, 5.2, 9.0)
    assert machine.heard == [0, 1, 1, 1, 1]
    assert machine.said == []


def test_one_that_never_hears_is_named():
    machine = Machine()
    machine.stands(at(0), 0.0)
    machine.handshake.captured(stops_of()[0])
    machine.stands(at(0), *range(1, 20))
    (said,) = machine.said
    assert "the NC program does not read the answer" in said.text


def test_what_is_owed_since_the_last_daemon_is_told_at_once():
    machine = Machine(owed=5)
    machine.stands(at(5), 0.0, 0.1)
    assert machine.heard == [5]


def test_a_program_that_runs_on_after_its_survey_is_let_go_at_every_stop():
    """A program driven anew for one pass has others after it: the survey is complete, and the
    machine waits at stops that no pass needs."""
    machine = Machine(owed=7)
    for number, signals in enumerate((at(7), at(8), at(8, stopped=False), at(9), at(9))):
        machine.handshake.let_go(signals, 7, round(0.1 * number * SECOND))
        machine.stands(signals, 0.1 * number)
    assert machine.heard == [7, 8, 9]
    assert machine.said == []


@pytest.mark.parametrize("running", [True, None])
def test_the_last_stop_of_a_finished_survey_is_owed_until_the_disk_has_it(running, tmp_path):
    """The next round begins before the stop is safe in the log."""
    last, machine = stops_of()[-1], Machine()
    begun = next_round(Round(tmp_path / "0001", {}), last)
    session = Session(
        parse_survey(survey_of(), "survey.toml"),
        "",
        begun,
        Nowhere(),
        on_outcome=lambda _: None,
        wall_offset_ns=lambda: 0,
        armed=False,
    )
    machine.handshake.let_go(at(last.stop_count, running=running), session.owed, 0)
    assert machine.heard == []
    machine.handshake.let_go(at(last.stop_count + 1, running=running), session.owed, 0)
    assert machine.heard == [last.stop_count + 1]


def test_a_program_that_is_over_waits_for_nobody():
    machine = Machine()
    machine.stands(at(4, running=False), 0.0, 9.0)
    machine.stands(at(4, setup=0), 10.0, 19.0)
    assert machine.said == []


def test_a_refusal_is_said_once_until_it_is_taken_again():
    handshake = Handshake(lambda count: None, None, 2.0)
    said = [
        handshake.written(refused)
        for refused in ("illegal address", "illegal address", "", "illegal address")
    ]
    assert [found is not None and found.code == "handshake-waits" for found in said] == [
        True,
        False,
        False,
        True,
    ]
