"""Samples in columns, and remarks about the stream: the output of every wire format.

Because of the columns, one processor core can process a hundred thousand samples a second.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Words

NoticeCode = Literal[
    "banner",
    "debug",
    "garbage",
    "gap",
    "rate",
    "restart",
    "device",
    "environment",
    "duplicate",
]


class Flag(IntFlag):
    """Flags for the faults of a sample; a good sample has the value 0."""

    BEAM_LOST = 1
    HEAD_ERROR = 2
    SLEW = 4
    PHASE_ERROR = 8
    WEAK_BEAM = 16
    SATURATED = 32
    OUT_OF_RANGE = 64
    DEVICE_ERROR = 128


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """A remark of the stream before sample ``index`` of its batch.

    ``value`` depends on the code: the number of missing samples for ``gap``, the rate in Hz for
    ``rate``. ``name`` is the quantity of an ``environment`` notice. ``why`` is a message, or a text
    from the instrument.
    """

    code: NoticeCode
    index: int
    why: Words = ""
    value: float | None = None
    name: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """A batch of samples, one per row; every column has shape (count,).

    ``counter`` is the count of the instrument, unwrapped, so that differences are sample periods;
    for a polled instrument the host counts the answers. ``position_mm`` increases in the direction
    of the laser's configured sign and is NaN for a missing position. ``beam`` is the signal
    strength from 0 to 1, NaN if unknown. ``flags`` are `Flag` bits. ``arrival_ns`` is the arrival
    time of the chunk that completed the sample. ``channels`` are the values of a 4-DOF head, shape
    (count, k).
    """

    counter: NDArray[np.int64]
    position_mm: NDArray[np.float64]
    beam: NDArray[np.float64]
    flags: NDArray[np.uint16]
    arrival_ns: NDArray[np.int64]
    channels: NDArray[np.float64] | None = None
    notices: tuple[Notice, ...] = ()

    def __len__(self) -> int:
        return len(self.counter)

    def after(self, count: int) -> "Samples":
        """Return the batch without its first ``count`` samples and without remarks."""
        return Samples(
            counter=self.counter[count:],
            position_mm=self.position_mm[count:],
            beam=self.beam[count:],
            flags=self.flags[count:],
            arrival_ns=self.arrival_ns[count:],
            channels=None if self.channels is None else self.channels[count:],
        )


class Decoder(Protocol):
    """Decodes the bytes of one stream. The division of the bytes into chunks changes only the
    arrival times of the samples.
    """

    nominal_rate_hz: float | None
    """The last sample rate in Hz from the instrument or its data sheet; None if unknown."""
    gaps_visible: bool
    """Whether a lost sample leaves a gap in the counter."""
    latency_s: float
    """Known delay inside the instrument in s, which is subtracted from sample times."""

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        """Return the samples that ``chunk`` completes. The content of the bytes never raises an
        exception: invalid bytes are a notice.
        """
        ...

    def resync(self) -> None:
        """Discard the incomplete line or frame after an interruption of the stream."""
        ...


@runtime_checkable
class CountingDecoder(Decoder, Protocol):
    repeats_after: float
    """Number of values of the sample number before the number repeats; infinite if the number never
    repeats.
    """


@runtime_checkable
class SteadyDecoder(Decoder, Protocol):
    """A decoder that processes many chunks of plain samples in little more time than one chunk."""

    def feed_steady(self, chunks: Sequence[tuple[bytes, int]]) -> Samples | None:
        """Return the samples of the chunks (bytes, arrival in ns), each with the arrival time of
        its chunk.

        Return None without consuming a byte if `feed`, called for each chunk, could return other
        samples, set a flag, or change the rules of decoding.
        """
        ...


@runtime_checkable
class PolledDecoder(Decoder, Protocol):
    """A decoder for an instrument that answers requests; the link sends ``request``."""

    request: bytes
    poll_interval_s: float


@runtime_checkable
class AskingDecoder(PolledDecoder, Protocol):
    """A decoder that requests further quantities, such as air or signal strength, each with its own
    period.
    """

    others: Sequence[tuple[bytes, float]]
    """Further requests, each with its period in s. The answers are decoded like answers to
    ``request``.
    """


@runtime_checkable
class GreetingDecoder(Decoder, Protocol):
    """A decoder for an instrument that sends only on request: the link sends ``greeting`` after
    every opening of the line.
    """

    greeting: bytes


@runtime_checkable
class RespondingDecoder(Decoder, Protocol):
    def responder(self) -> Callable[[bytes], bytes]:
        """Return a function that takes the bytes received on an open line and returns the answer to
        send.
        """
        ...
