"""A survey is settled once: also where its last doubt was accepted while a log was open that ended
without a pass."""

from stepdiag.daq.log.codec import time_of
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.settled import Settled
from stepdiag.daq.recording.sinks import Nowhere
from stepdiag.daq.recording.verdicts import accept
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.driven import WALL_OFFSET_NS, Fault, Program, machine_of, survey_file

LOOKS_S = 0.1
STAYS_S, GONE_S = 0.8, 6.0
"""How long the program still runs after the last stop, and how long it is then gone: an empty log
is closed after five seconds."""


def doubted_and_left():
    """Return the events of a pass with one doubt; the program runs on for a moment after its last
    stop, and is left."""
    program = Program(machine_of(5), faults=[Fault("jump", "ppp", 1, 3, 5.0)])
    program.drive("ppp")
    end = program.stops[-1]
    program._stand(
        end.position,
        end.reading - program.count_mm,
        setup=end.setup,
        seconds=STAYS_S,
        shown=False,
        counts=0,
    )
    program._stand(
        end.position,
        end.reading - program.count_mm,
        setup=0,
        seconds=GONE_S,
        shown=False,
        counts=0,
    )
    return list(program.events())


def test_a_survey_whose_last_doubt_is_accepted_over_an_empty_open_log_is_complete_at_its_end(
    tmp_path,
):
    text = survey_file(setups=("ppp",))
    more = {"on_outcome": lambda _: None, "wall_offset_ns": lambda: WALL_OFFSET_NS}
    session, settled = (
        Session(
            parse_survey(text, "survey.toml"), text, Round(tmp_path, {}), Nowhere(), **more
        ),
        Settled(),
    )
    settled.know(session)
    accepted, told, looked_s = False, [], 0.0
    for event in doubted_and_left():
        session.consume(event)
        now_s = time_of(event) * 1e-9
        if now_s - looked_s < LOOKS_S:
            continue
        looked_s = now_s
        if not accepted and session.recording and session.book.whole():
            assert settled.of(session) == ""
            accept(
                session.book.doubts(),
                tmp_path,
                reason="looked at it",
                name="A. Smith",
                time_s=now_s,
            )
            accepted = True
        if settled.heard(session) or settled.due(session):
            told.append((session.recording, settled.of(session)))
    assert accepted, "the bench opens a log after the last pass"
    assert told == [(True, ""), (False, "complete")]
