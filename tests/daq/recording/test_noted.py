"""What a log notes of a finding is the finding again for the daemon that goes on."""

from pathlib import Path

import msgspec
import pytest

from stepdiag.base.findings import Finding, finding, in_words
from stepdiag.base.messages import Place, message
from stepdiag.daq.log.topics import finding_note
from stepdiag.daq.recording.rounds import _finding_of

PLACE = Place(setup="ppp", way="back", pass_number=2, stop=5, last=30)


def noted(found):
    return _finding_of(msgspec.json.encode(finding_note(5, found).fields), Path("0001.mcap"))


@pytest.mark.parametrize(
    "said",
    [
        message("beam-lost.bridged", why="beam lost"),
        message("count-stuck", count=3),
        message("turned-round"),
    ],
    ids=lambda said: said.key,
)
def test_a_finding_is_read_from_its_log_with_its_message_and_its_place(said):
    found = finding("warning", said, PLACE)
    assert noted(found) == found
    assert in_words(noted(found), "de").startswith(
        "Diagonale X-Y-Z- nach X+Y+Z+ (ppp) zurück, Messpunkt 6: "
    )


def test_of_a_log_of_before_the_text_stands():
    found = Finding(code="beam-lost", severity="error", text="words")
    assert noted(found) == found
