"""The recorder: a separate thread that writes logs, so that no disk delays the reading of an
instrument.

`Recorder.admit` never blocks. The method returns the recorded events in the order of replay, and
only these events may be processed. If the disk is too slow, events are refused, counted, and
recorded in the log as a `Loss`. A full disk stops the recording; the recording continues without a
torn record as soon as there is space.
"""

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from stepdiag.base.errors import system_words
from stepdiag.base.messages import Words, message
from stepdiag.daq.log.codec import size_of, time_of, whole_us
from stepdiag.daq.log.disk_sync import DiskSync
from stepdiag.daq.log.part_file import PartFile
from stepdiag.daq.log.topics import Note
from stepdiag.daq.log.writer import ExitStatus, LogHeader, LogWriter
from stepdiag.daq.records.events import Event, Loss

FLUSH_S = 0.36
"""Longest time in s between two flushes. A killed process loses less than half a second of data:
the time since the last flush, 70 ms in reader and event loop, and the time of a write.
"""
SYNC_S = 1.0
"""Longest time in s that a power failure may lose; a captured stop is synced at once."""
RETRY_S = 0.5
"""Wait in s between a refusal of the disk and the next attempt."""
WAKE_BYTES = 262_144
"""Number of waiting bytes that wakes the thread before a flush is due. A wake-up costs as much as
processing 10 kB.
"""
BACKLOG_BYTES = 16_000_000
"""Largest number of bytes that wait for the disk: several seconds of the fastest instrument. After
an overrun, events are accepted again when fewer than half of these bytes wait.
"""

State = Literal["idle", "recording", "blocked", "dead"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderHealth:
    """State of the recorder: ``blocked`` while the disk refuses bytes, ``dead`` after an error has
    ended the thread.
    """

    state: State
    path: Path | None
    backlog_bytes: int
    lost_events: int
    reason: Words


@dataclass(frozen=True, slots=True)
class _Begin:
    path: Path
    header: LogHeader


@dataclass(frozen=True, slots=True)
class _End:
    status: ExitStatus
    reason: str
    lost_events: int


@dataclass(frozen=True, slots=True)
class _Promise:
    """A note whose storage is reported: ``saved`` is called when the note would survive the end of
    this process.
    """

    note: Note
    saved: Callable[[], object]


_Item = Event | Note | _Promise | _Begin | _End


@dataclass(frozen=True, slots=True)
class _OpenLog:
    file: PartFile
    writer: LogWriter


class Recorder:
    """Writes logs, one after another, in its own thread.

    ``begin``, ``admit``, ``note``, ``end`` and ``stop`` are called in the capturing thread.
    ``on_change`` is called in the thread of the recorder at every change of its state.
    """

    def __init__(
        self,
        on_change: Callable[[RecorderHealth], None],
        *,
        backlog_bytes: int = BACKLOG_BYTES,
    ) -> None:
        self._on_change = on_change
        self._limit = backlog_bytes
        self._items: deque[tuple[int, _Item]] = deque()
        self._promised: list[Callable[[], object]] = []
        self._taken_bytes = 0
        self._done_bytes = 0
        self._lost_bytes = 0
        self._lost_events = 0
        self._lost_before_log = 0
        self._loss_noted = 0
        self._state: State = "idle"
        self._reason: Words = ""
        self._log: _OpenLog | None = None
        self._flush_at = self._sync_at = 0.0
        self._wake = threading.Event()
        self._stopping = threading.Event()
        self._disk_sync = DiskSync()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def health(self) -> RecorderHealth:
        """Return the present state of the recorder. Any thread may call this method."""
        log = self._log
        return RecorderHealth(
            state=self._state,
            path=log.file.path if log else None,
            backlog_bytes=self._taken_bytes - self._done_bytes,
            lost_events=self._lost_events,
            reason=self._reason,
        )

    def begin(self, path: Path, header: LogHeader) -> None:
        """Begin the log ``path``; its name is ``<path>.part`` until `end`. An existing file of
        either name ends the recorder.
        """
        self._lost_before_log = self._lost_events
        self._put(0, _Begin(path, header))
        self._wake.set()

    def admit(self, event: Event) -> tuple[Event, ...]:
        """Record the next event and return the events to process: this event; a `Loss` and this
        event after a gap; or nothing for a refused event.
        """
        event = whole_us(event)
        size = size_of(event)
        gap = self._lost_events > self._loss_noted
        if self._state == "dead" or self._backlog + size > (
            self._limit // 2 if gap else self._limit
        ):
            self._lost_events += 1
            self._lost_bytes += size
            return ()
        admitted: tuple[Event, ...] = (self._loss(time_of(event)), event) if gap else (event,)
        for taken in admitted:
            self._put(size, taken)
        if self._backlog > WAKE_BYTES and not self._wake.is_set():
            self._wake.set()
        return admitted

    def note(self, note: Note) -> None:
        """Record a note. While the disk is too slow, notes are discarded, because a replay computes
        the notes from the events.
        """
        if self._state != "dead" and self._backlog <= self._limit:
            self._put(1000, note)

    def promise(self, note: Note, saved: Callable[[], object]) -> None:
        """Record the note of a captured stop or of the end of a pass, and write it at once with all
        earlier events and notes.

        ``saved`` is called in the thread of the recorder, in the order of the notes, when the note
        would survive the end of the process. A stop may be reported only after ``saved`` was
        called. A note that a full disk refuses remains in memory; a dead recorder never calls
        ``saved``.
        """
        if self._state != "dead":
            self._put(1000, _Promise(note, saved))
            self._wake.set()

    def end(self, status: ExitStatus, reason: str = "") -> None:
        """End the log: write the indexes and rename the file to its final name."""
        self._put(0, _End(status, reason, self._lost_events - self._lost_before_log))
        self._wake.set()

    def stop(self, timeout_s: float = 10.0) -> bool:
        """Write all recorded events and end the thread. Return False if the disk refused bytes; the
        last log then remains a ``.part``.
        """
        self._stopping.set()
        self._wake.set()
        self._thread.join(timeout_s)
        return not self._thread.is_alive() and self._log is None and not self._items

    @property
    def _backlog(self) -> int:
        return self._taken_bytes - self._done_bytes

    def _put(self, size: int, item: _Item) -> None:
        self._taken_bytes += size
        self._items.append((size, item))

    def _loss(self, time_ns: int) -> Loss:
        events = self._lost_events - self._loss_noted
        loss = Loss(time_ns, events, self._lost_bytes, self._reason or message("disk-slower"))
        self._loss_noted, self._lost_bytes = self._lost_events, 0
        return loss

    # The thread of the recorder runs the methods below.

    def _run(self) -> None:
        try:
            while self._serve():
                pass
        except Exception as error:  # noqa: BLE001 - whatever it is, the daemon must hear of it
            self._change("dead", f"{type(error).__name__}: {error}")
        finally:
            self._disk_sync.close()
            if self._log is not None:
                self._log.file.close()

    def _serve(self) -> bool:
        stopping = self._stopping.is_set()
        if not stopping:
            self._wake.wait(
                max(0.0, self._flush_at - time.monotonic()) if self._log else None
            )
        self._wake.clear()
        while self._items:
            size, item = self._items[0]
            if not self._take(item):
                return False
            self._items.popleft()
            self._done_bytes += size
        return self._save(now=bool(self._promised) or stopping) and not stopping

    def _take(self, item: _Item) -> bool:
        if isinstance(item, _Begin):
            return self._insist(lambda: self._open(item))
        if self._log is None:
            raise RuntimeError(f"{type(item).__name__} outside a log")
        if isinstance(item, _End):
            return self._finish(self._log, item)
        if isinstance(item, Note):
            self._log.writer.note(item)
        elif isinstance(item, _Promise):
            self._log.writer.note(item.note)
            self._promised.append(item.saved)
        else:
            self._log.writer.event(item)
        return self._log.file.waiting < WAKE_BYTES or self._insist(self._log.file.drain)

    def _open(self, begin: _Begin) -> None:
        begin.path.parent.mkdir(parents=True, exist_ok=True)
        file = PartFile(begin.path)
        self._log = _OpenLog(file, LogWriter(file, begin.header))
        self._flush_at = self._sync_at = time.monotonic()
        self._change("recording", "")

    def _finish(self, log: _OpenLog, end: _End) -> bool:
        log.writer.finish(end.status, end.reason, {"lost_events": end.lost_events})
        if not self._insist(log.file.drain):
            return False
        self._keep_promises()
        if not self._insist(log.file.publish):
            return False
        self._disk_sync.settle()
        log.file.close()
        self._log = None
        self._change("idle", "")
        return True

    def _save(self, *, now: bool) -> bool:
        log = self._log
        if log is None or not (now or time.monotonic() >= self._flush_at):
            return True
        self._flush_at = time.monotonic() + FLUSH_S
        log.writer.flush()
        saved = self._insist(log.file.drain)
        if saved:
            self._keep_promises()
        if saved and (now or time.monotonic() >= self._sync_at):
            saved = self._insist(lambda: self._disk_sync.request(log.file))
            self._sync_at = time.monotonic() + SYNC_S - FLUSH_S
        return saved

    def _keep_promises(self) -> None:
        promised, self._promised = self._promised, []
        for saved in promised:
            saved()

    def _insist(self, action: Callable[[], None]) -> bool:
        """Repeat a disk operation until it succeeds; return False if the disk still refuses at the
        end of the recorder.
        """
        while True:
            try:
                action()
            except FileExistsError:
                raise
            except OSError as error:
                self._change("blocked", system_words(error))
                if self._stopping.wait(RETRY_S):
                    return False
            else:
                if self._state == "blocked":
                    self._change("recording", "")
                return True

    def _change(self, state: State, reason: Words) -> None:
        if (state, reason) == (self._state, self._reason):
            return
        self._state, self._reason = state, reason
        self._on_change(self.health)
