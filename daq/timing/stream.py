"""A stream of an instrument: bytes in, samples of a time span out.

Chunks are decoded on request, or after a second: twenty chunks at once take little more time than
one chunk. A replay must give the same samples as the live run, so the time of decoding must not
change the samples. Three rules ensure this. The decoder takes several chunks at once only if all
contain plain samples. Every sample has the arrival time of its chunk. Only whole chunks of old
samples are discarded.
"""

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby, pairwise, takewhile
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.timing.sample_clock import SampleClock
from stepdiag.daq.timing.samples import Decoder, Flag, Notice, Samples, SteadyDecoder

MEMORY_NS = 90_000_000_000
MEMORY_SAMPLES = 1_000_000
"""Largest number of stored samples, enough to find a stop that Modbus missed. The limit bounds the
memory for fast instruments.
"""
HOLD_NS = 1_000_000_000
HOLD_BYTES = 65_536
"""Longest wait of bytes for decoding in ns, and largest number of waiting bytes."""
ARRIVAL_SLACK_NS = 500_000_000
"""Largest delay in ns between the time of a sample and its arrival."""
CONTINUITY = Flag.BEAM_LOST | Flag.HEAD_ERROR | Flag.SLEW
"""Flags of a sample at which an interferometer has lost its count: the readings before and after
the sample have different zeros.
"""
LOSS_AT_START = Flag.BEAM_LOST | Flag.SLEW
"""Flags that show a lost count even before the first good sample. Other flags before the first good
sample can mean that the decoder has not yet recognised its instrument.
"""
UNUSABLE = (
    CONTINUITY | Flag.DEVICE_ERROR | Flag.PHASE_ERROR | Flag.SATURATED | Flag.OUT_OF_RANGE
)


LEAST_STEP_MM = 1e-9
"""Least step in mm (1 pm) of an instrument; smaller steps between samples are rounding errors."""
UNWATCHED_NS = 500_000_000
UNWATCHED_PERIODS = 3.0
"""Limits of a gap between samples, in ns and in sample periods. A gap above both is a possible loss
of the count, because a beam that is cut and restored in the gap leaves no trace.
"""

LINE_LOST, NOT_RECORDED = message("line-lost-once"), message("recording-part-missing")
"""The two reasons for an unwatched laser, as messages."""


@dataclass(frozen=True, slots=True)
class Break:
    """A certain or possible loss of the laser's count: its reason, and its time (arrival of the
    next chunk).
    """

    time_ns: int
    reason: Words
    watched: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """Usable samples of a span of time in columns, shape (n,); ``channels`` (n, k) for a 4-DOF
    head. Unusable samples are only counted.
    """

    time_ns: NDArray[np.float64]
    position_mm: NDArray[np.float64]
    beam: NDArray[np.float64]
    channels: NDArray[np.float64] | None
    unusable: int


Timed = tuple[Samples, SampleClock]
"""A batch of samples, and the clock of the batch."""


class StreamBuffer:
    """Decodes a stream, and stores its clock, its newest samples and every loss of count."""

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._steady = decoder.feed_steady if isinstance(decoder, SteadyDecoder) else None
        self._polled = hasattr(decoder, "request")
        self._clock = self._new_clock(decoder.nominal_rate_hz)
        self._waiting: list[tuple[bytes, int]] = []
        self._waiting_bytes = 0
        self._batches: deque[Timed] = deque()
        self._notices: dict[Words, Notice] = {}
        self._conditions: dict[str, float] = {}
        self._conditions_ns: dict[str, int] = {}
        self._kept = 0
        self._broken = False
        self._ever_good = False
        self._breaks: list[Break] = []
        self._samples = 0
        self._least_step_mm = math.inf
        self._last_mm = math.nan
        self._garbage = 0
        self._last: Samples | None = None
        self._end: tuple[int, int] | None = None

    @property
    def breaks(self) -> list[Break]:
        self._settle()
        return self._breaks

    @property
    def samples(self) -> int:
        self._settle()
        return self._samples

    @property
    def resolution_um(self) -> float:
        """Return the smallest step in um between two samples until now; infinite before a first
        movement. After a movement this step is the resolution of the instrument.
        """
        self._settle()
        return self._least_step_mm * 1e3

    @property
    def garbage(self) -> int:
        """Return the number of lines or frames that could not be decoded."""
        self._settle()
        return self._garbage

    @property
    def conditions(self) -> Mapping[str, float]:
        """Return the last values of air and material from the sensors of the instrument, by signal
        name.
        """
        self._settle()
        return self._conditions

    def conditions_since(self, time_ns: int) -> Mapping[str, float]:
        """Return the values of air and material received after a given time."""
        self._settle()
        return {
            name: value
            for name, value in self._conditions.items()
            if self._conditions_ns[name] >= time_ns
        }

    @property
    def last(self) -> Samples | None:
        self._settle()
        return self._last

    def since(self, arrival_ns: int) -> list[Samples]:
        """Return the batches whose last sample arrived after a given time, in order of arrival."""
        self._settle()
        newer = takewhile(
            lambda batch: batch.arrival_ns[-1] > arrival_ns,
            (batch for batch, _ in reversed(self._batches)),
        )
        return list(newer)[::-1]

    def feed(self, chunk: bytes, arrival_ns: int) -> None:
        self._waiting.append((chunk, arrival_ns))
        self._waiting_bytes += len(chunk)
        if (
            self._steady is None
            or self._waiting_bytes >= HOLD_BYTES
            or arrival_ns - self._waiting[0][1] >= HOLD_NS
        ):
            self._settle()

    def heard(self) -> tuple[Notice, ...]:
        """Return the decoder's remarks since the last call, the first of each kind."""
        self._settle()
        notices, self._notices = tuple(self._notices.values()), {}
        return notices

    def interrupted(self, at_ns: int, reason: Words = LINE_LOST) -> None:
        """Discard the incomplete line before missing bytes, and record that the laser was
        unwatched.

        Even a short gap is unwatched: a beam that is cut and restored in the gap leaves no trace,
        even if the instrument counts its samples.
        """
        self._settle()
        self._decoder.resync()
        self._breaks.append(Break(at_ns, reason, watched=False))

    def forget_breaks(self) -> None:
        """Discard all losses of count except the last certain and the last possible loss. This
        limits the memory of an unrecorded stream that runs for weeks.
        """
        if len(self._breaks) > 2:
            self._breaks = list(last_of_each(self._breaks))

    def newest_ns(self) -> float:
        """Return the time of the newest sample in ns; minus infinity before the first sample."""
        self._settle()
        if not self._batches:
            return -np.inf
        batch, clock = self._batches[-1]
        newest = (
            batch.arrival_ns[-1] if self._polled else clock.times_ns(batch.counter[-1:])[0]
        )
        return float(newest)

    def span(self, from_ns: float, to_ns: float, arrived_before_ns: float = math.inf) -> Span:
        """Return the usable samples of a closed span of time that arrived before
        ``arrived_before_ns``.
        """
        chosen = self._around(from_ns, to_ns)
        if not chosen:
            empty = np.zeros(0)
            return Span(
                time_ns=empty, position_mm=empty, beam=empty, channels=None, unusable=0
            )
        times = self._times(chosen)
        arrivals = np.concatenate([batch.arrival_ns for batch, _ in chosen])
        inside = (
            (times >= from_ns)
            & (times <= to_ns)
            & (arrivals >= from_ns)
            & (arrivals <= to_ns + ARRIVAL_SLACK_NS)
        )
        inside &= arrivals < arrived_before_ns
        flags = np.concatenate([batch.flags for batch, _ in chosen])
        usable = inside & ((flags & int(UNUSABLE)) == 0)
        channels = [batch.channels for batch, _ in chosen if batch.channels is not None]
        return Span(
            time_ns=times[usable],
            position_mm=np.concatenate([batch.position_mm for batch, _ in chosen])[usable],
            beam=np.concatenate([batch.beam for batch, _ in chosen])[usable],
            channels=np.concatenate(channels)[usable] if channels else None,
            unusable=int(np.count_nonzero(inside & ~usable)),
        )

    def count_at(self, time_ns: float) -> int | None:
        """Return the instrument's number of the sample nearest to a time; None without such a
        number, or without a sample near the time.
        """
        near = self._around(time_ns - UNWATCHED_NS, time_ns + UNWATCHED_NS)
        if not self._decoder.gaps_visible or not near:
            return None
        nearest = int(np.argmin(np.abs(self._times(near) - time_ns)))
        return int(np.concatenate([batch.counter for batch, _ in near])[nearest])

    def drained(self) -> list[tuple[NDArray[np.float64], Samples]]:
        """Return all stored samples with their times in ns, and discard the samples."""
        self._settle()
        batches, self._batches, self._kept = self._batches, deque(), 0
        return [(self._times([each]), each[0]) for each in batches]

    def flags(self, from_ns: float, to_ns: float) -> NDArray[np.uint16]:
        """Return the flags of all samples in a closed span of time, shape (n,)."""
        near = self._around(from_ns, to_ns)
        if not near:
            return np.zeros(0, dtype=np.uint16)
        times = self._times(near)
        arrivals = np.concatenate([batch.arrival_ns for batch, _ in near])
        inside = (times >= from_ns) & (times <= to_ns)
        inside &= (arrivals >= from_ns) & (arrivals <= to_ns + ARRIVAL_SLACK_NS)
        return np.concatenate([batch.flags for batch, _ in near])[inside]

    def _around(self, from_ns: float, to_ns: float) -> list[Timed]:
        """Return the batches that may contain samples of a span of time. The search begins at the
        newest batch, because most requests concern new samples.
        """
        self._settle()
        chosen = []
        for batch, clock in reversed(self._batches):
            if batch.arrival_ns[-1] < from_ns:
                break
            if batch.arrival_ns[0] <= to_ns + ARRIVAL_SLACK_NS:
                chosen.append((batch, clock))
        return chosen[::-1]

    def _settle(self) -> None:
        if not self._waiting:
            return
        chunks, self._waiting, self._waiting_bytes = self._waiting, [], 0
        together = len(chunks) > 1 and all(
            later - earlier < UNWATCHED_NS for (_, earlier), (_, later) in pairwise(chunks)
        )
        steady = self._steady(chunks) if self._steady is not None and together else None
        if steady is not None:
            self._take(steady, chunks[-1][1])
            return
        for chunk, arrival_ns in chunks:
            self._take(self._decoder.feed(chunk, arrival_ns), arrival_ns)

    def _take(self, batch: Samples, arrival_ns: int) -> None:
        for notice in batch.notices:
            self._notices.setdefault(
                notice.why if notice.code == "device" else notice.code, notice
            )
            self._heed(notice, arrival_ns)
        if len(batch):
            self._remember(batch, arrival_ns)

    def _times(self, batches: list[Timed]) -> NDArray[np.float64]:
        """Return the times in ns of all samples of the batches (at least one). Batches of the same
        clock are computed together, because a standstill has one batch per chunk.
        """
        if self._polled:
            return np.concatenate([batch.arrival_ns for batch, _ in batches]).astype(
                np.float64
            )
        return np.concatenate(
            [
                clock.times_ns(np.concatenate([batch.counter for batch, _ in of_clock]))
                for clock, of_clock in groupby(batches, key=itemgetter(1))
            ]
        )

    def _heed(self, notice: Notice, arrival_ns: int) -> None:
        if notice.code == "rate" and notice.value != self._rate_hz:
            self._clock = self._new_clock(notice.value)
        elif notice.code == "restart":
            self._breaks.append(
                Break(arrival_ns, message("instrument-restarted", why=notice.why))
            )
            self._clock = self._new_clock(self._decoder.nominal_rate_hz)
        elif notice.code == "garbage":
            self._garbage += 1
        elif notice.code == "environment" and notice.value is not None:
            self._conditions[notice.name] = notice.value
            self._conditions_ns[notice.name] = arrival_ns

    def _new_clock(self, rate_hz: float | None) -> SampleClock:
        """Return the clock of a new segment; earlier batches keep the clock of their segment."""
        self._rate_hz = rate_hz
        return SampleClock(
            rate_hz, self._decoder.latency_s, gaps_visible=self._decoder.gaps_visible
        )

    def _remember(self, batch: Samples, arrival_ns: int) -> None:
        self._watch_for_holes(batch)
        for end in (
            *np.flatnonzero(batch.arrival_ns[1:] != batch.arrival_ns[:-1]).tolist(),
            -1,
        ):
            self._clock.add(int(batch.counter[end]), int(batch.arrival_ns[end]))
        self._batches.append((batch, self._clock))
        self._last = batch
        self._samples += len(batch)
        self._learn_resolution(batch)
        self._kept += len(batch)
        self._forget(arrival_ns - MEMORY_NS)
        self._watch_continuity(batch, arrival_ns)

    def _learn_resolution(self, batch: Samples) -> None:
        before = np.empty_like(batch.position_mm)
        before[0], before[1:] = self._last_mm, batch.position_mm[:-1]
        steps = np.abs(batch.position_mm - before)
        self._last_mm = float(batch.position_mm[-1])
        self._least_step_mm = float(
            np.min(steps, where=steps > LEAST_STEP_MM, initial=self._least_step_mm)
        )

    def _forget(self, before_ns: int) -> None:
        while True:
            batch, clock = self._batches[0]
            excess = self._kept - MEMORY_SAMPLES
            if excess > 0:
                before_ns = max(
                    before_ns, int(batch.arrival_ns[min(excess, len(batch)) - 1]) + 1
                )
            if batch.arrival_ns[0] >= before_ns:
                return
            self._batches.popleft()
            gone = int(np.searchsorted(batch.arrival_ns, before_ns))
            self._kept -= gone
            if gone < len(batch):
                self._batches.appendleft((batch.after(gone), clock))

    def _watch_for_holes(self, batch: Samples) -> None:
        """Record a time without samples: a gap of the counter if the instrument counts unsent
        samples, otherwise a gap of the arrivals.

        A gap of the arrivals contains an unknown number of samples, so a new clock begins after the
        gap.
        """
        before, self._end = self._end, (int(batch.counter[-1]), int(batch.arrival_ns[-1]))
        counted = self._decoder.gaps_visible
        if before is None or (counted and self._end[0] - before[0] == len(batch)):
            return
        period_ns = 1e9 / self._rate_hz if self._rate_hz else 0.0
        if counted and period_ns:
            missed_ns = (np.diff(batch.counter, prepend=before[0]) - 1) * period_ns
        else:
            apart_ns = np.diff(batch.arrival_ns, prepend=before[1]).astype(np.float64)
            first = np.flatnonzero(apart_ns)
            missed_ns = np.zeros(len(batch))
            missed_ns[first] = apart_ns[first] - period_ns * np.diff(
                np.append(first, len(batch))
            )
        holes = np.flatnonzero(missed_ns > max(UNWATCHED_NS, UNWATCHED_PERIODS * period_ns))
        for at in holes.tolist():
            unseen = message("no-sample-for", seconds_s=missed_ns[at] * 1e-9)
            self._breaks.append(Break(int(batch.arrival_ns[at]), unseen, watched=False))
        if len(holes) and not counted:
            self._clock = self._new_clock(self._rate_hz)

    def _watch_continuity(self, batch: Samples, arrival_ns: int) -> None:
        bad = (batch.flags & int(CONTINUITY if self._ever_good else LOSS_AT_START)) != 0
        self._ever_good = self._ever_good or not bad.all()
        if not bad.any():
            self._broken = False
            return
        before = np.concatenate(([self._broken], bad[:-1]))
        for index in np.flatnonzero(bad & ~before):
            self._breaks.append(Break(arrival_ns, _describe(int(batch.flags[index]))))
        self._broken = bool(bad[-1])


LOSSES: Mapping[Flag, Message] = {
    Flag.BEAM_LOST: message("beam-was-lost"),
    Flag.HEAD_ERROR: message("laser-head-error"),
    Flag.SLEW: message("moved-too-fast"),
}


def last_of_each(breaks: Iterable[Break]) -> tuple[Break, ...]:
    """Return the last certain and the last possible loss of count; earlier losses have no further
    effect.
    """
    return tuple({event.watched: event for event in breaks}.values())


def _describe(flags: int) -> Message:
    causes = [cause for flag, cause in LOSSES.items() if flags & flag]
    return causes[0] if len(causes) == 1 else message("losses", causes=causes)
