"""What the daemon says that it waits for, and what its state holds."""

from types import SimpleNamespace

import pytest

from stepdiag.base.messages import message
from stepdiag.daq.capture.captured_stop import marked
from stepdiag.daq.log.recorder import Recorder
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import Nowhere
from stepdiag.daq.records.status import AheadStatus, DriveStatus, LinkStatus
from stepdiag.daq.service.child_jobs import Commands, Finisher
from stepdiag.daq.service.metrics import Tally
from stepdiag.daq.service.status_source import DaemonStatusSource, Working, _idle
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.captured import stops_of
from testkit.timeline import survey_text


def test_a_stop_that_is_doubted_for_two_reasons_is_one_place(tmp_path):
    text, stops = survey_text(), stops_of()
    stops[6] = marked(
        marked(stops[6], message("window-step", step_um=4.0)),
        message("machine-alarm", time="12:00:00"),
    )
    begun = Round(tmp_path, {}, stops=tuple(stops))
    session = Session(
        parse_survey(text, "survey.toml"),
        text,
        begun,
        Nowhere(),
        on_outcome=lambda _: None,
        wall_offset_ns=lambda: 0,
    )
    assert len(session.book.doubts()) == 2
    assert (
        str(_idle(session, "ppp"))
        == "doubted: diagonal X-Y-Z- to X+Y+Z+ (ppp), pass 1 out, stop 7; waiting for the program "
        "of diagonal X-Y-Z- to X+Y+Z+ (ppp), or for a person to accept the finding"
    )


def test_a_wrong_line_is_to_be_corrected_before_anything_is_driven_again(tmp_path):
    text, begun = survey_text(), Round(tmp_path, {})
    session = Session(
        parse_survey(text, "survey.toml"),
        text,
        begun,
        Nowhere(),
        on_outcome=lambda _: None,
        wall_offset_ns=lambda: 0,
    )
    session.book.wrong_line = "laser.latency_s"
    wanted = (
        "laser.latency_s of the survey file is wrong: correct the file; no pass has to be driven "
        "again"
    )
    assert str(_idle(session, "ppp")) == wanted


@pytest.mark.parametrize("severity", [None, "info", "warning", "error"])
def test_the_snapshot_holds_the_verdict_of_a_proof_run(tmp_path, severity):
    text = survey_text()
    session = Session(
        parse_survey(text, "survey.toml"),
        text,
        Round(tmp_path, {}),
        Nowhere(),
        on_outcome=lambda _: None,
        wall_offset_ns=lambda: 0,
    )
    link = LinkStatus(state="connected", address="", age_s=None, detail="")
    tally = Tally()
    finisher = Finisher(Commands(completion=()), tally, lambda *_: None)
    finisher.proof = severity
    source = DaemonStatusSource()
    source.open(
        Working(
            session=session,
            shown=session,
            recorder=Recorder(lambda _: None),
            survey_links=SimpleNamespace(statuses=lambda: (link, link, None, None)),
            finisher=finisher,
            supervisor=SimpleNamespace(disk=""),
            tally=tally,
        )
    )
    assert source.snapshot().proof == severity


@pytest.mark.parametrize(
    ("setup", "further", "stands"),
    [("npp", False, True), ("ppp", False, False), ("ppp+1", True, True), ("", False, True)],
)
def test_advice_ends_with_the_setup_that_it_names(setup, further, stands):
    """The next advice takes its time: until then a finished survey named a setup of its plan that
    was in. A setup outside the plan, and the end of the survey, stand."""
    advice = AheadStatus(words="Largest gain", setup=setup, further=further)
    open_pass = DriveStatus(setup="npp", pass_number=1, stops=13)
    assert advice.while_open([open_pass]) == (advice if stands else AheadStatus())
