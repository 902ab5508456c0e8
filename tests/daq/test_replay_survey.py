"""The log of a survey whose file cannot be used any more is read with another file in its place."""

from dataclasses import replace
from pathlib import Path
from time import process_time

import pytest

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.instruments.line import LineDecoder, LineSettings
from stepdiag.daq.replay import replay
from testkit.cli import stepdiag
from testkit.hostile.foreign_logs import SURVEY as RECORDED
from testkit.hostile.foreign_logs import with_survey
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
    write_log(
        log, [], header=replace(HEADER, survey_text=SURVEY.format(pattern=OLD), run=START)
    )
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


PATTERN = next(line for line in RECORDED.splitlines() if line.startswith("pattern = "))
ALONE = RECORDED[: RECORDED.index("[[export]]")]
NEVER_READ = {
    "looks ahead": r"pattern = '(?=\d)(?P<counter>\d+) (?P<position>-?\d+\.\d+) (?P<beam>\d\.\d+)'",
    "says again what it found": r"pattern = '(?P<counter>(\d)\2*\d*) (?P<position>-?\d+\.\d+) "
    r"(?P<beam>\d\.\d+)'",
    "is none": r"pattern = '(?P<counter>\d+) (?P<position>'",
}
EVIL = r"pattern = '(?P<counter>(\d+)+) (?P<position>(-?\d+\.?)+) (?P<beam>\d\.\d+)'"
"""Exponential where it is tried step by step, on a line that lacks its end."""


@pytest.mark.parametrize("pattern", NEVER_READ)
def test_a_pattern_that_cannot_be_held_is_named_with_the_way_out_and_the_way_works(
    tmp_path: Path, pattern: str
) -> None:
    """At the command line, with a log whose stops were captured: the replacement brings back the
    same stops."""
    (tmp_path / "0001.mcap").write_bytes(
        with_survey(ALONE.replace(PATTERN, NEVER_READ[pattern]))
    )
    refused = stepdiag("replay", tmp_path / "0001.mcap", "--out", tmp_path / "none")
    assert (refused.code, "replay --survey FILE" in refused.refusal) == (2, True), refused
    good = tmp_path / "good.toml"
    good.write_text(ALONE, encoding="utf-8")
    again = stepdiag(
        "replay", tmp_path / "0001.mcap", "--survey", good, "--out", tmp_path / "again"
    )
    assert again.code == 0, again
    (tmp_path / "whole").mkdir()
    (tmp_path / "whole/0001.mcap").write_bytes(with_survey(ALONE))
    assert (
        stepdiag("replay", tmp_path / "whole/0001.mcap", "--out", tmp_path / "as").code == 0
    )
    assert (tmp_path / "again/readings.csv").read_bytes() == (
        tmp_path / "as/readings.csv"
    ).read_bytes()


def test_an_evil_pattern_reads_a_log_in_linear_time(tmp_path: Path) -> None:
    """RE2 holds it, so it is no refusal; a minute is a thousand times what it takes, and far from
    what a search step by step takes."""
    (tmp_path / "0001.mcap").write_bytes(with_survey(ALONE))
    evil = tmp_path / "evil.toml"
    evil.write_text(ALONE.replace(PATTERN, EVIL), encoding="utf-8")
    began = process_time()
    assert (
        stepdiag(
            "replay", tmp_path / "0001.mcap", "--survey", evil, "--out", tmp_path / "again"
        ).code
        == 0
    )
    decoder = LineDecoder(LineSettings(pattern=EVIL.partition("'")[2][:-1]))
    decoder.feed((b"1" * 2000 + b"\n") * 50, 1)
    assert process_time() - began < 60
