"""The input of laser and head at any time: the exact pose of the machine during the program."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.base.faults import FaultBoard
from stepdiag.virtual.drive.player import Drive, Player, Segment
from stepdiag.virtual.instruments.head import Counts, HeadOptics, VirtualHead, dark_channels
from stepdiag.virtual.instruments.lasers import Flags
from stepdiag.virtual.physics.error_functions import Array
from stepdiag.virtual.physics.kinematics import Stand
from stepdiag.virtual.physics.machine import Machine, Setup

_MOVE_NODES = 17
_GRID_NODES = 3


@dataclass(frozen=True, slots=True)
class Track:
    """The axes at N times: ``position_mm`` and ``approach`` (N, 3), the setup, and whether the beam
    is present or wobbled."""

    position_mm: Array
    approach: Array
    setup: list[str]
    beam: Flags
    wobbled: Flags


def track(player: Player, drive: Drive, time_s: Array) -> Track:
    """Return the positions of the axes at ascending machine times, with the oscillation of the
    structure."""
    count = len(time_s)
    followed = Track(
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        [""] * count,
        *np.zeros((2, count), dtype=np.bool_),
    )
    for segment in player.span(float(time_s[0]), float(time_s[-1])):
        first, last = np.searchsorted(time_s, (segment.start_s, segment.end_s))
        times = time_s[first:last]
        fraction = drive.fraction(segment.distance_mm, times - segment.start_s)[:, None]
        swing_mm = drive.ring_um_at(segment, times)[:, None] * segment.moved * 1e-3
        followed.position_mm[first:last] = (
            segment.true_from_mm
            + fraction * (segment.true_to_mm - segment.true_from_mm)
            + swing_mm
        )
        followed.approach[first:last] = segment.approach
        followed.setup[first:last] = [segment.step.setup] * (last - first)
        followed.wobbled[first:last] = segment.step.wobbled
        followed.beam[first:last] = segment.step.beam and bool(segment.step.setup)
    return followed


@dataclass(slots=True)
class _Curve:
    """The indicated length over a segment, as a function of the fraction of a move, or of time in a
    standstill."""

    key: tuple[int, int]
    at: Array
    indicated_mm: Array


class Readout:
    """Converts machine times into indicated lengths.

    The exact optics are computed at nodes of each segment and interpolated between them; at both
    ends of a move the length is exact. While the axes stand, the nodes are ``refresh_s`` apart in
    time, so that heat and air continue to change.
    """

    def __init__(
        self,
        machine: Machine,
        player: Player,
        drive: Drive,
        setup_of: Callable[[str], Setup],
        *,
        refresh_s: float = 1.0,
    ) -> None:
        self._machine = machine
        self._player = player
        self._drive = drive
        self._setup_of = setup_of
        self._refresh_s = refresh_s
        self._curve = _Curve((-1, -1), np.zeros(2), np.zeros(2))

    def read(self, time_s: Array) -> tuple[Array, Flags]:
        """Return indicated lengths in mm, and whether a beam is present, at ascending machine
        times, both shape (N,)."""
        indicated = np.zeros(len(time_s))
        beam = np.zeros(len(time_s), dtype=np.bool_)
        for segment in self._player.span(float(time_s[0]), float(time_s[-1])):
            first, last = np.searchsorted(time_s, (segment.start_s, segment.end_s))
            if segment.step.setup and segment.step.beam and last > first:
                indicated[first:last] = self._segment_mm(segment, time_s[first:last])
                beam[first:last] = True
        return indicated, beam

    def _segment_mm(self, segment: Segment, time_s: Array) -> Array:
        setup = self._setup_of(segment.step.setup)
        moving = segment.step.kind == "move"
        fraction = (
            self._drive.fraction(segment.distance_mm, time_s - segment.start_s)
            if moving
            else np.zeros_like(time_s)
        )
        curve = self._curve_of(segment, setup, float(time_s[0]), moving=moving)
        length_mm = np.interp(fraction if moving else time_s, curve.at, curve.indicated_mm)
        together: Array = length_mm + self._swing_um(segment, setup, time_s) * 1e-3
        return together

    def _curve_of(
        self, segment: Segment, setup: Setup, time_s: float, *, moving: bool
    ) -> _Curve:
        block = 0 if moving else int((time_s - segment.start_s) / self._refresh_s)
        if self._curve.key != (segment.number, block):
            if moving:
                at = np.linspace(0.0, 1.0, _MOVE_NODES)
                times = np.full(_MOVE_NODES, segment.start_s)
                points = segment.true_from_mm + at[:, None] * (
                    segment.true_to_mm - segment.true_from_mm
                )
            else:
                at = times = segment.start_s + self._refresh_s * (
                    block + np.arange(_GRID_NODES, dtype=np.float64)
                )
                points = np.broadcast_to(segment.true_to_mm, (_GRID_NODES, 3))
            indicated = self._machine.indicated_mm(
                setup, points, direction=segment.approach, time_s=times
            )
            self._curve = _Curve((segment.number, block), at, indicated)
        return self._curve

    def _swing_um(self, segment: Segment, setup: Setup, time_s: Array) -> Array:
        """Return the oscillation of structure and floor along the beam, shape (N,)."""
        drive = self._drive
        hum: Array = drive.hum_um * np.sin(2 * np.pi * drive.hum_hz * time_s)
        return hum + drive.ring_um_at(segment, time_s) * float(
            segment.moved @ setup.beam.direction
        )


class HeadView:
    """The input of the 4-DOF head during the program: light during its own runs, otherwise
    darkness."""

    def __init__(
        self,
        machine: Machine,
        player: Player,
        drive: Drive,
        optics: HeadOptics,
        head_of: Callable[[str], VirtualHead],
        *,
        clock: Clock,
        faults: FaultBoard,
        stand: Stand = "table",
    ) -> None:
        self._machine = machine
        self._player = player
        self._drive = drive
        self._optics = optics
        self._head_of = head_of
        self._clock = clock
        self._faults = faults
        self._stand: Stand = stand
        self._rng = np.random.default_rng(2)

    def look(self, wall_s: Array) -> Counts:
        """Return x, y and sum of QD, PSD1 and PSD2 at ascending wall times, shape (N, 9)."""
        machine_s = wall_s * self._clock.scale
        followed = track(self._player, self._drive, machine_s)
        lit = followed.beam.copy()
        for start_s, end_s in self._faults.spans("head-blocked"):
            lit &= (wall_s < start_s) | (wall_s >= end_s)
        channels = dark_channels(self._optics, len(wall_s), self._rng)
        names = np.array(followed.setup)
        for setup in set(followed.setup):
            here = lit & (names == setup)
            if setup.startswith("fourdof") and here.any():
                pose = self._machine.pose(
                    followed.position_mm[here],
                    direction=followed.approach[here],
                    time_s=machine_s[here],
                    stand=self._stand,
                )
                wobbled = followed.wobbled[here].astype(np.float64)
                channels[here] = self._head_of(setup).channels(
                    pose, machine_s[here], wobbled=wobbled
                )
        return channels
