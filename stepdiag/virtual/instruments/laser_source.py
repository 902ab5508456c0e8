"""The laser as an instrument: its count, lost beam, reset and latency."""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.base.faults import FaultBoard
from stepdiag.virtual.instruments.interferometers import Lasertex, Qudis
from stepdiag.virtual.instruments.lasers import Encoder, Flags
from stepdiag.virtual.physics.error_functions import Array

Read = Callable[[Array], tuple[Array, Flags]]
"""A function from ascending machine times to indicated lengths in mm, and whether the beam is
present."""

_LOST_FRINGES = 400
_LOST_FRINGE_MM = 0.000158
"""Largest number of fringes by which the count is wrong after the beam returns, and the length of a
fringe in mm: a quarter of the wavelength."""


class Display(Protocol):
    def requests(self, received: bytes) -> list[bytes]: ...

    def answer(self, request: bytes, reading_mm: float, *, beam: bool) -> bytes: ...


class Counter:
    """The count of an interferometer from the optical path. It begins at zero.

    While the beam is lost, the count does not change. After the beam returns, the count is
    permanently wrong by the missed travel and by a random number of fringes.
    """

    def __init__(self, *, sign: int = 1, noise_um: float = 0.0, seed: int = 0) -> None:
        self._sign = sign
        self._noise_mm = noise_um * 1e-3
        self._rng = np.random.default_rng(seed)
        self._offset_mm = math.nan
        self._held_mm = 0.0

    def zero(self) -> None:
        self._offset_mm = math.nan
        self._held_mm = 0.0

    def jump(self, by_um: float) -> None:
        """Shift all readings from now on, as after a touch of the mirror."""
        self._offset_mm += by_um * 1e-3

    def count(self, indicated_mm: Array, beam: Flags) -> Array:
        """Return the readings of consecutive samples in mm, shape (N,)."""
        reading = np.empty(len(indicated_mm))
        edges = np.flatnonzero(np.diff(beam)) + 1
        for first, last in zip((0, *edges), (*edges, len(beam)), strict=True):
            if first == last:
                continue
            if beam[first]:
                self._count_on(indicated_mm[first:last], reading[first:last])
            else:
                reading[first:last] = self._held_mm
                self._lose()
        return reading

    def _count_on(self, indicated_mm: Array, reading: Array) -> None:
        if math.isnan(self._offset_mm):
            self._offset_mm = self._held_mm - self._sign * float(indicated_mm[0])
        noise = (
            self._rng.normal(scale=self._noise_mm, size=len(reading))
            if self._noise_mm
            else 0.0
        )
        reading[:] = self._sign * indicated_mm + self._offset_mm + noise
        self._held_mm = float(reading[-1])

    def _lose(self) -> None:
        if not math.isnan(self._offset_mm):
            self._held_mm += (
                float(self._rng.integers(-_LOST_FRINGES, _LOST_FRINGES)) * _LOST_FRINGE_MM
            )
            self._offset_mm = math.nan


class _Sampler:
    """A laser with its beam, its reset button and its latency.

    ``latency_s`` is the delay inside the instrument: the instrument sends the value that it
    measured ``latency_s`` earlier.
    """

    def __init__(
        self,
        read: Read,
        counter: Counter,
        *,
        clock: Clock,
        faults: FaultBoard,
        latency_s: float,
    ) -> None:
        self._read = read
        self._counter = counter
        self._clock = clock
        self._faults = faults
        self._latency_s = latency_s
        self._sent_mm = 0.0
        self._was_frozen = False

    def sample(self, wall_s: Array) -> tuple[Array, Flags]:
        """Return the readings of the laser at wall times, and whether the beam was present."""
        for _ in self._faults.due("laser-reset", float(wall_s[-1])):
            self._counter.zero()
        for fault in self._faults.due("laser-jump", float(wall_s[-1])):
            self._counter.jump(fault.value)
        then_s = wall_s - self._latency_s
        indicated, beam = self._read(then_s * self._clock.scale)
        for start_s, end_s in self._faults.spans("beam-lost"):
            beam &= (then_s < start_s) | (then_s >= end_s)
        return self._as_sent(self._counter.count(indicated, beam), then_s), beam

    def _as_sent(self, reading: Array, then_s: Array) -> Array:
        frozen = np.zeros(len(then_s), dtype=np.bool_)
        for start_s, end_s in self._faults.spans("laser-frozen"):
            frozen |= (then_s >= start_s) & (then_s < end_s)
        if not frozen.any():
            self._sent_mm, self._was_frozen = float(reading[-1]), False
            return reading
        before = np.concatenate(([self._sent_mm], reading[:-1]))
        begins = frozen & ~np.concatenate(([self._was_frozen], frozen[:-1]))
        last = np.maximum.accumulate(np.where(begins, np.arange(len(reading)), -1))
        held = np.where(last >= 0, before[last], self._sent_mm)
        sent: Array = np.where(frozen, held, reading)
        self._sent_mm, self._was_frozen = float(sent[-1]), bool(frozen[-1])
        return sent


class TalkingLaser(_Sampler):
    """A laser that sends line after line (`stepdiag.virtual.instruments.talker.Talking`)."""

    def __init__(
        self,
        encoder: Encoder,
        read: Read,
        counter: Counter,
        *,
        clock: Clock,
        faults: FaultBoard,
        latency_s: float = 0.0,
    ) -> None:
        super().__init__(read, counter, clock=clock, faults=faults, latency_s=latency_s)
        self._encoder = encoder
        self.rate_hz = encoder.rate_hz

    def banner(self) -> bytes:
        return self._encoder.banner()

    def skip(self, count: int) -> None:
        self._encoder.skip(count)

    def speak(self, wall_s: Array) -> bytes:
        return self._encoder.encode(*self.sample(wall_s))


class CommandedLaser(TalkingLaser):
    """A laser that sends on request (`stepdiag.virtual.instruments.talker.Responding`)."""

    def __init__(
        self,
        device: Lasertex,
        read: Read,
        counter: Counter,
        *,
        clock: Clock,
        faults: FaultBoard,
        latency_s: float = 0.0,
    ) -> None:
        super().__init__(
            device, read, counter, clock=clock, faults=faults, latency_s=latency_s
        )
        self.respond = device.respond


class MarkedLaser(_Sampler):
    """A quDIS: each of its readings contains the count of the marker input."""

    def __init__(
        self,
        device: Qudis,
        read: Read,
        counter: Counter,
        *,
        clock: Clock,
        faults: FaultBoard,
        latency_s: float = 0.0,
    ) -> None:
        super().__init__(read, counter, clock=clock, faults=faults, latency_s=latency_s)
        self._device = device
        self.rate_hz, self.banner, self.skip, self.respond = (
            device.rate_hz,
            device.banner,
            device.skip,
            device.respond,
        )

    def speak(self, wall_s: Array) -> bytes:
        reading_mm, _ = self.sample(wall_s)
        return self._device.tell(reading_mm, self._device.watch(wall_s))


class AskedLaser(_Sampler):
    """A position display that sends its value on request
    (`stepdiag.virtual.instruments.talker.Answering`)."""

    def __init__(
        self,
        display: Display,
        read: Read,
        counter: Counter,
        *,
        clock: Clock,
        faults: FaultBoard,
        latency_s: float = 0.0,
    ) -> None:
        super().__init__(read, counter, clock=clock, faults=faults, latency_s=latency_s)
        self._display = display

    def requests(self, received: bytes) -> list[bytes]:
        return self._display.requests(received)

    def answer(self, request: bytes, wall_s: float) -> bytes:
        reading_mm, beam = self.sample(np.array([wall_s]))
        return self._display.answer(request, float(reading_mm[0]), beam=bool(beam[0]))

    def watch(self, wall_s: float) -> None:
        """Continue the count without a request, so that a beam lost between two requests affects
        the count."""
        self.sample(np.array([wall_s]))
