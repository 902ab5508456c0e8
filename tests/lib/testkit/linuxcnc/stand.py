"""The laser beside a real control: what LinuxCNC's motors do moves the virtual machine.

The laser reads the exact physics of `stepdiag.virtual` at the control's motor positions, so a
compensation that the control applies is seen as the laser of a real machine would see it. The
register block comes from the control itself, by the product's own HAL component.
"""

from collections import deque
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.base.faults import FaultBoard
from stepdiag.virtual.base.ports import SerialLine
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment, aligned_setup
from stepdiag.virtual.instruments.laser_source import Counter, TalkingLaser
from stepdiag.virtual.instruments.lasers import BOARDS, UmdBoard
from stepdiag.virtual.instruments.talker import LASER_CABLE, Talker
from stepdiag.virtual.physics.machine import Machine, Setup
from testkit.linuxcnc.rig import Control, State

LATENCY_S = 0.08
"""The laser tells what was true so long ago: by then the control has told where its motors were."""
REALIGNING_S = 0.2
RATE_HZ = 250.0
"""A quarter of what the board can: a reader that the computer lets wait loses nothing of so
much."""
TURNING_MM = 0.02
"""What counts as a move of an axis between two looks: more than a compensation moves it while
others travel."""


class MotorReadout:
    """Where the laser finds its target: the virtual machine's pose at the motor positions of the
    last moments."""

    def __init__(self, control: Control, machine: Machine, box: Box, clock: Clock) -> None:
        self._machine, self._box, self._clock = machine, box, clock
        self._setup: Setup | None = None
        self._aligned_s = 0.0
        self._path: deque[tuple[float, np.ndarray, np.ndarray]] = deque(maxlen=1000)
        self._take(control.state)
        control.on_state = self._take

    def align(self, setup: str, alignment: Alignment) -> None:
        """Put laser and mirror up for a setup, as a person does before the program is started; the
        beam is away meanwhile."""
        self.put(aligned_setup(self._machine, self._box, setup, alignment))

    def put(self, setup: Setup) -> None:
        """Put laser and mirror up as they stand in a setup."""
        self._setup = setup
        self._aligned_s = self._clock.wall_s() + REALIGNING_S

    def read(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return indicated lengths in mm and whether there is a beam, at ascending clock times."""
        if self._setup is None:
            return np.zeros(len(time_s)), np.zeros(len(time_s), dtype=bool)
        path = self._since(float(time_s[0]))
        moments = np.array([moment for moment, _, _ in path])
        points = np.array([point for _, point, _ in path])
        motor = np.stack(
            [np.interp(time_s, moments, points[:, axis]) for axis in range(3)], axis=-1
        )
        last = np.clip(np.searchsorted(moments, time_s, side="right") - 1, 0, None)
        direction = np.array([path[each][2] for each in last])
        return self._machine.indicated_mm(
            self._setup, motor, direction=direction
        ), time_s >= self._aligned_s

    def _since(self, time_s: float) -> list[tuple[float, np.ndarray, np.ndarray]]:
        """Return the path from the last moment before a time on, of the four seconds that are
        kept."""
        path = []
        for moment in reversed(tuple(self._path)):
            path.append(moment)
            if moment[0] <= time_s:
                break
        return path[::-1]

    def _take(self, state: State) -> None:
        motor = np.array(state.motor_mm)
        _, before, direction = self._path[-1] if self._path else (0.0, motor, np.zeros(3))
        moved = motor - before
        turned = np.where(np.abs(moved) > TURNING_MM, np.sign(moved), direction)
        self._path.append((state.time_ns * 1e-9 - self._clock.started_s, motor, turned))


class Stand:
    """A laser on a pty beside a running control; use it in a ``with`` statement."""

    def __init__(
        self, control: Control, machine: Machine, box: Box, folder: Path, *, noise_um: float
    ) -> None:
        clock, faults = Clock(), FaultBoard(())
        self.readout = MotorReadout(control, machine, box, clock)
        line = SerialLine(folder / "laser")
        counter = Counter(noise_um=noise_um, seed=7)
        laser = TalkingLaser(
            UmdBoard(replace(BOARDS["umd2"], rate_hz=RATE_HZ)),
            self.readout.read,
            counter,
            clock=clock,
            faults=faults,
            latency_s=LATENCY_S,
        )
        self.laser_port = str(line.link)
        self.plc_port = control.plc_port
        self._laser = Talker(
            line, laser, LASER_CABLE, clock=clock, faults=faults, chunk_s=0.01
        )

    def __enter__(self) -> Self:
        self._laser.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._laser.close()
