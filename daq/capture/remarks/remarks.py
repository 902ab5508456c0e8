"""Findings about machine and streams: heartbeat, alarms, rejected conditions, faults of a stream.

An alarm or a condition is assigned to its stop.
"""

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime

import msgspec

from stepdiag.base.findings import Finding, Severity, finding
from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.capture.captured_stop import CapturedStop, marked
from stepdiag.daq.capture.conditions import COURSES, Credible, Judged
from stepdiag.daq.capture.naming.walk import Walk
from stepdiag.daq.capture.outcome import Outcome
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.records.events import Link, ModbusBlock, Stream
from stepdiag.daq.timing.samples import Notice
from stepdiag.daq.timing.stream import StreamBuffer

STILL_NS = 1_500_000_000
"""Time in ns without a change after which the heartbeat stands still: the heartbeat changes at
least once a second (contract 2), and half a second allows for polls and a slow gateway.
"""


class Pulse:
    """Follows the heartbeat of the machine. ``still``: the heartbeat has not changed for too long;
    never set for a machine without a heartbeat.
    """

    def __init__(self) -> None:
        self.still = False
        self.beat_ns = 0
        """The request time of the last poll with a changed heartbeat. The values of later polls may
        be as old as this time.
        """
        self._value: int | None = None
        self._heard_ns = 0

    def take(self, signals: Signals, block: ModbusBlock) -> bool:
        """Process a poll; return whether this poll is the first with a heartbeat that stands
        still.
        """
        if signals.heartbeat is None or signals.heartbeat != self._value:
            self._value, self.beat_ns, self._heard_ns = (
                signals.heartbeat,
                block.send_ns,
                block.recv_ns,
            )
            self.still = False
            return False
        before, self.still = self.still, block.recv_ns - self._heard_ns > STILL_NS
        return self.still and not before

    def for_s(self, now_ns: int) -> float:
        """Return the time in s for which the heartbeat has stood still."""
        return (now_ns - self._heard_ns) * 1e-9


class Alarm:
    """Follows the machine's alarm within a pass: each alarm is reported with its time, and the next
    stop is doubted.
    """

    def __init__(self, wall_offset_ns: int) -> None:
        self._wall_offset_ns = wall_offset_ns
        self._on = False
        self._doubts: list[tuple[int, Message]] = []

    def look(
        self, walk: Walk, signals: Signals, now_ns: int, *, waiting: bool
    ) -> Iterator[Finding]:
        """Process a poll; yield the finding of a new alarm. ``waiting`` is true if a standstill is
        over and not captured yet.
        """
        before, self._on = self._on, bool(signals.alarm)
        if self._on and not before:
            moment = datetime.fromtimestamp((now_ns + self._wall_offset_ns) * 1e-9, UTC)
            words = message("machine-alarm", time=f"{moment:%H:%M:%S}")
            self._doubts.append((now_ns, words))
            last = len(walk.route) - 1
            yield walk.finding("warning", min(walk.expected + waiting, last), words)

    def doubts(self, stop: CapturedStop) -> list[Message]:
        """Return the doubts of a stop from the alarms before the end of its window, each alarm
        once.
        """
        doubts = [remark for time_ns, remark in self._doubts if time_ns <= stop.window_to_ns]
        self._doubts = [each for each in self._doubts if each[0] > stop.window_to_ns]
        return doubts


def remarked(
    walk: Walk, taken: Sequence[Outcome], judged: Judged, alarm: Alarm
) -> Iterator[Outcome]:
    """Yield the outcomes of a dwell, with the remarks on conditions and machine added to the
    stops.
    """
    stops = [each for each in taken if isinstance(each, CapturedStop)]
    doubted = judged.doubted if judged.doubted and not walk.route.travel.is_fourdof else []
    for words in (*judged.remarks, *doubted):
        yield walk.finding("warning", stops[0].stop if stops else walk.expected, words)
    for each in taken:
        yield (
            _marked(each, judged.held, [*doubted, *alarm.doubts(each)])
            if isinstance(each, CapturedStop)
            else each
        )


def _marked(
    stop: CapturedStop, held: tuple[str, ...], doubted: Sequence[Message]
) -> CapturedStop:
    stop = msgspec.structs.replace(stop, held=held)
    for words in doubted:
        stop = marked(stop, words)
    return stop


def credible_of(stop: CapturedStop) -> dict[str, Credible]:
    """Return the accepted values of air and material at a stop."""
    values = {name: getattr(stop, name) for name in COURSES if name not in stop.held}
    return {
        name: Credible(value=value, time_s=stop.time_s)
        for name, value in values.items()
        if value is not None
    }


_FIGURES = re.compile(r"\d+")
LISTEN_NS = 1_000_000_000
"""Least time in ns between two reports of the streams' remarks."""
STREAMS: dict[Link, Message] = {
    "laser": message("stream-laser"),
    "head": message("stream-head"),
    "air": message("stream-air"),
    "machine": message("stream-machine"),
}
KINDS: dict[str, Severity] = {
    "garbage": "warning",
    "gap": "warning",
    "restart": "warning",
    "device": "info",
}


CODES = {
    "garbage": "bytes-garbled",
    "gap": "samples-missing",
    "restart": "instrument-restart",
    "device": "instrument-reports",
}
"""The finding's code of each kind of notice, whatever the instrument."""


class StreamRemarks:
    """Reports each kind of trouble with a stream once per log: a wrong baud rate causes the same
    trouble a thousand times a second.
    """

    def __init__(self, streams: dict[Stream, StreamBuffer]) -> None:
        self._streams = streams
        self._reported: set[str] = set()
        self._listened_ns = 0

    def listen_now_and_then(self, now_ns: int, outcomes: list[Outcome]) -> None:
        """Report new remarks of the streams at most once a second."""
        if now_ns - self._listened_ns >= LISTEN_NS:
            self._listened_ns = now_ns
            self.listen(outcomes)

    def listen(self, outcomes: list[Outcome]) -> None:
        """Report new remarks of the streams. The capture calls this method before it reports its
        own findings, so that all findings have the order of the events.
        """
        for stream, buffer in self._streams.items():
            for notice in buffer.heard():
                self._say(stream, notice, outcomes)

    def lost(self, link: Link, causes: Sequence[Words], outcomes: list[Outcome]) -> None:
        """Report the causes of bytes lost on a link, each cause once per log; the link itself
        reports the number of bytes.
        """
        for cause in causes:
            kind = (
                f"{link} lost: "
                f"{cause.key if isinstance(cause, Message) else _FIGURES.sub('', cause)}"
            )
            if kind not in self._reported:
                self._reported.add(kind)
                lost = message("samples-missing.bytes", stream=STREAMS[link], cause=cause)
                outcomes.append(finding("warning", lost))

    def _say(self, stream: Stream, notice: Notice, outcomes: list[Outcome]) -> None:
        kind = f"{stream}: {notice.why if notice.code == 'device' else notice.code}"
        if notice.code in KINDS and kind not in self._reported:
            self._reported.add(kind)
            what = message("of-stream", stream=STREAMS[stream], what=notice.why)
            outcomes.append(finding(KINDS[notice.code], what, code=CODES[notice.code]))
