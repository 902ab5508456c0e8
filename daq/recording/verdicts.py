"""Verdicts on a survey, stored beside its logs: an operator accepts a doubt or states the time, or
the solver finds no result.

``accepted.jsonl``, ``dated.jsonl`` and ``judged.jsonl`` contain one JSON object per line. Lines are
only appended. A line torn by a power failure is skipped, and its doubt is then open again.
"""

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import msgspec
import structlog

from stepdiag.base.errors import UsageError, system_words
from stepdiag.base.files import read_bytes
from stepdiag.base.messages import Words, message
from stepdiag.daq.passes.doubt import Acceptance, Doubt, TimeStated, acceptance_of
from stepdiag.daq.passes.pass_book import PassBook

ACCEPTED = "accepted.jsonl"
DATED = "dated.jsonl"
JUDGED = "judged.jsonl"
CORRECTED = "corrected.jsonl"
WORDS = (ACCEPTED, DATED, JUDGED, CORRECTED)
"""The files beside the logs of a survey with verdicts and corrections."""
LARGEST_BYTES = 4_000_000
"""Largest size in bytes of a file of verdicts, far more than persons write; a larger file is
refused.
"""
Line = TypeVar("Line", bound=msgspec.Struct)

_log = structlog.get_logger("verdicts")


class Judgement(msgspec.Struct, frozen=True, kw_only=True):
    """The reason why the solver found no result suitable for export.

    ``stops`` is the number of captured stops at the time of the judgement; another stop makes the
    judgement out of date. ``doubts`` are the most probable faults, empty if no repeated pass would
    help.
    """

    time_s: float
    stops: int
    reason: Words
    doubts: tuple[Doubt, ...] = ()


class Verdicts(msgspec.Struct, frozen=True, kw_only=True):
    accepted: tuple[Acceptance, ...] = ()
    judgements: tuple[Judgement, ...] = ()
    """All verdicts of the solver, in order; the last is valid."""
    dated: tuple[TimeStated, ...] = ()
    """The times that persons stated, in order; the last is valid."""

    @property
    def suspicions(self) -> tuple[tuple[int, tuple[Doubt, ...]], ...]:
        """Return the most probable faults of each judgement, with the number of captured stops at
        its time, for `PassBook.foretell`.
        """
        return tuple((each.stops, each.doubts) for each in self.judgements)

    def tell(self, book: PassBook) -> Words:
        """Apply the verdicts to the passes of a survey. Return the reason why the survey cannot be
        solved although every pass is complete; empty without a reason.
        """
        for word in self.accepted:
            book.accept(word)
        book.time_stated = self.dated[-1] if self.dated else None
        judged = self.judgements[-1] if self.judgements else None
        book.suspect(judged.doubts if judged is not None else ())
        return (
            judged.reason
            if judged is not None and not judged.doubts and judged.stops == book.stops
            else ""
        )


def verdicts_in(folder: Path) -> Verdicts:
    return Verdicts(
        accepted=tuple(lines_of(folder / ACCEPTED, Acceptance)),
        judgements=tuple(lines_of(folder / JUDGED, Judgement)),
        dated=tuple(lines_of(folder / DATED, TimeStated)),
    )


def accept(
    doubts: Sequence[Doubt], folder: Path, *, reason: str, name: str, time_s: float
) -> None:
    """Add a person's acceptance of doubts, and wait until the acceptance is on disk.

    Raises UsageError if the reason or the name is empty, or the file cannot be written.
    """
    _require_words(reason=reason, name=name)
    words = [
        acceptance_of(doubt, reason=reason.strip(), name=name.strip(), time_s=time_s)
        for doubt in doubts
    ]
    append_line(folder / ACCEPTED, b"\n".join(map(msgspec.json.encode, words)))


def state_time(
    folder: Path, begun_s: float, *, reason: str, name: str, time_s: float
) -> None:
    """Add a person's statement of the time of the first stop in seconds since 1970, and wait until
    the statement is on disk. Raises the errors of `accept`.
    """
    _require_words(reason=reason, name=name)
    word = TimeStated(
        begun_s=begun_s, name=name.strip(), reason=reason.strip(), time_s=time_s
    )
    append_line(folder / DATED, msgspec.json.encode(word))


def _require_words(**given: str) -> None:
    for field, text in given.items():
        if not text.strip():
            raise UsageError(
                message("where-accept-field", field=field),
                expected=message("expects-words"),
                found=message("nothing"),
            )


def doubts_at(still: Sequence[Doubt], place: str) -> list[Doubt]:
    """Return the open doubts at a place. The place ``ppp/1/5`` is stop 5 of pass 1 of ppp;
    ``ppp/1`` is the pass with all its stops.

    ``place`` may also be the code of a finding, such as ``too-many-outliers``, which selects all
    doubts with this code. A line of the survey file selects all doubts that this line causes.

    Raises UsageError with the list of the open doubts if the place has no open doubt.
    """
    found = [
        doubt
        for doubt in still
        if place
        and place
        in (doubt.place, f"{doubt.setup}/{doubt.pass_number}", doubt.code, doubt.line)
    ]
    if not found:
        named = [
            message("place-and-code", place=doubt.place, code=doubt.code) for doubt in still
        ]
        raise UsageError(
            message("where-accept"),
            expected=message("expects-place", places=named)
            if named
            else message("expects-doubted"),
            found=repr(place),
        )
    return found


def note_judgement(folder: Path, judged: Judgement) -> None:
    """Add a verdict of the solver, and wait until the verdict is on disk. Raises UsageError if the
    file cannot be written.
    """
    append_line(folder / JUDGED, msgspec.json.encode(judged))


def mark_of(folder: Path) -> tuple[int, ...]:
    """Return a value that changes whenever a line is added to a file of verdicts."""
    return tuple(
        path.stat().st_size if path.exists() else 0
        for path in (folder / name for name in WORDS)
    )


def append_line(path: Path, line: bytes) -> None:
    """Append a line to a file, which may end with a torn line, and wait until the new line is on
    disk. If the disk refuses, the file is unchanged, and UsageError is raised.
    """
    before = path.stat().st_size if path.exists() else None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab+") as file:
            if file.tell():
                file.seek(-1, os.SEEK_END)
                line = (b"" if file.read(1) == b"\n" else b"\n") + line
            file.write(line + b"\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        with suppress(OSError):  # no part of a refused line may remain in the file
            _back_to(path, before)
        raise UsageError(
            str(path), expected=message("file-can-be-written"), found=system_words(error)
        ) from error


def _back_to(path: Path, size: int | None) -> None:
    if size is None:
        path.unlink(missing_ok=True)
    else:
        os.truncate(path, size)


def lines_of(path: Path, kind: type[Line]) -> list[Line]:
    """Return the values of one kind in the lines of a file, without torn lines; empty for a missing
    file.
    """
    if not path.is_file():
        return []
    found: list[Line] = []
    torn: list[tuple[int, str]] = []
    for number, line in enumerate(
        read_bytes(path, largest=LARGEST_BYTES).splitlines(), start=1
    ):
        try:
            found.append(msgspec.json.decode(line, type=kind))
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            torn.append((number, str(error)))
    if torn:
        _log.warning(
            "verdict-not-read",
            file=str(path),
            lines=len(torn),
            line=torn[0][0],
            reason=torn[0][1],
        )
    return found
