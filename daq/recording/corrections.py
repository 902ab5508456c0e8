"""A survey file that was corrected after its logs were recorded: the changed lines, and the logs
read again with the corrected file.

``corrected.jsonl`` beside the logs contains one JSON object per correction: operator, time, the
changed lines, and the corrected survey file. The end of a pass depends on the survey file, so the
logs of a round are read as a single stream of events. If a wrong map of signals has divided a pass
into two logs, the pass is then whole.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from stepdiag.base.errors import StepdiagError
from stepdiag.base.findings import Finding
from stepdiag.base.messages import message
from stepdiag.daq.capture.outcome import Outcome
from stepdiag.daq.log.codec import time_of
from stepdiag.daq.log.contents import LogEnd, open_log
from stepdiag.daq.passes.doubt import Doubt
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import Nowhere
from stepdiag.daq.recording.verdicts import CORRECTED, append_line, lines_of
from stepdiag.daq.records.events import Chunk
from stepdiag.daq.replay import Replayed, ReplayedLog, replay
from stepdiag.daq.survey.amended import without_further
from stepdiag.daq.survey.bundle import bundle_from_run
from stepdiag.daq.survey.file import parse_survey, read_text
from stepdiag.daq.survey.models import Survey

NEW_ROUND = (
    "survey.name",
    "survey.machine",
    "volume.size_mm",
    "volume.origin_mm",
    "volume.increments",
    "plan.setups",
    "plan.return_pass",
    "plan.repeats",
    "plan.targets",
    "plan.beam_offset",
)
"""Fields of the survey file whose change requires that the machine be driven again: volume, target
list or program.
"""
READING = (
    "volume.axis_order",
    "plan.axis_orders",
    "plan.alternate_orders",
    "laser",
    "plc",
    "head",
    "stop",
    "environment",
)
"""Fields of the survey file that change how registers and laser are decoded."""
WAYS = (
    "port",
    "baud",
    "bytesize",
    "parity",
    "stopbits",
    "host",
    "serial_port",
    "unit",
    "rack",
    "slot",
    "poll_hz",
    "timeout_s",
    "handshake",
)
"""Fields of the connections, whose changes do not affect the logs."""


class Correction(msgspec.Struct, frozen=True, kw_only=True):
    """A correction: its time (seconds since 1970), the operator, the changed lines (``laser.sign: 1
    -> -1``), and the corrected survey file.
    """

    time_s: float
    name: str
    changes: tuple[str, ...]
    survey_text: str

    def __str__(self) -> str:
        moment = datetime.fromtimestamp(self.time_s, UTC).strftime("%Y-%m-%d %H:%M UTC")
        return f"{moment}, {self.name}: {'; '.join(self.changes)}"


class Change(msgspec.Struct, frozen=True):
    """A changed line of a survey file: its dotted name, and both values as JSON."""

    line: str
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.line}: {self.before} -> {self.after}"

    @property
    def begins_round(self) -> bool:
        """Return whether the change requires that the machine be driven again."""
        return _within(self.line, NEW_ROUND) and not self._renames

    @property
    def reads_otherwise(self) -> bool:
        """Return whether the change requires that the logs be read again."""
        return self._renames or (
            _within(self.line, READING)
            and not any(part in WAYS for part in self.line.split(".")[1:2])
        )

    @property
    def _renames(self) -> bool:
        if self.line != "plan.setups":
            return False
        before, after = (
            sorted(msgspec.json.decode(value, type=list[str]))
            for value in (self.before, self.after)
        )
        return before == after


def _within(line: str, names: Sequence[str]) -> bool:
    return any(line == name or line.startswith(f"{name}.") for name in names)


def changes(before: Survey, after: Survey) -> list[Change]:
    """Return the lines in which two survey files differ, in the order of the file."""
    return list(_differing("", msgspec.to_builtins(before), msgspec.to_builtins(after)))


def _differing(name: str, before: Any, after: Any) -> Iterator[Change]:
    if before == after:
        return
    if isinstance(before, dict) and isinstance(after, dict):
        for key in dict.fromkeys([*before, *after]):
            yield from _differing(
                f"{name}.{key}".lstrip("."), before.get(key), after.get(key)
            )
        return
    yield Change(
        name, msgspec.json.encode(before).decode(), msgspec.json.encode(after).decode()
    )


def corrections_in(folder: Path) -> tuple[Correction, ...]:
    """Return the corrections of a round in order; the last correction is valid."""
    return tuple(lines_of(folder / CORRECTED, Correction))


def note_correction(folder: Path, correction: Correction) -> None:
    """Add a correction to the file, and wait until the correction is on disk. Raises UsageError if
    the file cannot be written.
    """
    append_line(folder / CORRECTED, msgspec.json.encode(correction))


def text_of(folder: Path, logs: Sequence[Path]) -> str:
    """Return the text of the valid survey file of a round, from the last correction or from the
    last log; empty without a log.
    """
    corrected = corrections_in(folder)
    if corrected:
        return corrected[-1].survey_text
    return open_log(logs[-1]).header.survey_text if logs else ""


def compared(recorded: str, text: str) -> list[Change] | None:
    """Return the changes from the survey file ``recorded`` to ``text``; None if ``recorded`` is no
    longer readable.

    A further setup is no change, because the recording stays valid.
    """
    if recorded == text:
        return []
    try:
        before = parse_survey(recorded, "log")
        return changes(before, without_further(parse_survey(text, "survey"), before))
    except StepdiagError:
        return None


def drives_otherwise(recorded: str, text: str) -> bool:
    """Return whether the survey file ``text`` requires that the machine be driven differently than
    with the file ``recorded``; True if ``recorded`` is no longer readable.
    """
    found = compared(recorded, text)
    return found is None or any(each.begins_round for each in found)


def has_further(text: str, recorded: str) -> bool:
    """Return whether the survey file ``text`` has further setups, and drives all setups of the file
    ``recorded`` unchanged.
    """
    try:
        before, after = parse_survey(recorded, "log"), parse_survey(text, "survey")
    except StepdiagError:
        return False
    rest = without_further(after, before)
    return rest is not after and not any(each.begins_round for each in changes(before, rest))


def must_reread(logs: Sequence[Path], text: str) -> bool:
    """Return whether reading the logs with the survey file ``text`` may give other results than the
    notes in the logs.
    """
    recorded = dict.fromkeys(open_log(log).header.survey_text for log in logs)
    found = [compared(each, text) for each in recorded if each != text]
    return any(
        each is None or any(change.reads_otherwise for change in each) for each in found
    )


def replay_corrected(
    logs: Sequence[Path],
    survey_file: Path | None = None,
    suspicions: Sequence[tuple[int, tuple[Doubt, ...]]] = (),
) -> Replayed:
    """Return the contents of a round's logs with the valid survey file: as recorded, or read again
    with a corrected file.

    ``survey_file`` replaces an unusable file. Raises the errors of `replay`.
    """
    text = (
        read_text(survey_file) if survey_file is not None else text_of(logs[0].parent, logs)
    )
    headers = [open_log(log).header for log in logs]
    alike = all(header.survey_text == headers[0].survey_text for header in headers)
    foreign = [compared(header.survey_text, text) for header in headers]
    if not any(foreign) or any(
        each is None or any(change.begins_round for change in each) for each in foreign
    ):
        return replay(logs, survey_file, suspicions)  # `replay` refuses logs of two surveys
    if alike and not must_reread(logs, text):
        return replace(
            replay(logs, survey_file, suspicions),
            survey=parse_survey(text, "survey.toml"),
            survey_text=text,
        )
    source = survey_file.name if survey_file is not None else f"{logs[0].name}: survey.toml"
    session, found = reread(logs, text, source, suspicions)
    replayed = tuple(
        ReplayedLog(
            log, tuple(outcome for path, outcome in found if path == log), _end_of(log)
        )
        for log in logs
    )
    return Replayed(
        session.survey,
        text,
        bundle_from_run(headers[0].run, str(logs[0])),
        dict(headers[-1].run),
        session.book,
        replayed,
        tuple(outcome for _, outcome in found if isinstance(outcome, Finding)),
    )


def _end_of(path: Path) -> LogEnd | None:
    log = open_log(path)
    for _ in log.events():
        pass
    return log.end


def reread(
    logs: Sequence[Path],
    text: str,
    source: str,
    suspicions: Sequence[tuple[int, tuple[Doubt, ...]]] = (),
) -> tuple[Session, list[tuple[Path, Outcome]]]:
    """Return the session after reading the events of a round's logs with a survey file, and the
    outcomes of each log.

    Events from before the opening of a log are in two logs, and are read once. Raises the errors of
    `parse_survey` and `open_log`.
    """
    survey = parse_survey(text, source)
    found: list[tuple[Path, Outcome]] = []
    at, offset_ns = logs[0], open_log(logs[0]).header.wall_offset_ns
    session = Session(
        survey,
        text,
        Round(logs[0].parent, {}),
        Nowhere(),
        on_outcome=lambda outcome: found.append((at, outcome)),
        wall_offset_ns=lambda: offset_ns,
    )
    session.book.foretell(suspicions)
    recorded = parse_survey(open_log(logs[0]).header.survey_text, source).plan.all_setups
    renamed = (
        dict(zip(recorded, survey.plan.all_setups, strict=True))
        if sorted(recorded) == sorted(survey.plan.all_setups)
        else {}
    )
    newest: dict[str, int] = {}
    for at in logs:
        log = open_log(at)
        for event in log.events():
            key = event.stream if isinstance(event, Chunk) else type(event).__name__
            if time_of(event) <= newest.get(key, -1):
                continue
            newest[key] = time_of(event)
            begun = log.header.run.get("expected_setup", "")
            begun = renamed.get(begun, begun)
            if (
                survey.plc.silent
                and not session.recording
                and session.book.open_passes(begun)
            ):
                session.begin(begun, time_of(event))
            session.consume(event)
    session.close(message("closed-stopped"))
    return session, found
