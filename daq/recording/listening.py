"""Examines the lines of the instruments between two logs: an instrument that sends unreadable bytes
is reported before a pass is driven.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Words
from stepdiag.daq.capture.remarks.remarks import STREAMS
from stepdiag.daq.formats.recognise import KEPT, refused, senseless
from stepdiag.daq.records.events import Chunk, LinkEvent, Stream
from stepdiag.daq.survey.formats import decoders
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.samples import Decoder, Flag

PATIENCE_NS = 3_000_000_000
"""Longest time in ns in which the bytes of an instrument may be unreadable, because the line was
opened in the middle of a word, or the power was just switched on.
"""
SILENCE_NS = 500_000_000
"""Longest time in ns of a silence that counts towards `PATIENCE_NS`; a longer silence counts with
this time. Noise at the opening of a line is no evidence about an instrument that gets power an hour
later.
"""
SECOND_NS = 1_000_000_000


@dataclass(slots=True)
class _Ear:
    """The bytes of a line from its opening until the bytes give readings.

    ``before`` means that a finding has already reported an instrument on this line.
    """

    decoder: Decoder
    heard: bytes = b""
    count: int = 0
    samples: int = 0
    remarks: dict[str, Words] = field(default_factory=dict)
    spent_ns: int = 0
    last_ns: int = 0
    understood: bool = False
    before: bool = False
    reported: bool = False
    looked_ns: int = 0
    looked_at: int = 0

    def take(self, chunk: Chunk) -> None:
        self.spent_ns += (
            min(chunk.arrival_ns - self.last_ns, SILENCE_NS) if self.last_ns else 0
        )
        self.last_ns = chunk.arrival_ns
        self.heard += chunk.data[: KEPT - len(self.heard)]
        self.count += len(chunk.data)
        if data := self._looked_at(chunk) if self.reported else chunk.data:
            self._decode(data, chunk.arrival_ns)

    def after_loss(self, decoder: Decoder) -> "_Ear":
        """Return the state after a loss of the line. The waiting time continues over the loss, so
        that a line with an interruption every second is reported. After a finding the waiting time
        starts again, so that the line is not reported again and again.
        """
        before = (self.before or self.reported) and not self.understood
        return _Ear(
            decoder, before=before, spent_ns=0 if before or self.understood else self.spent_ns
        )

    def _looked_at(self, chunk: Chunk) -> bytes:
        if chunk.arrival_ns - self.looked_ns >= SECOND_NS:
            if self.looked_at >= KEPT:
                self.decoder.resync()
            self.looked_ns, self.looked_at = chunk.arrival_ns, 0
        data = chunk.data[: KEPT - self.looked_at]
        self.looked_at += len(data)
        return data

    def _decode(self, data: bytes, arrival_ns: int) -> None:
        batch = self.decoder.feed(data, arrival_ns)
        self.remarks.update({notice.code: notice.why for notice in batch.notices})
        self.samples += len(batch)
        self.understood |= bool(np.any(batch.flags & int(Flag.DEVICE_ERROR) == 0))


class Listening:
    """Reads every stream of a survey. A line that has given readings is examined again only after a
    loss.
    """

    def __init__(self, survey: Survey) -> None:
        self._survey = survey
        self._ears = _ears(survey)

    def take_link(self, event: LinkEvent) -> None:
        """Process a change of a link: after a loss, another instrument may be on the line."""
        if event.link != "machine" and event.interrupts:
            self._ears[event.link] = self._ears[event.link].after_loss(
                decoders(self._survey)[event.link]
            )

    def take(self, chunk: Chunk) -> Iterator[Finding]:
        """Process a chunk; yield, once per line, the finding that no byte is usable."""
        ear = self._ears.get(chunk.stream)
        if ear is None or ear.understood:
            return
        ear.take(chunk)
        if not (ear.understood or ear.reported) and ear.spent_ns >= PATIENCE_NS:
            ear.reported = True
            yield _unusable(chunk.stream, ear)


def _ears(survey: Survey) -> dict[Stream, _Ear]:
    return {stream: _Ear(decoder) for stream, decoder in decoders(survey).items()}


def _unusable(stream: Stream, ear: _Ear) -> Finding:
    if ear.samples and "garbage" not in ear.remarks:
        return finding(
            "warning",
            refused(STREAMS[stream], ear.remarks.get("device", "")),
            code="instrument-reports",
        )
    remark = ear.remarks.get("garbage") or ear.remarks.get("device") or ""
    return finding(
        "warning",
        senseless(STREAMS[stream], ear.heard, ear.count, remark),
        code="bytes-garbled",
    )
