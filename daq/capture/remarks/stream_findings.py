"""What the streams of a log remark of themselves, in words for a person."""

import re

from stepdiag.base.findings import Finding, Severity
from stepdiag.daq.capture.outcome import Outcome
from stepdiag.daq.records.events import Link, Stream
from stepdiag.daq.timing.samples import Notice
from stepdiag.daq.timing.stream import StreamBuffer

_FIGURES = re.compile(r"\d+")
LISTEN_NS = 1_000_000_000
"""How often the remarks of the streams are asked for."""
KINDS: dict[str, Severity] = {"garbage": "warning", "gap": "warning", "restart": "warning", "device": "info"}


CODES = {"garbage": "bytes-garbled", "gap": "samples-missing", "restart": "instrument-restart", "device": "instrument-reports"}
"""The code of each kind of notice, whatever the instrument."""


class StreamRemarks:
    """Says each kind of trouble with a stream once a log: a wrong baud rate would say it a thousand times a second."""

    def __init__(self, streams: dict[Stream, StreamBuffer]) -> None:
        self._streams = streams
        self._said: set[str] = set()
        self._listened_ns = 0

    def listen_now_and_then(self, now_ns: int, outcomes: list[Outcome]) -> None:
        """Say what is new where the last time is a second ago."""
        if now_ns - self._listened_ns >= LISTEN_NS:
            self._listened_ns = now_ns
            self.listen(outcomes)

    def listen(self, outcomes: list[Outcome]) -> None:
        """Say what is new; before anything else is said, so that the order is that of the events."""
        for stream, buffer in self._streams.items():
            for notice in buffer.heard():
                self._say(stream, notice, outcomes)

    def lost(self, link: Link, where: str, outcomes: list[Outcome]) -> None:
        """Say where bytes were lost on the way; how often in figures is the link's own matter, each cause is said once a log."""
        for cause in where.split("; "):
            kind = f"{link} lost: {_FIGURES.sub('', cause)}"
            if kind not in self._said:
                self._said.add(kind)
                outcomes.append(Finding(code="bytes-lost", severity="warning", text=f"{link}: bytes were lost: {cause}"))

    def _say(self, stream: Stream, notice: Notice, outcomes: list[Outcome]) -> None:
        said = f"{stream}: {notice.text if notice.code == 'device' else notice.code}"
        if notice.code in KINDS and said not in self._said:
            self._said.add(said)
            outcomes.append(Finding(code=CODES[notice.code], severity=KINDS[notice.code], text=f"{stream}: {notice.text}"))
