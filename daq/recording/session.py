"""The decisions of the recording, without any input or output: the beginning and the end of each
log, and the open passes of the survey.
"""

import dataclasses
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import msgspec

from stepdiag.base.errors import UsageError
from stepdiag.base.findings import Finding
from stepdiag.base.messages import Message, Words, message
from stepdiag.base.setups import setups_meant
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.cause.finder import line_named, line_to_correct
from stepdiag.daq.capture.conditions import (
    believed_before,
    condition_names,
    is_sensed,
    with_air,
)
from stepdiag.daq.capture.outcome import Outcome
from stepdiag.daq.capture.standing.dwell import same_stop
from stepdiag.daq.formats.signals import SignalDecoder, Signals
from stepdiag.daq.log.codec import time_of
from stepdiag.daq.log.scene import scene_note
from stepdiag.daq.log.topics import (
    Note,
    finding_note,
    log_note,
    sample_note,
    signals_note,
    stop_note,
)
from stepdiag.daq.log.writer import ExitStatus, LogHeader
from stepdiag.daq.passes.deviations import RecentStops
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.recording.listening import Listening
from stepdiag.daq.recording.verdicts import Verdicts
from stepdiag.daq.records.events import Chunk, Event, Link, LinkEvent, ModbusBlock, Stream
from stepdiag.daq.survey.formats import decoders
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.host_clock import now_ns
from stepdiag.daq.timing.samples import Samples
from stepdiag.daq.timing.stream import Break, StreamBuffer, last_of_each
from stepdiag.daq.timing.strip import Strip

PREROLL_NS = 8_000_000_000
PREROLL_BYTES = 4_000_000
"""Largest number of bytes from before the opening of a log that the log contains: with only a stop
signal, the first dwell begins before the pass is recognised.
"""
SAMPLE_NOTE_NS = 200_000_000
SIGNALS_NOTE_NS = 500_000_000
"""Period in ns in which the reading and the signals are written into a log, for a viewer."""
IDLE_CLOSE_NS = 5_000_000_000
"""Time in ns from the end of the machine's program to the end of a log without a stop."""


INTERRUPTED = Break(0, message("recording-interrupted"), watched=False)
"""The possible loss of count before a session that continues a pass of an earlier daemon."""


class LogSink(Protocol):
    def begin(self, path: Path, header: LogHeader) -> None: ...
    def admit(self, event: Event) -> tuple[Event, ...]: ...
    def note(self, note: Note) -> None: ...
    def promise(self, note: Note, saved: Callable[[], object]) -> None: ...
    def end(self, status: ExitStatus, reason: str = "") -> None: ...


@dataclass(slots=True)
class Round:
    """A survey on disk: its folder, the ``stepdiag.run`` of every log, and the contents of its
    logs.

    The contents are the stops, the findings, and the statements of the operator and the solver
    beside the logs. ``left`` is the last stop of the previous survey, at which the machine may
    still stand.
    """

    folder: Path
    run: dict[str, str]
    logs: int = 0
    stops: tuple[CapturedStop, ...] = ()
    findings: tuple[Finding, ...] = ()
    verdicts: Verdicts = field(default_factory=Verdicts)
    left: CapturedStop | None = None


class Session:
    """Processes the events of one survey from the first stop to the last, in ``consume``.

    ``on_outcome`` receives every finding and every end of a pass at once, and every stop as soon as
    the log contains the stop safely; the thread of the recorder makes the calls for stops. A
    session that is not ``armed`` first waits for the end of the running program, which belongs to
    the previous survey.
    """

    def __init__(
        self,
        survey: Survey,
        survey_text: str,
        begun: Round,
        sink: LogSink,
        *,
        on_outcome: Callable[[Outcome], None],
        wall_offset_ns: Callable[[], int],
        armed: bool = True,
    ) -> None:
        self.survey = survey
        self._text = survey_text
        self.round = begun
        self._sink = sink
        self._on_outcome = on_outcome
        self._wall_offset_ns = wall_offset_ns
        self._stops_offset_ns: int | None = None
        self._breaks: tuple[Break, ...] = (INTERRUPTED,) if begun.stops else ()
        self._beyond: bool | None = False
        self._logs = begun.logs
        self._before: deque[Event] = deque()
        self._before_bytes = 0
        self._standing: Signals | None = None
        self._skip_dwell = False
        self._armed = armed
        self._last_setup: int | None = None
        self._anew = not begun.stops
        self._idle_decoder = SignalDecoder(survey.plc.signals, survey.plc.parsed())
        self._left_ns: int | None = None
        self._silent = survey.plc.silent
        self._begun = ""
        self._passes_left = 0
        self._noted_sample_ns = self._noted_signals_ns = 0
        self._idle = _idle_streams(survey)
        self._sensed = is_sensed(survey)
        self._listening = Listening(survey)
        self._down: set[Link] = set()
        self.capture: Capture | None = None
        self._samples = 0
        self._strip = Strip()
        self._unshown: StreamBuffer | None = None
        """The laser's samples of the last pass until they are displayed. The display is delayed,
        because the machine waits for an answer at the end of the pass.
        """
        self.recent = RecentStops()
        self.signals: Signals | None = None
        self.book = PassBook(survey)
        self.book.foretell(begun.verdicts.suspicions)
        self.book.add_all(begun.stops)
        self.book.news()
        self.owed: int | None = None
        """The machine's count at the last captured stop, because an earlier daemon may have ended
        before it answered this stop.
        """
        self._stand_at(self.book.last or begun.left)
        self._stops = list(begun.stops)
        self._drawn: list[CapturedStop] = []
        self.findings = list(begun.findings)
        self.book.wrong_line = next(filter(None, map(line_to_correct, self.findings)), "")
        self.unsolved = begun.verdicts.tell(self.book)
        """The reason why the survey cannot be solved although every pass is complete; empty
        otherwise.
        """
        self.shown_zero_mm = 0.0

    def _stand_at(self, last: CapturedStop | None) -> None:
        """Record that an earlier daemon captured the last stop of a pass. The machine may wait at
        this stop for the answer that was lost with the daemon, not for a new pass.

        Without a stop counter it is unknown whether the machine has moved in between.
        """
        if last is None or last.stop_count is None:
            return
        self.owed = last.stop_count
        if last is self.book.last and last.stop < self.book.last_stop(last):
            return
        x, y, z = last.position_mm
        self._standing = Signals(
            stopped=True, stop_count=last.stop_count, x_mm=x, y_mm=y, z_mm=z
        )

    @property
    def folder(self) -> Path:
        return self.round.folder

    @property
    def recording(self) -> bool:
        return self.capture is not None

    @property
    def strip(self) -> Strip:
        """Return the newest readings for display. This call decodes the samples; without a page,
        chunks are collected and decoded together.
        """
        if self._unshown is not None:
            self._strip.follow(self._unshown)
            self._unshown = None
        self._strip.follow(
            self._idle["laser"] if self.capture is None else self.capture.laser
        )
        return self._strip

    @property
    def machine_waits(self) -> bool:
        """Return whether the machine stands at a stop until it receives the answer that the stop is
        captured.
        """
        return self.capture is not None and self.capture.machine_waits

    @property
    def runs_on(self) -> bool:
        """Return whether the machine's program belongs to the previous survey, which is over."""
        return not self._armed

    @property
    def samples(self) -> int:
        return self._samples + (self.capture.laser.samples if self.capture is not None else 0)

    def consume(self, event: Event) -> None:
        """Record the next event in the log, then pass the event to the capture. Without a log,
        store the event until a log begins.
        """
        if isinstance(event, LinkEvent):
            self._listening.take_link(event)
            (self._down.discard if event.state == "connected" else self._down.add)(event.link)
        if self.capture is None:
            self._wait(event)
            return
        capture = self.capture
        if self._silent or capture.may_be_over:
            self._remember(
                event
            )  # the next pass may begin before the end of the present pass is recognised
        for admitted in self._sink.admit(event):
            if capture.ended is None:
                self._feed(capture, admitted)

    def begin(self, setup: str, at_ns: int) -> None:
        """Begin a setup of a machine without signals, after the operator's announcement.

        Raises UsageError if the machine signals setups, a pass is being recorded, or the plan needs
        no pass of the setup.
        """
        refused = self._why_not(setup)
        if refused:
            raise UsageError(
                message("where-begin", name=setup),
                expected=message("expects-begun"),
                found=refused,
            )
        self.book.preferred, self._begun = setup, setup
        self._passes_left = self.survey.plan.passes_per_setup
        self._before, self._before_bytes = (
            deque(),
            0,
        )  # standstills and moves before this moment do not belong to this setup
        self._begin_log(at_ns)

    def _why_not(self, setup: str) -> Words:
        planned = self.survey.plan.all_setups
        if not self.survey.plc.silent:
            return message("found-says-itself")
        if self.recording:
            return message("found-being-recorded", name=self._begun)
        if setup not in planned:
            return message("found-not-planned", names=planned)
        return "" if self.book.open_passes(setup) else message("found-all-in")

    def zero(self) -> None:
        """Show the reading relative to the present reading from now on; recorded readings are
        unchanged.
        """
        last = self.laser_samples()
        self.shown_zero_mm = (
            0.0
            if last is None or math.isnan(last.position_mm[-1])
            else float(last.position_mm[-1])
        )

    def close(self, reason: Message) -> None:
        """Close an open log because the daemon stops or a person aborts the setup."""
        if self.capture is not None:
            for outcome in self.capture.finish():
                self._heed(outcome)
            self._begun = ""
            self._end_log("interrupted", reason)

    def hear(self, verdicts: Verdicts) -> None:
        self.unsolved = verdicts.tell(self.book)

    def as_round(self, verdicts: Verdicts) -> Round:
        return Round(
            self.folder,
            self.round.run,
            logs=self._logs,
            stops=tuple(self._stops),
            findings=tuple(self.findings),
            verdicts=verdicts,
        )

    def say(self, finding: Finding) -> None:
        """Add a finding from outside the recording, also to an open log."""
        self._heed(finding)

    def remark(self, what: Message) -> None:
        """Write a line for the viewer into an open log."""
        if self.capture is not None:
            self._sink.note(log_note(now_ns(), "warning", str(what), "daemon"))

    def found(self, finding: Finding) -> None:
        """Store a finding from outside the recording with the findings of the capture."""
        self.findings.append(finding)
        if self.capture is not None:
            self._sink.note(finding_note(self._noted_signals_ns, finding))

    def conditions(self) -> dict[str, float]:
        sensor = self._idle_air() if self.capture is None else self.capture.air
        return {
            name: sensor.conditions[name]
            for name in condition_names(self.survey, sensor)
            if name in sensor.conditions
        }

    def laser_samples(self) -> Samples | None:
        """Return the newest batch of the laser's samples, recorded or not; None before the first
        batch.
        """
        return self._idle["laser"].last if self.capture is None else self.capture.laser.last

    def _wait(self, event: Event) -> None:
        self._remember(event)
        if isinstance(event, Chunk):
            self._hear(event)
        elif isinstance(event, LinkEvent) and event.interrupts and event.link in self._idle:
            self._idle[event.link].interrupted(event.time_ns)
            self._idle[event.link].forget_breaks()
        if isinstance(event, ModbusBlock):
            signals = self._decode(event)
            self._anew = self._anew or signals.program_over
            if self._standing is not None and not (
                signals.stopped and same_stop(self._standing, signals)
            ):
                self._standing = None
            self._skip_dwell = self._skip_dwell or self._standing is not None
            if self._begins(signals):
                self._begin_log(time_of(event))

    def _hear(self, chunk: Chunk) -> None:
        if chunk.stream in self._idle:
            self._idle[chunk.stream].feed(chunk.data, chunk.arrival_ns)
            self._idle[chunk.stream].forget_breaks()
        for found in self._listening.take(chunk):
            self._heed(found)

    def _idle_air(self) -> StreamBuffer:
        return self._idle.get("air", self._idle["laser"])

    def _decode(self, block: ModbusBlock) -> Signals:
        self.signals = with_air(
            self.survey, self._idle_decoder.decode(block), self._idle_air(), block.recv_ns
        )
        return self.signals

    def _begins(self, signals: Signals) -> bool:
        self._armed = self._armed or self._left(signals)
        self._last_setup = signals.setup
        if not self._armed or self._standing is not None or signals.program_over:
            return False
        named = signals.running is True or signals.setup is not None
        return signals.stopped is True or (named and self._wanted(signals.setup))

    def _left(self, signals: Signals) -> bool:
        if signals.running is None and signals.setup is None:
            return not signals.stopped
        return signals.program_over or (
            self._last_setup is not None and signals.setup != self._last_setup
        )

    def _wanted(self, setup: int | None) -> bool:
        if setup is None:
            return not self.book.complete()
        return any(
            self.book.open_passes(name)
            for name in setups_meant(setup, self.survey.plan.all_setups)
        )

    def _remember(self, event: Event) -> None:
        self._before.append(event)
        self._before_bytes += len(event.data) if isinstance(event, Chunk) else 0
        newest = time_of(event)
        while (
            self._before_bytes > PREROLL_BYTES
            or time_of(self._before[0]) < newest - PREROLL_NS
        ):
            oldest = self._before.popleft()
            self._before_bytes -= len(oldest.data) if isinstance(oldest, Chunk) else 0

    def _begin_log(self, now_ns: int) -> None:
        self._logs += 1
        self._drawn = []
        events, self._before, self._before_bytes = list(self._before), deque(), 0
        offset = self._wall_offset_ns()
        self._stops_offset_ns = (
            offset if self._stops_offset_ns is None else self._stops_offset_ns
        )
        breaks = last_of_each((*self._breaks, *self._idle["laser"].breaks))
        start = self.book.start(
            skip_open_dwell=self._skip_dwell,
            wall_offset_ns=self._stops_offset_ns,
            breaks=breaks,
            beyond=self._beyond,
            anew=self._anew,
        )
        self._anew = False
        believed = believed_before(
            self.survey, self._idle_air(), now_ns, self._stops_offset_ns, start.credible
        )
        start = msgspec.structs.replace(
            start,
            credible=believed,
            last_count=self.owed if start.last_count is None else start.last_count,
            down=tuple(sorted(self._down)),
            named=tuple(
                dict.fromkeys(line for each in self.findings if (line := line_named(each)))
            ),
        )
        setup = self.book.next_setup() or "more"
        header = LogHeader(
            survey_text=self._text,
            wall_offset_ns=offset,
            start_ns=time_of(events[0]) if events else now_ns,
            run={
                **self.round.run,
                "expected_setup": setup,
                "start": msgspec.json.encode(start).decode(),
            },
        )
        self._sink.begin(self.round.folder / f"{self._logs:04d}.mcap", header)
        self.capture = Capture(self.survey, start)
        self._left_ns = None
        self._skip_dwell = False
        for event in events:
            self.consume(event)

    def _feed(self, capture: Capture, event: Event) -> None:
        for outcome in capture.feed(event):
            self._heed(outcome)
        if capture.signals is not None and isinstance(event, ModbusBlock):
            self.signals = (
                with_air(self.survey, capture.signals, capture.air, event.recv_ns)
                if self._sensed
                else capture.signals
            )
        self._note(capture, event)
        if capture.ended is not None:
            self._standing = capture.standing
            status: ExitStatus = "complete" if capture.ended.kind == "complete" else "aborted"
            self._end_log(status, capture.ended.reason)
            if capture.next_from_ns is not None:
                self._begin_next(capture.next_from_ns, time_of(event))
            else:
                self._go_on(time_of(event), whole=status == "complete")
        elif self._forgotten(capture, event):
            self._end_log("aborted", message("ended-without-stop"))

    def _go_on(self, now_ns: int, *, whole: bool) -> None:
        """Begin the next pass of the announced setup, because the machine's program drives the
        passes in turn.
        """
        self._passes_left -= 1
        if (
            self._begun
            and whole
            and self._passes_left > 0
            and self.book.open_passes(self._begun)
        ):
            self._begin_next(self._stops[-1].window_to_ns, now_ns)
        else:
            self._begun = ""

    def _begin_next(self, since_ns: int, now_ns: int) -> None:
        self._before = deque(each for each in self._before if time_of(each) > since_ns)
        self._begin_log(now_ns)

    def _forgotten(self, capture: Capture, event: Event) -> bool:
        signals = capture.signals
        if capture.walk is not None or signals is None or not signals.program_over:
            self._left_ns = None
            return False
        self._left_ns = self._left_ns or time_of(event)
        return time_of(event) - self._left_ns > IDLE_CLOSE_NS

    def _end_log(self, status: ExitStatus, reason: Message) -> None:
        self._samples = self.samples
        self._sink.end(status, str(reason))
        self._breaks = self.capture.left_over() if self.capture is not None else ()
        self._beyond = self.capture.went_beyond() if self.capture is not None else False
        self._unshown = self.capture.laser if self.capture is not None else None
        self.capture = None
        self._idle = _idle_streams(self.survey)

    def _heed(self, outcome: Outcome) -> None:
        if isinstance(outcome, CapturedStop):
            self._stops.append(outcome)
            self.book.add(outcome)
            self.unsolved = ""
            self._sink.promise(
                stop_note(outcome, *self.book.deviation(outcome)),
                lambda: self._on_outcome(outcome),
            )
            self._draw(outcome)
            for remark in self.book.news():
                for raised in (
                    self.capture.heed(remark) if self.capture is not None else [remark]
                ):
                    self._heed(raised)
            return
        if isinstance(outcome, Finding):
            outcome = self._of_pass(outcome)
            self.findings.append(outcome)
            self.book.wrong_line = line_to_correct(outcome) or self.book.wrong_line
            if self.recording:
                self._sink.note(finding_note(self._noted_signals_ns, outcome))
        self._on_outcome(outcome)

    def _draw(self, stop: CapturedStop) -> None:
        self._drawn.append(stop)
        walk = self.capture.walk if self.capture is not None else None
        if walk is not None:
            self._sink.note(scene_note(self.survey.volume, walk.route.stops_mm, self._drawn))

    def _of_pass(self, found: Finding) -> Finding:
        walk = self.capture.walk if self.capture is not None else None
        if walk is None or found.setup != walk.route.setup or found.pass_number is not None:
            return found
        return dataclasses.replace(found, pass_number=self.book.number_of(walk.route))

    def _note(self, capture: Capture, event: Event) -> None:
        now = time_of(event)
        if (
            isinstance(event, Chunk)
            and now - self._noted_sample_ns >= SAMPLE_NOTE_NS
            and (last := capture.laser.last) is not None
        ):
            self._noted_sample_ns = now
            beam = float(last.beam[-1])
            self._sink.note(
                sample_note(
                    now,
                    float(last.position_mm[-1]),
                    None if math.isnan(beam) else beam,
                    int(last.flags[-1]),
                )
            )
        if (
            capture.signals is not None
            and isinstance(event, ModbusBlock)
            and now - self._noted_signals_ns >= SIGNALS_NOTE_NS
        ):
            self._noted_signals_ns = now
            self._sink.note(signals_note(now, capture.signals))


def _idle_streams(survey: Survey) -> dict[Stream, StreamBuffer]:
    return {
        stream: StreamBuffer(decoder)
        for stream, decoder in decoders(survey).items()
        if stream != "head"
    }
