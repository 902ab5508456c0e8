"""A survey whose computer had no time: its result, its report and the archive name it, until
somebody states the time."""

import json
from pathlib import Path

from stepdiag.base.result.result import parse_result
from stepdiag.completion.completion import complete
from stepdiag.daq.recording.verdicts import state_time
from stepdiag.fleet.archive import undated
from stepdiag.report.document import build_report
from testkit.cli import stepdiag
from testkit.hostile.foreign_logs import SURVEY, contents, log_of, with_survey

BEGUN_S = 1_800_000_000.0


def unset(folder: Path) -> Path:
    """Leave the log of a short pass behind that was recorded at the beginning of 1970."""
    folder.mkdir()
    text = SURVEY[: SURVEY.index("[[export]]")].replace(
        'machine = "virtual"', 'machine = "Mill 7"'
    )
    log = folder / "0001.mcap"
    log.write_bytes(log_of(contents(with_survey(text)).replace(b"1800000000000000000", b"0")))
    return log


def test_a_survey_of_1970_is_named_in_result_report_and_archive(tmp_path: Path) -> None:
    log = unset(tmp_path / "0001")
    result = complete([log], log.parent).result
    assert result.survey is not None
    assert result.survey.date == "1970-01-01"
    assert [found.severity for found in result.findings if found.code == "clock-unset"] == [
        "warning"
    ]
    assert (
        "clock of the computer was never set"
        in build_report(result, source="result.json").html
    )
    assert "the date 1970-01-01" in undated(log.parent)
    added = stepdiag("archive", "add", log.parent, "--to", tmp_path / "store")
    assert added.code == 0
    assert "clock of the computer was never set" in added.refusal, (
        "what stands on standard error"
    )


def test_a_time_that_is_stated_dates_the_survey(tmp_path: Path) -> None:
    log = unset(tmp_path / "0001")
    state_time(log.parent, BEGUN_S, reason="shift book", name="Kim", time_s=0.0)
    complete([log], log.parent)
    made = json.loads((log.parent / "result.json").read_text(encoding="utf-8"))["survey"]
    assert (made["date"], made["begun"]) == ("2027-01-15", "2027-01-15 08:00 UTC")
    result = parse_result(
        (log.parent / "result.json").read_text(encoding="utf-8"), "result.json"
    )
    assert [found.severity for found in result.findings if found.code == "clock-unset"] == [
        "info"
    ]
    assert not undated(log.parent)
