"""Listening to the lines between two logs: an instrument that sends and is not understood is named before anybody drives a pass."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from stepdiag.daq.formats.recognise import KEPT, refused, senseless
from stepdiag.daq.records.events import Chunk, LinkEvent, Stream
from stepdiag.daq.survey.formats import decoders
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.samples import Decoder, Flag
from stepdiag.solver.findings import Finding

PATIENCE_NS = 3_000_000_000
"""What an instrument sends may make no sense for so long: its line was opened in the middle of a word, or it has just got power."""


@dataclass(slots=True)
class _Ear:
    """What was heard on one line since it was opened, until it made sense."""

    decoder: Decoder
    heard: bytes = b""
    count: int = 0
    samples: int = 0
    remarks: dict[str, str] = field(default_factory=dict)
    since_ns: int = 0
    understood: bool = False
    said: bool = False

    def take(self, chunk: Chunk) -> None:
        self.since_ns = self.since_ns or chunk.arrival_ns
        self.heard += chunk.data[: KEPT - len(self.heard)]
        self.count += len(chunk.data)
        batch = self.decoder.feed(chunk.data, chunk.arrival_ns)
        self.remarks.update({notice.code: notice.text for notice in batch.notices})
        self.samples += len(batch)
        self.understood |= bool(np.any(batch.flags & int(Flag.DEVICE_ERROR) == 0))


class Listening:
    """Hears every stream of a survey. A line that was understood once is not listened to again before it was lost."""

    def __init__(self, survey: Survey) -> None:
        self._survey = survey
        self._ears = _ears(survey)

    def take_link(self, event: LinkEvent) -> None:
        """Take a change of a link: a line that comes back may lead to another instrument."""
        if event.link == "machine" or event.state != "lost":
            return
        self._ears[event.link].decoder.resync()
        if self._ears[event.link].understood:
            self._ears[event.link] = _ears(self._survey)[event.link]

    def take(self, chunk: Chunk) -> Iterator[Finding]:
        """Take what came; yield, once, that nothing of it can be used."""
        ear = self._ears.get(chunk.stream)
        if ear is None or ear.understood:
            return
        ear.take(chunk)
        if not (ear.understood or ear.said) and chunk.arrival_ns - ear.since_ns >= PATIENCE_NS:
            ear.said = True
            yield _unusable(chunk.stream, ear)


def _ears(survey: Survey) -> dict[Stream, _Ear]:
    return {stream: _Ear(decoder) for stream, decoder in decoders(survey).items()}


def _unusable(stream: Stream, ear: _Ear) -> Finding:
    if ear.samples and "garbage" not in ear.remarks:
        return Finding(code=f"{stream}-device", severity="warning", text=refused(stream, ear.remarks.get("device", "")))
    remark = ear.remarks.get("garbage") or ear.remarks.get("device") or ""
    return Finding(code=f"{stream}-garbage", severity="warning", text=senseless(stream, ear.heard, ear.count, remark))
