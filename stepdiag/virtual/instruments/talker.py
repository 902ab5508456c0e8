"""The thread of an instrument on a serial line, and all faults of its cable."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.base.faults import FaultBoard, FaultKind
from stepdiag.virtual.base.ports import Line
from stepdiag.virtual.physics.error_functions import Array

_MAXIMUM_BACKLOG_S = 0.5
"""Longest time in s for which samples are kept while an instrument cannot send. On a lossless line,
all samples are kept, and one transmission contains at most the samples of this time."""


@runtime_checkable
class Talking(Protocol):
    """An instrument that sends without requests."""

    rate_hz: float

    def banner(self) -> bytes:
        """Return the bytes that the instrument sends at power-on."""
        ...

    def skip(self, count: int) -> None: ...

    def speak(self, wall_s: Array) -> bytes:
        """Return the bytes of consecutive samples taken at these wall times."""
        ...


@runtime_checkable
class Responding(Protocol):
    """An instrument that sends without requests, and accepts commands."""

    def respond(self, received: bytes) -> bytes:
        """Process the received bytes; return the answer."""
        ...


class Answering(Protocol):
    """An instrument that only answers requests."""

    def requests(self, received: bytes) -> list[bytes]:
        """Return the complete requests in the received bytes, and keep the rest."""
        ...

    def answer(self, request: bytes, wall_s: float) -> bytes: ...

    def watch(self, wall_s: float) -> None:
        """Continue to measure without requests."""
        ...


@dataclass(frozen=True, slots=True)
class CableFaults:
    unplug: FaultKind
    silent: FaultKind
    garbage: FaultKind
    baud: FaultKind


LASER_CABLE = CableFaults("laser-unplug", "laser-silent", "laser-garbage", "laser-baud")
HEAD_CABLE = CableFaults("head-unplug", "head-silent", "head-garbage", "head-baud")
AIR_CABLE = CableFaults("air-unplug", "air-silent", "air-garbage", "air-baud")


class Talker:
    """The thread of an instrument. ``powered`` is called when the instrument gets power after its
    cable was pulled."""

    def __init__(
        self,
        line: Line,
        device: Talking | Answering,
        cable: CableFaults,
        *,
        clock: Clock,
        faults: FaultBoard,
        powered: Callable[[], None] = lambda: None,
        chunk_s: float,
    ) -> None:
        self._line = line
        self._device = device
        self._cable = cable
        self._clock = clock
        self._faults = faults
        self._powered = powered
        self._chunk_s = chunk_s
        self._rng = np.random.default_rng(1)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=line.name)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._line.end()
        self._thread.join()
        self._line.unplug()

    def _run(self) -> None:
        if isinstance(self._device, Talking):
            self._talk(self._device)
        else:
            self._answer(self._device)

    def _talk(self, device: Talking) -> None:
        responding = device if isinstance(device, Responding) else None
        self._line.write(device.banner())
        sent = int(self._clock.wall_s() * device.rate_hz)
        while not self._stop.wait(self._chunk_s):
            now = self._clock.wall_s()
            due = int(now * device.rate_hz)
            backlog = int(_MAXIMUM_BACKLOG_S * device.rate_hz)
            if self._line.lossless:
                due = min(due, sent + backlog)
            elif (late := due - sent - backlog) > 0:
                device.skip(late)
                sent += late
            if self._plugged_in(now):
                self._line.write(device.banner())
            if responding and (received := self._line.read(0.0)):
                self._send(responding.respond(received), now)
            if due > sent:
                data = device.speak(np.arange(sent + 1, due + 1) / device.rate_hz)
                sent = due
                self._send(data, now)

    def _answer(self, device: Answering) -> None:
        while not self._stop.is_set():
            self._plugged_in(self._clock.wall_s())
            for request in device.requests(self._line.read(self._chunk_s)):
                now = self._clock.wall_s()
                self._send(device.answer(request, now), now)
            device.watch(self._clock.wall_s())

    def _plugged_in(self, now: float) -> bool:
        if self._faults.active(self._cable.unplug, now):
            self._line.unplug()
        elif not self._line.plugged:
            self._line.plug()
            self._powered()
            return True
        return False

    def _send(self, data: bytes, now: float) -> None:
        if self._faults.active(self._cable.silent, now):
            return
        if self._faults.active(self._cable.baud, now):
            data = self._rng.integers(0, 256, size=len(data), dtype=np.uint8).tobytes()
        for fault in self._faults.due(self._cable.garbage, now):
            middle, count = len(data) // 2, int(fault.value) or 40
            data = (
                data[:middle]
                + self._rng.bytes(max(0, count))
                + data[middle + max(0, -count) :]
            )
        self._line.write(data)
