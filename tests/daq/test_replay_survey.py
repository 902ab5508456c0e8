"""The log of a survey whose file cannot be used any more is read with another file in its place."""

from dataclasses import replace
from pathlib import Path

import pytest

from stepdiag.daq.replay import replay
from stepdiag.solver.errors import UsageError
from testkit.recording import HEADER, write_log

SURVEY = """
[survey]
name = "s"
machine = "m"
[volume]
size_mm = [500, 400, 300]
increments = 2
[laser]
format = "line"
port = "/dev/ttyUSB0"
[laser.line]
pattern = '{pattern}'
"""
START = {"start": '{"hints": {}}'}
OLD, NEW = r"(?P<position>[0-9.]+)(?=;);.*", r"(?P<position>[0-9.]+);.*"


def test_a_replacement_stands_for_the_survey_file_of_the_log(tmp_path: Path) -> None:
    """A pattern that looks ahead was allowed once: the refusal names the way, and the way works."""
    log, file = tmp_path / "0001.mcap", tmp_path / "again.toml"
    write_log(log, [], header=replace(HEADER, survey_text=SURVEY.format(pattern=OLD), run=START))
    file.write_text(SURVEY.format(pattern=NEW), encoding="utf-8")
    with pytest.raises(UsageError, match="replay --survey FILE"):
        replay([log])
    replayed = replay([log], file)
    assert replayed.survey.laser.line is not None
    assert replayed.survey.laser.line.pattern == NEW


def test_a_replacement_is_judged_like_any_survey_file(tmp_path: Path) -> None:
    log, file = tmp_path / "0001.mcap", tmp_path / "again.toml"
    write_log(log, [], header=replace(HEADER, survey_text=SURVEY.format(pattern=OLD)))
    file.write_text(SURVEY.format(pattern=OLD), encoding="utf-8")
    with pytest.raises(UsageError, match=r"laser\.line\.pattern"):
        replay([log], file)
