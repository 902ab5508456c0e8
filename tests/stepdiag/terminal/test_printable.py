"""What a foreign file makes the program say, on a terminal."""

from dataclasses import replace
from pathlib import Path

import pytest

from stepdiag.base.errors import DataError
from stepdiag.base.findings import Finding
from stepdiag.cli import app
from stepdiag.terminal.printable import printable
from stepdiag.terminal.tables import finding_lines
from testkit.cli import stepdiag
from testkit.recording import HEADER, recording, write_log

TITLE = "\x1b]0;owned\x07"
"""Sets the title of a terminal's window."""


@pytest.mark.parametrize(
    ("text", "shown"),
    [("plain ä\nµm", "plain ä\nµm"), (f"a{TITLE}b\r\x9b2J", "a?]0;owned?b??2J")],
)
def test_what_a_terminal_would_obey_is_shown_as_a_question(text, shown):
    assert printable(text) == shown


def test_a_refusal_that_quotes_a_foreign_file_cannot_steer_the_terminal(monkeypatch, capsys):
    def refuse() -> None:
        raise DataError("a.txt", expected="a number", found=TITLE)

    monkeypatch.setattr(app, "build", lambda: refuse)
    with pytest.raises(SystemExit):
        app.main()
    assert capsys.readouterr().err == "stepdiag: a.txt: expected a number, found ?]0;owned?\n"


def test_findings_and_foreign_logs_cannot_either(tmp_path: Path):
    assert list(finding_lines([Finding(code="a", severity="info", text=TITLE)])) == [
        "note    a: ?]0;owned?"
    ]
    write_log(
        tmp_path / "0001.mcap", recording(0.1), header=replace(HEADER, run={"machine": TITLE})
    )
    assert "\x1b" not in stepdiag("info", tmp_path / "0001.mcap").out
