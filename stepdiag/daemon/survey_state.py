"""The state of a survey, read from the disk: kept passes, passes to drive again, and the reasons
for both."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import Words, joined, message
from stepdiag.daq.capture.cause.finder import line_to_correct
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.log.part_file import PART_SUFFIX
from stepdiag.daq.passes.doubt import Doubt
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.recording.corrections import corrections_in, drives_otherwise, text_of
from stepdiag.daq.recording.rounds import (
    Noted,
    is_recording,
    noted_in,
    noted_round,
    round_folders,
)
from stepdiag.daq.recording.verdicts import Verdicts, verdicts_in
from stepdiag.daq.records.status import AheadStatus, DriveStatus, FindingStatus, SetupStatus
from stepdiag.daq.records.survey_folder import RESULT, logs_in
from stepdiag.daq.service.ahead import ahead_in
from stepdiag.daq.service.finding_list import finding_list
from stepdiag.daq.service.live import LiveStatus, live_in
from stepdiag.daq.service.metrics import words_on_disk
from stepdiag.daq.service.remaining import to_drive
from stepdiag.daq.service.snapshot import setup_statuses
from stepdiag.daq.survey.amended import extends
from stepdiag.daq.survey.file import load_survey, parse_survey, read_text
from stepdiag.daq.survey.models import Survey
from stepdiag.terminal.progress import counted


@dataclass(frozen=True, slots=True, kw_only=True)
class LogStanding:
    """The state of a log: its number of stops; ``trouble`` is the reason why the log is unreadable
    or truncated."""

    name: str
    stops: int
    trouble: Words = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """The state of a survey. ``round`` is None before the first recording. ``changed``: the survey
    file differs from the survey file in the logs."""

    survey: str
    machine: str
    folder: Path
    round: Path | None
    recording: bool
    changed: bool
    result: Path | None
    next_setup: str
    doubts: tuple[Doubt, ...]
    """Doubts that require further passes."""
    unsolved: Words
    """The reason why a complete survey has no result; empty without a reason."""
    findings: tuple[FindingStatus, ...]
    setups: tuple[SetupStatus, ...]
    to_drive: tuple[DriveStatus, ...]
    """Missing passes in the order of driving."""
    logs: tuple[LogStanding, ...]
    live: LiveStatus | None
    """The state of the daemon that records in this folder, with its links, or None without a
    daemon."""
    ahead: AheadStatus
    """The next pass to drive, according to the newest result."""
    wrong_line: str
    """The line of the survey file that a finding reports as wrong; empty without such a line."""
    corrections: tuple[str, ...]
    """Time, person and lines of the corrections of the survey file since the recording."""
    disk: Words
    """The finding about the disk of the recording; empty while there is room."""

    @property
    def complete(self) -> bool:
        return not self.next_setup


def standing_of(path: Path) -> Standing:
    """Return the state of a survey from its survey file, from its folder, or from the folder of one
    round.

    Raises UsageError for a folder without a recording, DataError for a folder whose logs are all
    unreadable.
    """
    if not path.is_dir():
        survey = load_survey(path)
        folder = survey.folder(path)
        rounds = round_folders(folder)
        return _standing(folder, rounds[-1] if rounds else None, survey, read_text(path))
    rounds = round_folders(path)
    last = rounds[-1] if rounds else path
    if not logs_in(last):
        remedy = message("name-survey")
        raise UsageError(
            str(path),
            expected=message("folder-with", what=message("logs-mcap")),
            found=message("none"),
            remedy=remedy,
        )
    return _standing(path if rounds else path.parent, last, None, "")


def _standing(folder: Path, last: Path | None, survey: Survey | None, text: str) -> Standing:
    paths = logs_in(last) if last is not None else []
    recorded, readable, logs = _read_logs(paths)
    recorded = text_of(readable[0].parent, readable) if readable else recorded
    changed = bool(text and recorded and not extends(text, recorded))
    known = (
        survey
        if not recorded or (text and not changed)
        else parse_survey(recorded, f"{paths[0].name}: survey.toml")
    )
    if known is None:
        raise DataError(
            str(last),
            expected=message("one-readable-log"),
            found=joined(
                [message("labelled", name=log.name, what=log.trouble) for log in logs]
            ),
        )
    book = PassBook(known)
    verdicts = verdicts_in(last) if last is not None else Verdicts()
    book.foretell(verdicts.suspicions)
    noted = noted_round(readable[0].parent, readable, recorded) if readable else Noted((), ())
    book.add_all(noted.stops)
    book.wrong_line = next(filter(None, map(line_to_correct, noted.findings)), "")
    unsolved = verdicts.tell(book)
    recording, drives = is_recording(folder), to_drive(known, book)
    result = last / RESULT if last is not None else None
    return Standing(
        survey=known.identity.name,
        machine=known.identity.machine,
        folder=folder,
        round=last,
        recording=recording,
        changed=changed,
        result=result if result is not None and result.exists() else None,
        next_setup=book.next_setup(),
        doubts=book.doubts(),
        unsolved=unsolved,
        findings=finding_list(book, noted.findings),
        setups=setup_statuses(known, book, drives),
        to_drive=drives,
        logs=tuple(logs),
        ahead=AheadStatus() if last is None else ahead_in(last).while_open(drives),
        wrong_line=book.wrong_line,
        corrections=tuple(map(str, corrections_in(last))) if last is not None else (),
        live=live_in(folder) if recording else None,
        disk=words_on_disk(folder, known.recording.min_free_gb) if folder.is_dir() else "",
    )


def _read_logs(paths: Sequence[Path]) -> tuple[str, list[Path], list[LogStanding]]:
    text, readable, logs = "", list[Path](), list[LogStanding]()
    for path in counted(paths, message("reading-logs"), len(paths)):
        try:
            own = open_log(path).header.survey_text
            if text and not extends(text, own) and drives_otherwise(text, own):
                raise DataError(
                    str(path),
                    expected=message("log-of-this-survey"),
                    found=message("another-one"),
                    remedy=message("does-not-count"),
                )
            found = noted_in(path)
        except DataError as error:
            trouble = (
                message("with-remedy", found=error.found, remedy=error.remedy)
                if error.remedy
                else error.found
            )
            logs.append(LogStanding(name=path.name, stops=0, trouble=trouble))
            continue
        text = own if not text or extends(own, text) else text
        readable.append(path)
        cut = message("log-not-closed") if path.suffix == PART_SUFFIX else ""
        logs.append(LogStanding(name=path.name, stops=len(found.stops), trouble=cut))
    return text, readable, logs
