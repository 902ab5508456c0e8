"""The folder of a survey on disk: a numbered folder per round with its logs and results.

The folder of a survey is ``<directory>/<name>``; the recording daemon locks ``.lock`` in this
folder. The first round has the logs ``0001/0001.mcap`` and so on, one per pass, and beside the logs
the results ``result.json``, ``readings.csv``, ``exports/`` and ``report.html``.
"""

import errno
import os
import re
import shutil
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import msgspec
import structlog
from mcap.records import Channel, Message

from stepdiag.base.disk.part import part_of
from stepdiag.base.disk.system import lock
from stepdiag.base.errors import DataError, DeviceError, UsageError, system_words
from stepdiag.base.findings import Finding, Severity
from stepdiag.base.messages import Way, Words, message, message_of
from stepdiag.base.setups import DRIVEN_SETUPS
from stepdiag.daq.capture.captured_stop import CapturedStop, from_log
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.log.part_file import PART_SUFFIX
from stepdiag.daq.log.reader import DAMAGE, RecordReader, damage_of, impossible
from stepdiag.daq.log.recovery import recover
from stepdiag.daq.log.topics import FINDING_TOPIC, STOP_TOPIC
from stepdiag.daq.recording.corrections import (
    Correction,
    compared,
    has_further,
    must_reread,
    note_correction,
    reread,
    text_of,
)
from stepdiag.daq.recording.session import Round
from stepdiag.daq.recording.verdicts import verdicts_in
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.daq.replay import begun_logs

LOCK = ".lock"
LATEST_S = 4_102_444_800.0
"""Latest possible time of a stop in s since 1970: the year 2100."""
_SETUP = re.compile(rf"(?:{'|'.join(DRIVEN_SETUPS)})(?:\+[1-9][0-9]{{0,3}})?")

_log = structlog.get_logger("rounds")


@dataclass(slots=True)
class FolderLock:
    """A lock on a survey's folder, which excludes a second daemon until this process ends."""

    descriptor: int
    folder: Path

    @classmethod
    def take(cls, folder: Path) -> Self:
        """Lock a folder, and create it if necessary. Raises UsageError if another daemon has locked
        the folder or the folder cannot be written.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise UsageError(
                str(folder), expected=message("folder-writable"), found=system_words(error)
            ) from error
        try:
            lock(descriptor)
        except OSError as error:
            holder = os.pread(descriptor, 20, 0).decode("ascii", "replace").strip()
            os.close(descriptor)
            found = (
                message("found-process", number=holder)
                if holder.isdecimal()
                else message("found-running")
            )
            remedy = message("end-other")
            raise UsageError(
                str(folder), expected=message("no-other"), found=found, remedy=remedy
            ) from error
        _sign(descriptor, folder)
        return cls(descriptor, folder)

    def require_folder(self) -> None:
        """Raise DeviceError if the folder was unmounted, moved or removed while this process
        records.
        """
        found: Words = message("folder-of-another")
        try:
            there: os.stat_result | None = (self.folder / LOCK).stat()
        except OSError as error:
            there, found = None, system_words(error)
        mine = os.fstat(self.descriptor)
        if there is None or (there.st_dev, there.st_ino) != (mine.st_dev, mine.st_ino):
            remedy = message("mount")
            raise DeviceError(
                str(self.folder), expected=message("folder-as"), found=found, remedy=remedy
            )

    def release(self) -> None:
        os.close(self.descriptor)


def _sign(descriptor: int, folder: Path) -> None:
    try:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode("ascii"), 0)
    except OSError as error:
        if error.errno != errno.ENOSPC:
            os.close(descriptor)
            raise UsageError(
                str(folder), expected=message("folder-writable"), found=system_words(error)
            ) from error


def is_recording(folder: Path) -> bool:
    """Return whether a daemon has locked the folder; no file is created or changed."""
    try:
        with (folder / LOCK).open("rb") as file:
            lock(file.fileno(), shared=True)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def round_folders(folder: Path) -> list[Path]:
    """Return the numbered folders of a survey, in order of the rounds; empty for a missing
    folder.
    """
    found = (
        [each for each in folder.iterdir() if each.is_dir() and each.name.isdecimal()]
        if folder.is_dir()
        else []
    )
    return sorted(found, key=lambda each: int(each.name))


def latest_round(folder: Path, survey_text: str, run: dict[str, str]) -> Round:
    """Return the last round, or a new round. The last round continues in two cases: it is
    incomplete and ``survey_text`` drives the machine in the same way, or ``survey_text`` adds
    setups to this round.

    If ``survey_text`` decodes registers or laser differently, the logs are read again with
    ``survey_text``, and a correction beside the logs contains the change. Logs that were cut off
    are mended first, into new files.
    """
    rounds = round_folders(folder)
    if not rounds:
        return _new_round(folder, 1, run)
    mend(rounds[-1])
    last = gone_on_with(rounds[-1], survey_text)
    logs = begun_logs(last)
    recorded = text_of(last, logs)
    changed = compared(recorded, survey_text) if recorded else []
    if (
        (last / RESULT).exists()
        or changed is None
        or any(each.begins_round for each in changed)
    ):
        return replace(_new_round(folder, int(last.name) + 1, run), left=_last_stop(logs))
    if changed:
        note_correction(
            last,
            Correction(
                time_s=time.time(),
                name="run",
                changes=tuple(map(str, changed)),
                survey_text=survey_text,
            ),
        )
    noted = noted_round(last, logs, survey_text)
    used = [
        int(each.name.partition(".")[0])
        for each in last.iterdir()
        if each.name.partition(".")[0].isdecimal()
    ]
    return Round(
        last,
        dict(run),
        logs=max(used, default=0),
        stops=noted.stops,
        findings=noted.findings,
        verdicts=verdicts_in(last),
    )


def gone_on_with(folder: Path, survey_text: str) -> Path:
    """Return the folder of the round to continue: ``folder``, or a new round if the round has a
    result and the survey file adds setups. The new round has the same logs and the same statements
    of operator and solver.
    """
    logs = begun_logs(folder)
    recorded = {open_log(log).header.survey_text for log in logs}
    if not (folder / RESULT).exists() or not all(
        has_further(survey_text, one) for one in recorded
    ):
        return folder
    new = folder.with_name(f"{int(folder.name) + 1:04d}")
    if not new.exists():
        with part_of(new) as part:
            (part / "round").mkdir()
            for path in (*logs, *folder.glob("*.jsonl")):
                _copied(path, part / "round" / path.name)
            (part / "round").rename(new)
    return new


def _copied(path: Path, target: Path) -> None:
    """Copy a file into another round. A log gets a hard link, because it never changes again."""
    with suppress(OSError):
        if path.suffix != ".jsonl":
            target.hardlink_to(path)
            return
    shutil.copyfile(path, target)


def next_round(begun: Round, left: CapturedStop | None) -> Round:
    new = _new_round(begun.folder.parent, int(begun.folder.name) + 1, begun.run)
    return replace(new, left=left)


def mend(folder: Path) -> None:
    """Recover every log of a folder that was cut off; a log that cannot be recovered is reported
    and left unchanged.
    """
    for part in sorted(folder.glob(f"*.mcap{PART_SUFFIX}")):
        if part.with_suffix("").exists():
            continue
        try:
            recovery = recover(part)
        except (DataError, UsageError) as error:
            _log.warning("log-not-mended", file=part.name, reason=str(error))
        else:
            _log.info(
                "log-mended",
                file=part.name,
                into=recovery.target.name,
                lost_bytes=recovery.end.lost_bytes,
            )


@dataclass(frozen=True, slots=True)
class Noted:
    """The notes of a log in order: the results of the live run, without decoding the raw bytes."""

    stops: tuple[CapturedStop, ...]
    findings: tuple[Finding, ...]


def noted_round(folder: Path, logs: Sequence[Path], survey_text: str) -> Noted:
    """Return the stops and findings of a round with the given survey file, from the notes in the
    logs or, if the notes cannot be used, from the raw bytes.
    """
    if logs and must_reread(logs, survey_text):
        _, found = reread(logs, survey_text, "survey", verdicts_in(folder).suspicions)
        outcomes = [outcome for _, outcome in found]
        stops = tuple(each for each in outcomes if isinstance(each, CapturedStop))
        return Noted(stops, tuple(each for each in outcomes if isinstance(each, Finding)))
    noted = [noted_in(log) for log in logs]
    return Noted(
        tuple(stop for each in noted for stop in each.stops),
        tuple(found for each in noted for found in each.findings),
    )


def noted_stops(log: Path) -> list[CapturedStop]:
    return list(noted_in(log).stops)


def noted_in(log: Path) -> Noted:
    """Return the stops and findings in the notes of a log. Raises DataError for notes that no
    recorder of this program has written.
    """
    stops, findings = list[CapturedStop](), list[Finding]()
    topics: dict[int, str] = {}
    for record in RecordReader(log):
        match record:
            case Channel():
                topics[record.id] = record.topic
            case Message() if topics.get(record.channel_id) == STOP_TOPIC:
                stops.append(_stop_of(record.data, log))
            case Message() if topics.get(record.channel_id) == FINDING_TOPIC:
                findings.append(_finding_of(record.data, log))
            case _:
                pass
    return Noted(tuple(stops), tuple(findings))


class _FindingNote(msgspec.Struct):
    severity_text: Severity
    code: str
    text: str
    setup: str = ""
    pass_number: int | None = msgspec.field(name="pass", default=None)
    stop: int | None = None
    size_um: float | None = None
    key: str = ""
    arguments: str = ""
    way: Way = ""
    last: int | None = None


def _finding_of(note: bytes, log: Path) -> Finding:
    try:
        found = msgspec.json.decode(note, type=_FindingNote)
        arguments = msgspec.json.decode(
            found.arguments or "null"
        )  # a log of an older version contains only a text
    except DAMAGE as error:
        raise DataError(
            str(log), expected=message("findings-noted"), found=damage_of(error)
        ) from error
    return Finding(
        code=found.code,
        severity=found.severity_text,
        text=found.text,
        message=message_of({"key": found.key or found.code, "arguments": arguments}),
        setup=found.setup,
        pass_number=found.pass_number,
        stop=found.stop,
        way=found.way,
        last=found.last,
        size_um=found.size_um,
    )


def _stop_of(note: bytes, log: Path) -> CapturedStop:
    try:
        fields = msgspec.json.decode(note, type=dict[str, Any])
        for end in ("from", "to"):
            fields[f"window_{end}_ns"] = int(str(fields.pop(f"window_{end}_mono_ns")))
        for name in ("time", "t_mono_ns"):
            fields.pop(name, None)
        for name in ("stop_count", "reading_mm", "beam"):
            fields.setdefault(name, None)
        stop = from_log(fields | msgspec.json.decode(fields.pop("messages", "") or "{}"))
        _require_possible(stop)
        return stop
    except (*DAMAGE, KeyError) as error:
        raise DataError(
            str(log), expected=message("stops-noted"), found=damage_of(error)
        ) from error


def _require_possible(stop: CapturedStop) -> None:
    if not _SETUP.fullmatch(stop.setup):
        raise impossible("setup", stop.setup[:40])
    if stop.stop < 0 or not 0.0 <= stop.time_s < LATEST_S:
        raise impossible("stop", f"{stop.stop}, {stop.time_s:g} s")


def _last_stop(logs: Sequence[Path]) -> CapturedStop | None:
    return next(
        (noted.stops[-1] for log in reversed(logs) if (noted := noted_in(log)).stops), None
    )


def _new_round(folder: Path, number: int, run: dict[str, str]) -> Round:
    return Round(folder / f"{number:04d}", {**run, "round": f"{number:04d}"})
