"""The running control: the commanded position of every axis at any time, and the signals of the
machine.

Time is machine time in s from the start of the bench. The program only runs forward. A reader can
still read the positions of a short time before the present.
"""

import math
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from stepdiag.virtual.drive.program import Step
from stepdiag.virtual.physics.error_functions import Array

_HISTORY = 512
_HELD_S = 0.1
"""Prolongation in s of a step that must last longer, before the next check."""


@dataclass(slots=True, kw_only=True)
class Segment:
    """A step of the program with its times, from ``start_s`` to ``end_s`` (infinite while unknown);
    ``number`` counts the steps from 0.

    ``stop_count`` is the value of the stop counter from the beginning of the step on. ``from_mm``
    and ``to_mm`` are commanded positions, ``true_from_mm`` and ``true_to_mm`` the real positions of
    the axes; an axis that does not move keeps its real position. ``servo_um`` is the part of the
    difference between real and commanded position that the encoders show, at the beginning and at
    the end of the step. ``approach`` is the sign of each axis' last movement.
    """

    number: int
    step: Step
    start_s: float
    end_s: float
    from_mm: Array
    to_mm: Array
    true_from_mm: Array
    true_to_mm: Array
    servo_um: tuple[Array, Array]
    approach: Array
    stop_count: int
    moved: Array
    """Unit vector of the last move, (3,): the structure oscillates along it from ``arrived_s``
    on."""
    arrived_s: float

    @property
    def distance_mm(self) -> float:
        return float(np.linalg.norm(self.to_mm - self.from_mm))


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Motion of the axes: trapezoidal speed, then a decaying oscillation of the structure, with a
    permanent hum.

    Each move of an axis draws two errors of arrival along this axis with these standard deviations:
    ``repeatability_um``, which the encoder does not show, and ``servo_um``, the position error at
    standstill, which it shows.
    """

    feed_mm_min: float = 2000.0
    acceleration_mm_s2: float = 1000.0
    ring_um: float = 1.0
    ring_hz: float = 30.0
    ring_decay_s: float = 0.08
    hum_um: float = 0.0
    hum_hz: float = 50.0
    repeatability_um: float = 0.0
    servo_um: float = 0.0

    def duration_s(self, distance_mm: float) -> float:
        peak = self._peak_mm_s(distance_mm)
        return (
            distance_mm / peak + peak / self.acceleration_mm_s2 if distance_mm > 0.0 else 0.0
        )

    def _peak_mm_s(self, distance_mm: float) -> float:
        return min(self.feed_mm_min / 60.0, math.sqrt(distance_mm * self.acceleration_mm_s2))

    def fraction(self, distance_mm: float, elapsed_s: Array) -> Array:
        """Return the completed part of a move, 0 to 1, shape like ``elapsed_s``."""
        if distance_mm <= 0.0:
            return np.ones_like(elapsed_s)
        peak, acceleration = self._peak_mm_s(distance_mm), self.acceleration_mm_s2
        ramp_s, total_s = peak / acceleration, self.duration_s(distance_mm)
        t = np.clip(elapsed_s, 0.0, total_s)
        left = total_s - t
        way = np.where(t < ramp_s, 0.5 * acceleration * t**2, peak * (t - 0.5 * ramp_s))
        way = np.where(left < ramp_s, distance_mm - 0.5 * acceleration * left**2, way)
        done: Array = way / distance_mm
        return done

    def ring_um_at(self, segment: Segment, time_s: Array) -> Array:
        """Return the oscillation of the structure along the last move, shape (N,); zero while the
        axes move."""
        if segment.step.kind == "move":
            return np.zeros_like(time_s)
        since = time_s - max(segment.arrived_s, 0.0)
        swing: Array = (
            self.ring_um
            * np.exp(-since / self.ring_decay_s)
            * np.sin(2 * np.pi * self.ring_hz * since)
        )
        return swing


class Player:
    """Executes the steps of a program; thread-safe. A move and a signalled dwell end only if
    ``hold`` permits it."""

    def __init__(
        self,
        program: Iterator[Step],
        drive: Drive,
        *,
        handshake: bool = False,
        seed: int = 0,
        on_enter: Callable[[Segment], None] | None = None,
        hold: Callable[[Segment], bool] | None = None,
    ) -> None:
        self._lock = threading.RLock()
        self._program = program
        self._drive = drive
        self._handshake = handshake
        self._rng = np.random.default_rng(seed)
        self._on_enter = on_enter
        self._hold = hold
        self._captured: tuple[int, float] | None = None
        self._started_s = -math.inf
        self._now_s = 0.0
        self.finished = threading.Event()
        self._segments: deque[Segment] = deque(maxlen=_HISTORY)
        home = np.zeros(3)
        at_home = Segment(
            number=-1,
            step=Step(kind="pause"),
            start_s=0.0,
            end_s=0.0,
            from_mm=home,
            to_mm=home,
            true_from_mm=home,
            true_to_mm=home,
            servo_um=(home, home),
            approach=home,
            stop_count=0,
            moved=home,
            arrived_s=-math.inf,
        )
        self._segments.append(at_home)

    def advance(self, to_s: float) -> Segment:
        """Execute the program up to ``to_s`` and return the segment of that time."""
        with self._lock:
            self._now_s = max(self._now_s, to_s)
            while True:
                current = self._segments[-1]
                self._decide_end(current)
                if current.end_s > self._now_s:
                    return self._at(to_s)
                self._enter(current)

    def capture(self, stop_count: int, at_s: float) -> None:
        """Process the handshake: the recorder has captured the stop with this counter."""
        with self._lock:
            self._captured = (stop_count, at_s)

    def forget_captured(self) -> None:
        """Discard the handshake, like a PLC that restarts: a dwell waits for a new handshake."""
        with self._lock:
            self._captured, last = None, self._segments[-1]
            if self._handshake and last.step.kind == "dwell" and last.end_s > self._now_s:
                last.end_s = math.inf

    def start(self, at_s: float, first: Iterable[Step] = ()) -> None:
        """Begin the next setup, after the steps ``first``, if the machine waits for a start;
        otherwise do nothing."""
        with self._lock:
            if (
                self._segments[-1].step.kind == "pause"
                and self._segments[-1].end_s == math.inf
            ):
                self._program = chain(first, self._program)
            self._started_s = at_s

    def span(self, first_s: float, last_s: float) -> list[Segment]:
        """Return the stored segments between ``first_s`` and ``last_s``, in order."""
        self.advance(last_s)
        with self._lock:
            return [
                segment
                for segment in self._segments
                if segment.end_s > first_s and segment.start_s <= last_s
            ]

    def _at(self, at_s: float) -> Segment:
        for segment in reversed(self._segments):
            if segment.start_s <= at_s:
                return segment
        return self._segments[0]

    def _decide_end(self, segment: Segment) -> None:
        step = segment.step
        if segment.end_s != math.inf:
            if segment.end_s <= self._now_s and self._held(segment):
                segment.end_s = self._now_s + _HELD_S
            return
        if step.kind == "pause" and self._started_s > segment.start_s:
            segment.end_s = self._started_s
        elif (
            step.kind == "dwell"
            and self._captured is not None
            and self._captured[0] == segment.stop_count % 65536
        ):
            segment.end_s = max(segment.start_s + step.duration_s, self._captured[1])

    def _held(self, segment: Segment) -> bool:
        shown = segment.step.kind == "move" or (
            segment.step.kind == "dwell" and segment.step.signalled
        )
        return (
            shown and self._hold is not None and not self._handshake and self._hold(segment)
        )

    def _enter(self, last: Segment) -> None:
        step = next(self._program, None)
        if step is None:
            self.finished.set()
            step = Step(kind="pause", duration_s=math.inf)
        target = last.to_mm if step.target_mm is None else step.target_mm
        distance = float(np.linalg.norm(target - last.to_mm))
        true_mm, servo_um = self._arrive(last, target)
        segment = Segment(
            number=last.number + 1,
            step=step,
            start_s=last.end_s,
            end_s=last.end_s + self._duration_s(step, distance),
            from_mm=last.to_mm,
            to_mm=target,
            true_from_mm=last.true_to_mm,
            true_to_mm=true_mm,
            servo_um=(last.servo_um[1], servo_um),
            approach=np.where(
                target != last.to_mm, np.sign(target - last.to_mm), last.approach
            ),
            stop_count=last.stop_count + step.counts,
            moved=(target - last.to_mm) / distance if distance > 0.0 else last.moved,
            arrived_s=last.end_s if last.step.kind == "move" else last.arrived_s,
        )
        self._segments.append(segment)
        if self._on_enter is not None:
            self._on_enter(segment)

    def _arrive(self, last: Segment, target: Array) -> tuple[Array, Array]:
        """Return the real positions of the axes after a move, and the errors of arrival that their
        encoders show, both (3,)."""
        drawn_um = self._rng.normal(size=(2, 3)) * [
            [self._drive.repeatability_um],
            [self._drive.servo_um],
        ]
        moved = target != last.to_mm
        true_mm: Array = np.where(
            moved, target + 1e-3 * drawn_um.sum(axis=0), last.true_to_mm
        )
        servo_um: Array = np.where(moved, drawn_um[1], last.servo_um[1])
        return true_mm, servo_um

    def _duration_s(self, step: Step, distance_mm: float) -> float:
        if step.kind == "move":
            return self._drive.duration_s(distance_mm)
        return (
            math.inf
            if step.kind == "dwell" and self._handshake and step.signalled
            else step.duration_s
        )
