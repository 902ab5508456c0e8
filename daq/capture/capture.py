"""The common code of the live run and the replay: bytes and register blocks in, stops and findings
out.

A capture belongs to one log. The survey and the `CaptureStart` in the log are the only initial
state of a capture. So the replay of a log runs the same code on the same input, and gives the same
stops to the last bit.
"""

import math
from dataclasses import replace
from typing import Literal

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Message, message
from stepdiag.daq.capture.by_laser import ByLaser
from stepdiag.daq.capture.cause.finder import CauseFinder
from stepdiag.daq.capture.cause.likelihood import Stand, moves_between
from stepdiag.daq.capture.conditions import Conditions, is_sensed, with_air
from stepdiag.daq.capture.head_stop import AngleView, QdView
from stepdiag.daq.capture.log_start import CaptureStart
from stepdiag.daq.capture.naming.finder import PassFinder
from stepdiag.daq.capture.naming.walk import Walk
from stepdiag.daq.capture.noise import LAG_NS, MOMENT_NS
from stepdiag.daq.capture.outages import Outages
from stepdiag.daq.capture.outcome import Ended, Outcome
from stepdiag.daq.capture.remarks.remarks import Alarm, Pulse, StreamRemarks, remarked
from stepdiag.daq.capture.remarks.unchecked import unchecked
from stepdiag.daq.capture.standing.certain_window import (
    Taken,
    certain_windows,
    last_beyond_ns,
    unbroken_parts,
    watched_closely,
)
from stepdiag.daq.capture.standing.dwell import (
    Dwell,
    DwellTracker,
    Standstills,
)
from stepdiag.daq.capture.standing.window import Placing
from stepdiag.daq.capture.stop_capture import StopTaker
from stepdiag.daq.formats.signals import SignalDecoder, Signals
from stepdiag.daq.records.events import Chunk, Event, LinkEvent, Loss, ModbusBlock, Stream
from stepdiag.daq.survey.formats import decoders
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.stream import NOT_RECORDED, Break, StreamBuffer

FAR_NS = 1 << 62
"""A time in ns after every event. After the end of a log the capture uses this time as the present
time, so that no standstill waits for samples.
"""
PATIENCE = 10.0
"""Number of windows after which, with the handshake, an unsteady stop is captured nevertheless and
marked as doubtful.
"""


class Capture:
    """Follows a log. Feed every event in order; each call returns the outcomes."""

    def __init__(self, survey: Survey, start: CaptureStart) -> None:
        self._survey = survey
        self._streams: dict[Stream, StreamBuffer] = {
            stream: StreamBuffer(decoder) for stream, decoder in decoders(survey).items()
        }
        self.laser = self._streams["laser"]
        self.head = self._streams.get("head")
        self.air = self._streams.get("air", self.laser)
        self.signals: Signals | None = None
        self.tracker = DwellTracker()
        self.ended: Ended | None = None
        self._decoder = SignalDecoder(survey.plc.signals, survey.plc.parsed())
        self._pulse = Pulse()
        self._alarm = Alarm(start.wall_offset_ns)
        self._conditions = Conditions(survey, start.credible)
        self._wall_offset_ns = start.wall_offset_ns
        self._remarks = StreamRemarks(self._streams)
        self._finder = PassFinder(survey, start)
        self._outages = Outages(start.down)
        self._taker = StopTaker(survey, self.laser, self.head, start, self._outages)
        self._pending = Standstills()
        self._by_laser = ByLaser(survey, start, self.laser) if survey.plc.silent else None
        self._cause = CauseFinder(survey, start.hints, named=start.named)
        self._dwell_before: Dwell | None = None
        self._asked = (0, 0, 0, 0)
        self._answered: list[Taken] = []
        self._sensed = is_sensed(survey)
        self._handshake = survey.plc.handshake.enabled
        self._late_ns = int(survey.plc.latency_s * 1e9)
        self._skip_open = start.skip_open_dwell
        self._last_count = start.last_count
        self._setup: int | None = None
        self._taken_from_ns = -1
        self._went_on = False
        self.next_from_ns: int | None = None
        """Time in ns from which the events belong to the next pass; None unless the first
        standstill of the next pass has ended this pass.
        """
        self._heard_since_poll = False

    @property
    def walk(self) -> Walk | None:
        """Return the pass that the machine drives; None before its first dwell."""
        return self._finder.walk

    @property
    def machine_waits(self) -> bool:
        """Return whether the machine waits with the handshake at an uncaptured stop."""
        dwell = self.tracker.open
        return self._handshake and dwell is not None and dwell.from_ns != self._taken_from_ns

    @property
    def at_stop(self) -> bool:
        """Return whether the machine stands, or has left a stop whose capture is not finished."""
        return self.tracker.open is not None or bool(self._pending)

    @property
    def driven_out(self) -> bool:
        """Return whether the machine has left the last stop of its pass and the capture of this
        stop is about to end. The beam is then no longer needed.
        """
        walk = self.walk
        return (
            walk is not None
            and not self.ended
            and walk.expected == len(walk.route) - 1
            and bool(self._pending)
        )

    @property
    def may_be_over(self) -> bool:
        """Return whether the pass may be over although one of its stops is missing. The next
        standstill shows whether it belongs to this pass or to the next pass.
        """
        walk = self.walk
        if walk is None or self.ended or self._by_laser is not None:
            return False
        return self._cause.misses_first(walk.route)

    @property
    def standing(self) -> Signals | None:
        """Return the signals of a captured stop at which the machine still stands: the following
        log must not capture this stop again.
        """
        dwell = self.tracker.open
        if (
            dwell is None or self._went_on
        ):  # the first stop of another setup belongs to the following log
            return None
        taken = dwell.from_ns == self._taken_from_ns or self._pending.goes_on(
            dwell, self._mover(dwell.signals)
        )
        return dwell.signals if taken else None

    def feed(self, event: Event) -> list[Outcome]:
        """Process an event; return its stops, findings and the end of the pass, in order."""
        outcomes = self._followed(event)
        return self._as_raised(outcomes) if outcomes else outcomes

    def _losses(self, until_ns: float) -> int:
        return sum(each.watched and each.time_ns <= until_ns for each in self.laser.breaks)

    def heed(self, found: Finding) -> list[Finding]:
        """Return a finding about the passes, or nothing while a cause may still explain the
        finding.
        """
        return self._cause.heed(found)

    def _as_raised(self, outcomes: list[Outcome]) -> list[Outcome]:
        """Return the outcomes without the findings that a cause explains or may still explain. At
        the end of a pass the findings without a cause are returned.
        """
        raised: list[Outcome] = []
        for each in outcomes:
            if isinstance(each, Ended):
                raised += self._cause.released()
            raised += self._cause.heed(each) if isinstance(each, Finding) else [each]
        return raised

    def _followed(self, event: Event) -> list[Outcome]:
        outcomes: list[Outcome] = []
        if isinstance(event, Chunk):
            self._take_chunk(event)
            now_ns = event.arrival_ns
            if self._by_laser is not None and not self.ended:
                self._take_stands(self._by_laser, now_ns, outcomes)
        elif isinstance(event, ModbusBlock):
            self._take_block(event, outcomes)
            now_ns = event.recv_ns
        else:
            if isinstance(event, LinkEvent):
                self._outages.take(event)
            self._take_remark(event, outcomes)
            now_ns = event.time_ns
        if self._pending:
            self._settle(now_ns, outcomes)
        if self._handshake and not (
            self._skip_open or self._pulse.still or self._samples_follow(event)
        ):
            self._take_early(outcomes)
        self._remarks.listen_now_and_then(now_ns, outcomes)
        return outcomes

    def finish(self) -> list[Outcome]:
        """Return the outcomes of the dwells that still wait for samples: the log has ended."""
        outcomes: list[Outcome] = []
        for dwell in self._by_laser.finish() if self._by_laser is not None else ():
            self._pending.add(dwell)
        while self._pending:
            self._pending.settled(FAR_NS, None, self._mover(self._pending.first().signals))
            self._take_dwell(self._pending.take(), outcomes)
        self._remarks.listen(outcomes)
        if not self.ended and self.may_be_over:
            self._name_from_second(outcomes)
        return [*self._as_raised(outcomes), *self._cause.released()]

    def left_over(self) -> tuple[Break, ...]:
        """Return the breaks of the laser's count after the last stop, for the next log of the same
        pass.
        """
        return self._taker.left_over()

    def went_beyond(self) -> bool | None:
        """Return whether the machine was observed to overrun the last stop of its pass and to
        return from the other side; None if this is uncertain.
        """
        walk = self.walk
        if walk is None or walk.last is None or walk.last.stop < len(walk.route) - 1:
            return False
        towards = walk.route.step_mm(len(walk.route) - 2, len(walk.route) - 1)
        if last_beyond_ns(self.laser, walk.last, towards, math.inf) is not None:
            return True
        return False if watched_closely(self.laser, walk.last, math.inf) else None

    def _take_chunk(self, chunk: Chunk) -> None:
        buffer = self._streams.get(chunk.stream)
        if buffer is not None:
            buffer.feed(chunk.data, chunk.arrival_ns)

    def _take_stands(self, by_laser: ByLaser, now_ns: int, outcomes: list[Outcome]) -> None:
        """Process the standstills that only the laser shows."""
        before = len(by_laser.seen)
        dwells, outcomes_of_laser = by_laser.look(now_ns)
        for ended_ns, level_mm in by_laser.seen[before:]:
            outcomes.extend(
                self._cause.take(
                    Stand(Signals(stopped=True), level_mm, self._losses(ended_ns)),
                    by_laser.setup,
                    0,
                )
            )
        for outcome in outcomes_of_laser:
            if isinstance(outcome, Ended):
                self._end(outcome.kind, outcome.reason, outcomes)
            else:
                outcomes.append(outcome)
        for dwell in dwells:
            self._pending.add(dwell)

    def _take_remark(self, event: LinkEvent | Loss, outcomes: list[Outcome]) -> None:
        if isinstance(event, Loss):
            self._remarks.listen(outcomes)
            text = message(
                "recording-gap", events=event.events, bytes=event.bytes, why=event.reason
            )
            outcomes.append(finding("error", text))
            for stream in self._streams.values():
                stream.interrupted(event.time_ns, NOT_RECORDED)
        elif event.interrupts and event.link in self._streams:
            self._streams[event.link].interrupted(event.time_ns)
        elif event.link != "machine":
            self._remarks.lost(event.link, event.lost, outcomes)

    def _take_block(self, block: ModbusBlock, outcomes: list[Outcome]) -> None:
        signals = self._decoder.decode(block)
        self.signals = signals
        if self.walk is not None and not self.ended:
            waiting = bool(self._pending) or self._leaves(signals)
            outcomes.extend(
                self._alarm.look(self.walk, signals, block.recv_ns, waiting=waiting)
            )
        if self._pulse.take(signals, block):
            outcomes.append(self._still(block.recv_ns))
        if self._pulse.still:
            self.tracker.stale(self._pulse.beat_ns)
            return
        if signals.program_over:
            self._end_if_left(signals, outcomes)
            signals = replace(signals, stopped=False)
        closed = self.tracker.poll(
            signals, block.send_ns - self._late_ns, block.recv_ns - self._late_ns
        )
        if self._skip_open:
            self._skip_open = (
                self.tracker.open is not None
                and closed is None
                and signals.stop_count in (None, self._last_count)
            )
            if self._skip_open:
                return
            closed = None
        if closed is not None and closed.from_ns != self._taken_from_ns:
            self._pending.add(closed)

    def _leaves(self, signals: Signals) -> bool:
        """Return whether a poll ends a standstill that is not captured yet."""
        dwell = self.tracker.open
        return (
            dwell is not None and not signals.stopped and dwell.from_ns != self._taken_from_ns
        )

    def _still(self, now_ns: int) -> Finding:
        text = message("heartbeat-still", seconds_s=self._pulse.for_s(now_ns))
        if self.walk is not None and not self.walk.ended:
            return self.walk.finding("error", self.walk.expected, text)
        return finding("error", text)

    def _end_if_left(self, signals: Signals, outcomes: list[Outcome]) -> None:
        walk = self.walk
        if walk is None or self.ended or self._pending or self.tracker.open is not None:
            return
        if walk.expected > 0 and walk.last is not None:
            why = (
                message("program-left") if signals.running is False else message("setup-left")
            )
            self._end(
                "aborted",
                walk.at(
                    message(
                        "left-after",
                        why=why,
                        stop=walk.expected - 1,
                        last=len(walk.route) - 1,
                    )
                ),
                outcomes,
            )

    def _end(
        self, kind: Literal["complete", "aborted"], reason: Message, outcomes: list[Outcome]
    ) -> None:
        self._remarks.listen(outcomes)
        if self.may_be_over:
            self._name_from_second(outcomes)
        self.ended = Ended(kind, reason)
        outcomes.append(self.ended)

    def _name_from_second(self, outcomes: list[Outcome]) -> None:
        """Assign the stops of a finished pass whose first stop is missing."""
        self._cause.leave_out()
        if self.walk is not None:
            outcomes.extend(self._taker.name_from_second(self.walk))

    def _samples_follow(self, event: Event) -> bool:
        """Return whether the samples up to this poll are likely to arrive soon: the stream has sent
        bytes since the previous poll.
        """
        heard, polled = self._heard_since_poll, isinstance(event, ModbusBlock)
        self._heard_since_poll = isinstance(event, Chunk) or (heard and not polled)
        return heard and polled

    def _take_early(self, outcomes: list[Outcome]) -> None:
        """With the handshake the machine waits for the program: capture the stop as soon as a
        steady window of full length is complete.

        The capture does not wait for missing samples, except for the chunk after each poll
        (`_samples_follow`).
        """
        dwell, rules = self.tracker.open, self._survey.stop
        if dwell is None or dwell.from_ns == self._taken_from_ns:
            return
        placing = self._placing(dwell.signals)
        if not self._pending.are(dwell, self._mover(dwell.signals)):
            return
        known = replace(
            dwell, to_ns=min(dwell.to_ns, int(max(placing.newest_ns(), dwell.from_ns)))
        )
        unbroken = unbroken_parts(placing, known)[-1]
        certain_s = (unbroken.to_ns - unbroken.from_ns) * 1e-9 - rules.settle_s
        if certain_s < rules.min_window_s or (
            certain_s * 1e9 < LAG_NS and not self._at_expected(dwell.signals)
        ):
            return
        taken = [
            each for each in self._windows(known, placing) if each.from_ns >= unbroken.from_ns
        ]
        if taken and (not taken[-1].doubts or certain_s > PATIENCE * rules.min_window_s):
            self._taken_from_ns = dwell.from_ns
            self._pending.taken_early(known)
            self._take_dwell(known, outcomes)

    def _at_expected(self, signals: Signals) -> bool:
        """Return whether position and counter belong to the next stop, because the registers may
        lag behind the stop signal.
        """
        walk = self.walk
        if walk is None or walk.ended or signals.commanded_mm is None:
            return True
        return walk.route.find(
            signals.commanded_mm, walk.expected
        ) == walk.expected and walk.counts_on(signals)

    def _settle(self, now_ns: int, outcomes: list[Outcome]) -> None:
        while self._pending:
            dwell = self._pending.first()
            placing = self._placing(dwell.signals)
            if placing.newest_ns() < dwell.to_ns and now_ns - dwell.to_ns < LAG_NS:
                return
            if not self._pending.settled(
                now_ns, self.tracker.open, self._mover(dwell.signals)
            ):
                return
            self._take_dwell(self._pending.take(), outcomes)

    def _take_dwell(self, dwell: Dwell, outcomes: list[Outcome]) -> None:
        self._remarks.listen(outcomes)
        begun = self.walk is not None
        found: Walk | Finding | Ended | None = self.walk
        if found is None or dwell.signals.setup != self._setup:
            found = self._finder.follow(
                dwell.signals, None if begun else self._reading_mm(dwell)
            )
            self._setup = dwell.signals.setup if isinstance(found, Walk) else None
        if self._by_laser is None and not self._cause.over:
            self._judge_cause(dwell, outcomes)
            if self.ended:
                return
        if not begun and isinstance(found, Walk):
            outcomes.extend(unchecked(self._survey))
            outcomes.extend([found.begun_anew(0)] if found.apart else [])
        if isinstance(found, Finding):
            outcomes.append(found)
        elif isinstance(found, Ended) and not self.ended:
            self._went_on = True
            self._end(found.kind, found.reason, outcomes)
        if not isinstance(found, Walk) or self.ended:
            return
        felt = (
            with_air(self._survey, dwell.signals, self.air, dwell.to_ns, silent=math.nan)
            if self._sensed
            else dwell.signals
        )
        judged = self._conditions.judge(felt, (dwell.from_ns + self._wall_offset_ns) * 1e-9)
        taken: list[Outcome] = []
        placing = self._placing(dwell.signals)
        self._taker.take(
            found,
            replace(dwell, signals=judged.signals),
            placing,
            self._windows(dwell, placing),
            taken,
        )
        outcomes.extend(remarked(found, taken, judged, self._alarm))
        if found.ended and not self.ended:
            self._end(
                "complete",
                found.at(message("last-gone-by", stop=len(found.route) - 1)),
                outcomes,
            )

    def _judge_cause(self, dwell: Dwell, outcomes: list[Outcome]) -> None:
        """Pass the standstill on for judgement together with the earlier standstills."""
        if self.head is not None and self._finder.is_head_run(dwell.signals):
            outcomes.extend(self._cause.leave())
            return
        walk, taken = self.walk, self._windows(dwell, self.laser)
        until_ns = taken[0].to_ns if taken else dwell.to_ns
        moves = (
            moves_between(
                self.laser,
                self._dwell_before,
                dwell,
                min(MOMENT_NS * 1e-9, self._survey.stop.min_window_s),
            )
            if self._dwell_before is not None
            else ()
        )
        self._dwell_before = dwell
        stand = Stand(
            dwell.signals,
            taken[0].window.mean_mm if taken else None,
            self._losses(until_ns),
            moves,
        )
        if walk is not None and self._cause.misses_first(walk.route, stand):
            self.next_from_ns = (dwell.not_before_ns or dwell.from_ns) + self._late_ns
            self._went_on = True
            last = message("last-gone-by", stop=len(walk.route) - 1)
            self._end("complete", walk.at(last), outcomes)
            return
        outcomes.extend(
            self._cause.take(
                stand,
                walk.route.setup if walk is not None else None,
                walk.expected if walk is not None else 0,
            )
        )

    def _reading_mm(self, dwell: Dwell) -> float | None:
        """Return the laser's reading at the first dwell; None without a reading, or if the count
        was lost after the previous log.
        """
        taken = self._windows(dwell, self.laser)
        return (
            taken[0].window.mean_mm
            if taken and self._taker.reaches_back(taken, dwell)
            else None
        )

    def _windows(self, dwell: Dwell, placing: Placing) -> list[Taken]:
        """Return the windows of a dwell. The windows of the laser are stored until new samples
        arrive, because several steps of the capture need these windows.
        """
        if placing is not self.laser:
            return certain_windows(placing, dwell, self._survey.stop)
        asked = dwell.from_ns, dwell.to_ns, self.laser.samples, len(self.laser.breaks)
        if self._asked != asked:
            self._asked = asked
            self._answered = certain_windows(self.laser, dwell, self._survey.stop)
        return self._answered

    def _mover(self, signals: Signals) -> Placing | None:
        """Return the stream that shows whether the machine moves; None in a run of the 4-DOF head,
        which sees no travel."""
        return (
            None
            if self.head is not None and self._finder.is_head_run(signals)
            else self.laser
        )

    def _placing(self, signals: Signals) -> Placing:
        """Return the stream that determines the window of a stop: the laser's stream, or the head's
        stream in a run of the 4-DOF head.
        """
        if self.head is None or not self._finder.is_head_run(signals):
            return self.laser
        return (
            AngleView(self.head)
            if self._survey.head is not None and self._survey.head.angular
            else QdView(self.head)
        )
