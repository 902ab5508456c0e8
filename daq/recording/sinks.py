"""Sinks of a session's logs without a recorder: files, or no storage."""

from collections.abc import Callable
from pathlib import Path

from stepdiag.daq.log.codec import whole_us
from stepdiag.daq.log.part_file import PartFile
from stepdiag.daq.log.topics import Note
from stepdiag.daq.log.writer import ExitStatus, LogHeader, LogWriter
from stepdiag.daq.records.events import Event


class DirectSink:
    """Writes the logs of a session in the caller's thread, without waiting for a disk."""

    def begin(self, path: Path, header: LogHeader) -> None:
        """Begin a log. Raises FileExistsError if a log exists at this path."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = PartFile(path)
        self._writer = LogWriter(self._file, header)

    def admit(self, event: Event) -> tuple[Event, ...]:
        event = whole_us(event)
        self._writer.event(event)
        return (event,)

    def note(self, note: Note) -> None:
        self._writer.note(note)

    def promise(self, note: Note, saved: Callable[[], object]) -> None:
        self._writer.note(note)
        saved()

    def end(self, status: ExitStatus, reason: str = "") -> None:
        """Finish the log, rename it to its final name and wait until it is on disk."""
        self._writer.finish(status, reason, {})
        self._file.drain()
        self._file.publish()
        self._file.close()


class Nowhere:
    def begin(self, path: Path, header: LogHeader) -> None:
        """Begin nothing."""

    def admit(self, event: Event) -> tuple[Event, ...]:
        return (event,)

    def note(self, note: Note) -> None:
        del note

    def promise(self, note: Note, saved: Callable[[], object]) -> None:
        """Report at once that a note is stored."""
        del note
        saved()

    def end(self, status: ExitStatus, reason: str = "") -> None:
        """End nothing."""
