"""The sinks of a session's logs without a recorder (`daq.recording.session.LogSink`): straight into
files, or nowhere.
"""

from collections.abc import Callable
from pathlib import Path

from stepdiag.daq.log.codec import whole_us
from stepdiag.daq.log.part_file import PartFile
from stepdiag.daq.log.topics import Note
from stepdiag.daq.log.writer import ExitStatus, LogHeader, LogWriter
from stepdiag.daq.records.events import Event


class DirectSink:
    """Writes the logs of a session in the caller's thread (`daq.recording.session.LogSink`),
    without waiting for a disk.
    """

    def begin(self, path: Path, header: LogHeader) -> None:
        """Begin a log. Raises FileExistsError where a log exists at its path."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = PartFile(path)
        self._writer = LogWriter(self._file, header)

    def admit(self, event: Event) -> tuple[Event, ...]:
        """Write an event; return it in the form of the log."""
        event = whole_us(event)
        self._writer.event(event)
        return (event,)

    def note(self, note: Note) -> None:
        """Write a note."""
        self._writer.note(note)

    def promise(self, note: Note, saved: Callable[[], object]) -> None:
        """Write a note and report it."""
        self._writer.note(note)
        saved()

    def end(self, status: ExitStatus, reason: str = "") -> None:
        """Finish the log, rename it to its final name and wait until it is on the disk."""
        self._writer.finish(status, reason, {})
        self._file.drain()
        self._file.publish()
        self._file.close()


class Nowhere:
    """A sink that stores nothing."""

    def begin(self, path: Path, header: LogHeader) -> None:
        """Begin nothing."""

    def admit(self, event: Event) -> tuple[Event, ...]:
        """Return an event as it is."""
        return (event,)

    def note(self, note: Note) -> None:
        """Keep no note."""
        del note

    def promise(self, note: Note, saved: Callable[[], object]) -> None:
        """Report a note at once."""
        del note
        saved()

    def end(self, status: ExitStatus, reason: str = "") -> None:
        """End nothing."""
