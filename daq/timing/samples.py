"""The output of every wire format: samples in columns, and remarks about the stream.

Samples are columns, not objects: decoders process blocks of lines, and the synchroniser processes
arrays, so that one processor core suffices for a hundred thousand samples a second.
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
    """A remark of the stream at sample ``index`` of its batch (the sample that follows the remark).

    ``value`` depends on the code: the number of missing samples for ``gap``, the rate in Hz for
    ``rate``. ``name`` is the name of the condition in an ``environment`` notice. ``why`` is a
    message, or the instrument's own text.
    """

    code: NoticeCode
    index: int
    why: Words = ""
    value: float | None = None
    name: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """A batch of samples, a row each; every column has shape (count,).

    ``counter`` is the instrument's own count, unwrapped, so that differences are sample periods. A
    polled instrument has no counter: the host numbers the answers. ``position_mm`` grows as
    configured by the laser's sign and is NaN for a missing position. ``beam`` is the signal
    strength from 0 to 1, NaN where unknown. ``flags`` holds `Flag` bits. ``arrival_ns`` is the
    arrival stamp of the chunk that completed the sample. ``channels`` holds the values of a 4-DOF
    head, shape (count, k).
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
        """Return the samples without the first ``count`` of them, and without remarks."""
        return Samples(
            counter=self.counter[count:],
            position_mm=self.position_mm[count:],
            beam=self.beam[count:],
            flags=self.flags[count:],
            arrival_ns=self.arrival_ns[count:],
            channels=None if self.channels is None else self.channels[count:],
        )


class Decoder(Protocol):
    """Decodes the bytes of one stream. The division of the bytes into chunks does not change the
    samples, only their arrival stamps.
    """

    nominal_rate_hz: float | None
    """The sample rate in Hz last reported by the instrument, or from the data sheet; None if
    unknown.
    """
    gaps_visible: bool
    """Whether a lost sample leaves a gap in the counter."""
    latency_s: float
    """Known delay inside the instrument: subtracted from sample times."""

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        """Return the samples that ``chunk`` completes. Never raises on the content of the bytes:
        garbage is a notice."""
        ...

    def resync(self) -> None:
        """Discard the incomplete line or frame: the stream was interrupted."""
        ...


@runtime_checkable
class CountingDecoder(Decoder, Protocol):
    """A decoder of an instrument that may number its samples itself."""

    repeats_after: float
    """Number of values of the instrument's sample number before it repeats; infinite if it never
    repeats.
    """


@runtime_checkable
class SteadyDecoder(Decoder, Protocol):
    """A decoder that processes many chunks in little more time than a single chunk, as long as they
    hold only plain samples.
    """

    def feed_steady(self, chunks: Sequence[tuple[bytes, int]]) -> Samples | None:
        """Return the samples that the chunks (bytes, arrival in ns) complete, each stamped with the
        arrival of its own chunk.

        None, without consuming a byte, where `feed`, called chunk by chunk, could give other
        samples, a flag, or another rule for the decoding of lines.
        """
        ...


@runtime_checkable
class PolledDecoder(Decoder, Protocol):
    """A decoder for an instrument that answers requests; the link sends ``request`` and passes on
    the answer.
    """

    request: bytes
    poll_interval_s: float


@runtime_checkable
class AskingDecoder(PolledDecoder, Protocol):
    """A decoder that requests further quantities, each at its own pace: air, strength of the
    signal.
    """

    others: Sequence[tuple[bytes, float]]
    """Further requests, each with the time in s until it is sent again. Their answers are passed on
    like the answer to ``request``.
    """


@runtime_checkable
class GreetingDecoder(Decoder, Protocol):
    """A decoder for an instrument that sends on request: the link sends ``greeting`` whenever the
    line is open.
    """

    greeting: bytes


@runtime_checkable
class RespondingDecoder(Decoder, Protocol):
    """A decoder for an instrument that needs an answer to its data."""

    def responder(self) -> Callable[[bytes], bytes]:
        """Return a function that takes the bytes received on an open line and returns the answer to
        send.
        """
        ...
