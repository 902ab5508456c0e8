"""A daemon that dies while the machine stands at the end of a pass, and the next one that finds the
machine there."""

import pytest

from stepdiag.base.findings import Finding
from stepdiag.daq.log.codec import time_of
from stepdiag.daq.recording.corrections import replay_corrected
from stepdiag.daq.recording.rounds import latest_round
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import DirectSink
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.daq.replay import find_logs
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.driven import WALL_OFFSET_NS, Fault, Program, machine_of, survey_file
from testkit.timeline import SETUPS as NUMBERS
from testkit.timeline import Timeline

HANDSHAKE = "[plc.handshake]\nenabled = true\n"
SETUPS = ("ppp", "npp")


def session_of(text, begun, said):
    begun.folder.mkdir(exist_ok=True)
    survey = parse_survey(text, "survey.toml")
    return Session(
        survey,
        text,
        begun,
        DirectSink(),
        on_outcome=said.append,
        wall_offset_ns=lambda: WALL_OFFSET_NS,
    )


def cut(folder, text, events, at_end):
    """Record up to the end of the first pass as a daemon that dies then; return its session, and
    the events the next one has still to see.

    ``at_end`` is how many events the dead one saw after it had taken the last stop.
    """
    session = session_of(text, Round(folder, {}), [])
    for at, event in enumerate(events):
        session.consume(event)
        if any(each.whole for each in session.book.passes):
            for more in events[at + 1 : at + 1 + at_end]:
                session.consume(more)
            return session, events[at + 1 + at_end :]
    raise AssertionError("no pass came to its end")


def gone_on(text, begun, events):
    """Record the rest as the next daemon; return its session and its errors."""
    said = []
    session = session_of(text, begun, said)
    for event in events:
        session.consume(event)
    session.close("the bench has ended")
    return session, [
        each.text for each in said if isinstance(each, Finding) and each.severity == "error"
    ]


def driven(*, back=False, setups=SETUPS):
    program = Program(machine_of(5), back=back)
    for setup in setups:
        program.drive(setup)
    return list(program.events())


@pytest.mark.parametrize("back", [False, True], ids=["outward", "there-and-back"])
@pytest.mark.parametrize("at_end", [0, 3, 12])
def test_a_machine_that_still_stands_at_the_end_of_a_pass_begins_none(tmp_path, back, at_end):
    """It waits for the word that died with the daemon: a pass begun there was never driven, and
    kept the next setup from being taken."""
    text = survey_file(back=back, setups=SETUPS) + HANDSHAKE
    first, rest = cut(tmp_path / "0001", text, driven(back=back), at_end)
    first.close("died")
    begun = latest_round(tmp_path, text, {})
    second, errors = gone_on(text, begun, rest)
    assert errors == []
    passes = [
        (setup, number, True) for setup in SETUPS for number in ((1, 2) if back else (1,))
    ]
    assert [
        (each.route.setup, each.number, each.whole) for each in second.book.passes
    ] == passes
    assert second.owed == begun.stops[-1].stop_count


def test_a_machine_that_still_stands_at_the_end_of_a_survey_begins_no_other(tmp_path):
    """The survey is solved, the daemon starts again: the next one begins where the machine moves,
    and the word that is owed is known."""
    text = survey_file(setups=("ppp",)) + HANDSHAKE
    events = driven(setups=("ppp", "ppp"))
    first, rest = cut(tmp_path / "0001", text, events, 3)
    first.close("died")
    (tmp_path / "0001" / RESULT).write_text("{}")
    begun = latest_round(tmp_path, text, {})
    assert (begun.folder.name, begun.stops) == ("0002", ())
    second, errors = gone_on(text, begun, rest)
    assert errors == []
    assert second.owed == first.book.last_count
    assert [(each.route.setup, each.number, each.whole) for each in second.book.passes] == [
        ("ppp", 1, True)
    ]
    assert second.book.stops == 7


def test_the_first_stop_of_another_setup_is_taken_although_the_pass_before_was_left_open(
    tmp_path,
):
    """The program went on without a pause: the machine stood at that stop until somebody aborted
    it."""
    text = survey_file(setups=SETUPS) + HANDSHAKE
    program = Program(machine_of(5), faults=[Fault("left", "ppp", 1, 3)])
    for setup in SETUPS:
        program.drive(setup)
    stops = [each for each in program.stops if each.setup]
    waits = next(
        at for at, each in enumerate(stops) if each.setup == NUMBERS["npp"] and each.counts
    )
    program.stops, program.spans = stops[: waits + 1], []
    stops[waits].seconds = 6.0
    events = list(program.events())
    standing = [
        event for event in events if time_of(event) < time_of(events[-1]) - 2_000_000_000
    ]
    session, _ = gone_on(text, Round(tmp_path / "0001", {}), standing)
    assert [(each.route.setup, sorted(each.chosen())) for each in session.book.passes] == [
        ("ppp", [0, 1, 2, 3]),
        ("npp", [0]),
    ]


def test_a_counter_that_is_stuck_costs_no_stop_where_the_next_daemon_finds_the_machine(
    tmp_path,
):
    """It shows what it showed at the end of the pass before, and the machine stands elsewhere: that
    is no stop taken already."""
    text = survey_file(setups=SETUPS)
    program = Program(machine_of(5))
    for setup in SETUPS:
        program.drive(setup)
    first = next(
        at
        for at, each in enumerate(program.stops)
        if each.setup == NUMBERS["npp"] and each.counts
    )
    program.stops[first].seconds = 2.0
    for stop in program.stops:
        stop.counts = 0
    begins_s, _ = Timeline(program.stops, move_s=0.3).schedule()[first]
    before, rest = cut(tmp_path / "0001", text, list(program.events()), 3)
    before.close("died")
    later = [event for event in rest if time_of(event) * 1e-9 > begins_s + 0.5]
    second, _ = gone_on(text, latest_round(tmp_path, text, {}), later)
    assert [(each.route.setup, each.whole) for each in second.book.passes] == [
        ("ppp", True),
        ("npp", True),
    ]


@pytest.mark.parametrize(
    "port", ["/dev/null", "/dev/ttyUSB1"], ids=["as-before", "other-port"]
)
@pytest.mark.parametrize("solved", [False, True], ids=["open", "solved"])
def test_a_survey_goes_on_with_further_setups_and_the_logs_that_exist(tmp_path, solved, port):
    """One with a result stays as it is: what goes on is a new round with the same logs, at
    whatever port the laser is by now."""
    first, rest = cut(
        tmp_path / "0001", survey_file(setups=("ppp",)) + HANDSHAKE, driven(), 3
    )
    first.close("died")
    if solved:
        (tmp_path / "0001" / RESULT).write_text("{}")
    before = {path.name: path.read_bytes() for path in (tmp_path / "0001").iterdir()}
    text = survey_file(setups=SETUPS).replace("/dev/null", port) + HANDSHAKE
    assert port in text
    begun = latest_round(tmp_path, text, {})
    assert (begun.folder.name, len(begun.stops)) == ("0002" if solved else "0001", 7)
    assert latest_round(tmp_path, text, {}).folder == begun.folder, "it is gone on with once"
    second, errors = gone_on(text, begun, rest)
    assert errors == []
    assert [(each.route.setup, each.whole) for each in second.book.passes] == [
        (setup, True) for setup in SETUPS
    ]
    replayed = replay_corrected(find_logs([begun.folder]))
    assert replayed.survey.plan.all_setups == SETUPS
    assert [(each.route.setup, each.whole) for each in replayed.book.passes] == [
        (setup, True) for setup in SETUPS
    ]
    assert {name: (tmp_path / "0001" / name).read_bytes() for name in before} == before
