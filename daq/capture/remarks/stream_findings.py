"""What the streams of a log remark of themselves, in words for a person."""

import re
from collections.abc import Sequence

from stepdiag.base.findings import Severity, finding
from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.capture.outcome import Outcome
from stepdiag.daq.records.events import Link, Stream
from stepdiag.daq.timing.samples import Notice
from stepdiag.daq.timing.stream import StreamBuffer

_FIGURES = re.compile(r"\d+")
LISTEN_NS = 1_000_000_000
"""How often the remarks of the streams are asked for."""
STREAMS: dict[Link, Message] = {
    "laser": message("stream-laser"),
    "head": message("stream-head"),
    "air": message("stream-air"),
    "machine": message("stream-machine"),
}
KINDS: dict[str, Severity] = {"garbage": "warning", "gap": "warning", "restart": "warning", "device": "info"}


CODES = {"garbage": "bytes-garbled", "gap": "samples-missing", "restart": "instrument-restart", "device": "instrument-reports"}
"""The code of each kind of notice, whatever the instrument."""


class StreamRemarks:
    """Says each kind of trouble with a stream once a log: a wrong baud rate would say it a thousand times a second."""

    def __init__(self, streams: dict[Stream, StreamBuffer]) -> None:
        self._streams = streams
        self._reported: set[str] = set()
        self._listened_ns = 0

    def listen_now_and_then(self, now_ns: int, outcomes: list[Outcome]) -> None:
        """Say what is new where the last time is a second ago."""
        if now_ns - self._listened_ns >= LISTEN_NS:
            self._listened_ns = now_ns
            self.listen(outcomes)

    def listen(self, outcomes: list[Outcome]) -> None:
        """Say what is new; before anything else is reported, so that the order is that of the events."""
        for stream, buffer in self._streams.items():
            for notice in buffer.heard():
                self._say(stream, notice, outcomes)

    def lost(self, link: Link, causes: Sequence[Words], outcomes: list[Outcome]) -> None:
        """Report where bytes were lost on the way, each cause once a log: how often it came is the link's own matter."""
        for cause in causes:
            kind = f"{link} lost: {cause.key if isinstance(cause, Message) else _FIGURES.sub('', cause)}"
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
