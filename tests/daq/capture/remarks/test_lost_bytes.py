"""Bytes that were lost on the way to this program are named with where that was, in the log's own
words too."""

import pytest

from stepdiag.base.findings import in_words
from stepdiag.base.messages import message
from stepdiag.daq.capture.remarks.remarks import StreamRemarks
from stepdiag.daq.links.ports.tty import _LOSSES
from stepdiag.daq.log.codec import time_of
from stepdiag.daq.records.events import LinkEvent
from stepdiag.texts.explained import finding_advice
from testkit.exact.driven import Program, machine_of, recorded, survey_file

CAUSES = [message(kind, count=4) for kind in _LOSSES.values()]


def test_each_cause_is_a_finding_once_a_log_however_often_it_is_told():
    said = []
    remarks = StreamRemarks({})
    for lost in ([CAUSES[0]], [message(CAUSES[0].key, count=9)], CAUSES[:2]):
        remarks.lost("laser", lost, said)
    assert [(each.key, each.text) for each in said] == [
        ("samples-missing.bytes", f"laser: bytes were lost: {cause}") for cause in CAUSES[:2]
    ]


@pytest.mark.parametrize("cause", CAUSES, ids=lambda cause: cause.key)
@pytest.mark.parametrize("stream", ["laser", "air", "head"])
def test_every_cause_reads_in_german(stream, cause):
    said = []
    StreamRemarks({}).lost(stream, [cause], said)
    told = in_words(said[0], "de")
    assert "Bytes gingen verloren" in told
    assert "4-mal" in told
    assert finding_advice(said[0].code, "de")


def test_a_loss_in_a_survey_stands_in_its_log_and_hinders_nothing(tmp_path):
    """From the link's event: live and on replay alike, for the event is in the log."""
    program = Program(machine_of(1), faults=(), seed=1)
    program.drive("ppp")
    events = program.events()
    at = len(events) // 2
    lost = LinkEvent(time_of(events[at]), "laser", "connected", "/dev/ttyS0", (CAUSES[1],))
    session, found = recorded(
        tmp_path, survey_file(setups=("ppp",)), [*events[:at], lost, *events[at:]]
    )
    assert [each.text for each in found if each.key == "samples-missing.bytes"] == [
        f"laser: bytes were lost: {CAUSES[1]}"
    ]
    assert session.book.complete()
    assert [each.key for each in dict.fromkeys(found)].count("samples-missing.bytes") == 1
