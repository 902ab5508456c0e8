"""Observation of a survey's links, which are the connections to laser, machine, head and air
sensor: counts, decoded samples, and the last value of each signal."""

import asyncio
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import Message, Words
from stepdiag.daq.capture.conditions import condition_names
from stepdiag.daq.formats.recognise import KEPT
from stepdiag.daq.formats.signals import SIGNAL_NAMES, SignalDecoder, Signals
from stepdiag.daq.recording.survey_links import Statuses, SurveyLinks
from stepdiag.daq.records.events import Chunk, Event, Link, LinkEvent, ModbusBlock
from stepdiag.daq.survey.formats import decoders
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.samples import Decoder, Flag, Samples

LOOK_S = 0.25
"""Time in s between two examinations of the links."""
NS = 1e-9


@dataclass(slots=True)
class LinkSeen:
    """The state of a link. ``detail`` is the last text about the link; ``losses`` counts the losses
    of an open connection."""

    name: Link
    address: Words = ""
    state: str = "connecting"
    detail: Words = ""
    was_silent: bool = False
    losses: int = 0

    def take(self, event: LinkEvent) -> None:
        self.losses += self.state == "connected" and event.state == "lost"
        self.was_silent |= event.state == "silent"
        self.state, self.detail = event.state, event.words or self.detail


@dataclass(slots=True)
class StreamSeen:
    """Data of an instrument on a serial line. ``remarks`` contains the last text of each notice
    code, ``counts`` the number of notices of each code, ``heard`` the first received bytes,
    ``conditions`` the last values of air and material."""

    link: LinkSeen
    decoder: Decoder
    byte_count: int = 0
    samples: int = 0
    usable: int = 0
    refused: int = 0
    position_mm: float | None = None
    beam: float | None = None
    last_flags: Flag = field(default_factory=lambda: Flag(0))
    remarks: dict[str, Words] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    heard: bytes = b""
    conditions: dict[str, float] = field(default_factory=dict)
    _first_ns: int = 0
    _last_ns: int = 0
    _before_first: int = 0

    def take(self, chunk: Chunk) -> None:
        self.heard += chunk.data[: KEPT - len(self.heard)]
        self.byte_count += len(chunk.data)
        batch = self.decoder.feed(chunk.data, chunk.arrival_ns)
        for notice in batch.notices:
            self.remarks[notice.code] = notice.why
            self.counts[notice.code] += 1
            if notice.code == "environment" and notice.value is not None:
                self.conditions[notice.name] = notice.value
        if len(batch):
            self._count(batch, chunk.arrival_ns)

    def _count(self, batch: Samples, arrival_ns: int) -> None:
        self.samples += len(batch)
        if not self._first_ns:
            self._first_ns, self._before_first = arrival_ns, self.samples
        self._last_ns = arrival_ns
        self.usable += int(np.count_nonzero(np.isfinite(batch.position_mm)))
        self.refused += int(np.count_nonzero(batch.flags & int(Flag.DEVICE_ERROR)))
        self.last_flags = Flag(int(batch.flags[-1]))
        self.position_mm, self.beam = _known(batch.position_mm[-1]), _known(batch.beam[-1])

    @property
    def rate_hz(self) -> float | None:
        """Return the number of samples per second, or None with too few samples."""
        span_s = (self._last_ns - self._first_ns) * NS
        return (self.samples - self._before_first) / span_s if span_s > 1.0 else None


@dataclass(slots=True)
class MachineSeen:
    """Answers of the machine. ``changes`` counts the changes of each signal; ``unanswered``
    contains the signals that are missing in the last answer."""

    link: LinkSeen
    decoder: SignalDecoder
    polls: int = 0
    signals: Signals = field(default_factory=Signals)
    changes: Counter[str] = field(default_factory=Counter)
    slowest_s: float = 0.0
    trouble: Message | None = None
    unanswered: tuple[str, ...] = ()
    heard_s: float = 0.0
    _first_ns: int = 0

    def take(self, block: ModbusBlock) -> None:
        self._first_ns = self._first_ns or block.send_ns
        self.heard_s = (block.recv_ns - self._first_ns) * NS
        self.slowest_s = max(self.slowest_s, (block.recv_ns - block.send_ns) * NS)
        try:
            now = self.decoder.decode(block)
        except DataError as error:
            self.trouble = error.message
            return
        if self.polls and now is not self.signals:
            self.changes.update(
                name
                for name in SIGNAL_NAMES
                if getattr(now, name) != getattr(self.signals, name)
            )
        self.signals = now
        self.unanswered = self.decoder.unanswered(block)
        self.polls += 1

    @property
    def rate_hz(self) -> float | None:
        """Return the number of answered polls per second, or None with too few polls."""
        return self.polls / self.heard_s if self.heard_s > 1.0 else None


class Observation:
    """The present data of laser, machine and, if the survey file contains them, of the 4-DOF head
    and the air sensor."""

    def __init__(self, survey: Survey) -> None:
        self.survey = survey
        self.streams = tuple(
            StreamSeen(LinkSeen(name), decoder) for name, decoder in decoders(survey).items()
        )
        self.laser = self.streams[0]
        self.sensor = next(
            (stream for stream in self.streams if stream.link.name == "air"), self.laser
        )
        self.machine = MachineSeen(
            LinkSeen("machine"), SignalDecoder(survey.plc.signals, survey.plc.parsed())
        )
        self.seconds = 0.0

    @property
    def air(self) -> frozenset[str]:
        """Return the signals of air and material that the survey uses and that the laser or an air
        sensor measures."""
        return frozenset(condition_names(self.survey, self.sensor))

    @property
    def links(self) -> tuple[LinkSeen, ...]:
        return (*(stream.link for stream in self.streams), self.machine.link)

    def take(self, event: Event) -> None:
        if isinstance(event, Chunk):
            next(stream for stream in self.streams if stream.link.name == event.stream).take(
                event
            )
        elif isinstance(event, ModbusBlock):
            self.machine.take(event)
        elif isinstance(event, LinkEvent):
            next(link for link in self.links if link.name == event.link).take(event)
            for stream in self.streams:
                if stream.link.name == event.link and event.interrupts:
                    stream.decoder.resync()

    def named(self, statuses: Statuses) -> None:
        addresses = dict(zip(("laser", "machine", "head", "air"), statuses, strict=True))
        for link in self.links:
            status = addresses[link.name]
            link.address = status.address if status is not None else ""


async def watch(observation: Observation, seconds: float, show: Callable[[], None]) -> None:
    """Open the links of the survey for some seconds and collect their data. ``show`` is called a
    few times per second.

    The function never writes to the machine, and raises no error for a fault of a link.
    """
    survey_links = SurveyLinks(observation.survey, observation.take)
    observation.named(survey_links.statuses())
    loop = asyncio.get_running_loop()
    began = loop.time()
    keeping = asyncio.create_task(survey_links.run(), name="links")
    try:
        while observation.seconds < seconds:
            await asyncio.wait({keeping}, timeout=LOOK_S)
            if keeping.done():
                keeping.result()
            observation.seconds = loop.time() - began
            show()
    finally:
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
