"""Replay of a survey from its logs: the code of the live run processes the input of the live run
again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stepdiag.base.errors import DataError
from stepdiag.base.findings import Finding
from stepdiag.base.messages import message
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.log_start import start_of
from stepdiag.daq.capture.outcome import Outcome
from stepdiag.daq.log.contents import LogEnd, must_be_there, open_log
from stepdiag.daq.log.part_file import PART_SUFFIX
from stepdiag.daq.passes.doubt import Doubt
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.records.survey_folder import logs_in
from stepdiag.daq.survey.amended import extends
from stepdiag.daq.survey.bundle import bundle_from_run
from stepdiag.daq.survey.file import parse_survey, read_text
from stepdiag.daq.survey.models import Survey


@dataclass(frozen=True, slots=True)
class ReplayedLog:
    """A log that was replayed: its file, the stops and remarks of the capture in order, and the end
    of the log.
    """

    path: Path
    outcomes: tuple[Outcome, ...]
    end: LogEnd | None


@dataclass(frozen=True, slots=True)
class Replayed:
    survey: Survey
    survey_text: str
    files: dict[str, bytes]
    run: dict[str, str]
    book: PassBook
    logs: tuple[ReplayedLog, ...]
    findings: tuple[Finding, ...]

    @property
    def stops(self) -> list[CapturedStop]:
        """Return every stop of the logs in the order of capture."""
        return [
            each
            for log in self.logs
            for each in log.outcomes
            if isinstance(each, CapturedStop)
        ]


def begun_logs(folder: Path) -> list[Path]:
    """Return the logs of a folder. A log that was cut off before its first record is left out."""
    return [path for path in logs_in(folder) if path.suffix != PART_SUFFIX or _begun(path)]


def _begun(path: Path) -> bool:
    try:
        open_log(path)
    except DataError:
        return False
    return True


def find_logs(paths: Sequence[Path]) -> list[Path]:
    """Return the logs under the given paths; a path is a log, or a folder with logs.

    Raises UsageError for a missing path, DataError for paths without a log.
    """
    for path in paths:
        must_be_there(path)
    logs = [log for path in paths for log in (begun_logs(path) if path.is_dir() else [path])]
    if not logs:
        named = ", ".join(str(path) for path in paths)
        remedy = message("one-survey")
        raise DataError(
            named, expected=message("one-log"), found=message("none"), remedy=remedy
        )
    return logs


def replay(
    paths: Sequence[Path],
    survey_file: Path | None = None,
    suspicions: Sequence[tuple[int, tuple[Doubt, ...]]] = (),
) -> Replayed:
    """Return the contents of the logs of a survey. ``survey_file`` replaces the survey file that
    the logs contain.

    Raises DataError for a log of another program or of another survey file, UsageError for an
    invalid survey file.
    """
    opened = [open_log(path) for path in paths]
    text = opened[0].header.survey_text
    for log in opened:
        if extends(log.header.survey_text, text):
            text = log.header.survey_text
        elif not extends(text, log.header.survey_text):
            raise DataError(
                str(log.path),
                expected=message("file-of", name=opened[0].path.name),
                found=message("another-one"),
                remedy=message("alone"),
            )
    if survey_file is not None:
        text = read_text(survey_file)
    survey = parse_survey(
        text,
        survey_file.name
        if survey_file is not None
        else f"{opened[0].path.name}: survey.toml",
    )
    book = PassBook(survey)
    book.foretell(suspicions)
    replayed = []
    for log in opened:
        capture = Capture(survey, start_of(log.header.run, str(log.path)))
        outcomes: list[Outcome] = []
        for event in log.events():
            if capture.ended is None:
                outcomes.extend(capture.feed(event))
        outcomes.extend(capture.finish())
        book.add_all(each for each in outcomes if isinstance(each, CapturedStop))
        outcomes.extend(raised for remark in book.news() for raised in capture.heed(remark))
        replayed.append(ReplayedLog(log.path, tuple(outcomes), log.end))
    findings = tuple(
        each for one in replayed for each in one.outcomes if isinstance(each, Finding)
    )
    return Replayed(
        survey,
        text,
        bundle_from_run(opened[0].header.run, str(opened[0].path)),
        dict(opened[-1].header.run),
        book,
        tuple(replayed),
        findings,
    )
