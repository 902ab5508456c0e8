"""The virtual bench: machine, control, PLC and laser running together on real sockets and ptys."""

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import numpy as np

from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.base.faults import Fault, FaultBoard
from stepdiag.virtual.base.ports import SerialLine, TcpLine
from stepdiag.virtual.bench.building import (
    Surroundings,
    build_drive,
    build_head_device,
    build_laser,
    build_machine,
    build_plan,
    head_builder,
    setup_builder,
)
from stepdiag.virtual.bench.config import BenchConfig, HeadPart
from stepdiag.virtual.drive.player import Player, Segment
from stepdiag.virtual.drive.program import again as one_more
from stepdiag.virtual.drive.program import steps
from stepdiag.virtual.drive.registers import PositionRegisters
from stepdiag.virtual.instruments.angular import AngleView, Autocollimator, Level
from stepdiag.virtual.instruments.interferometers import Climate
from stepdiag.virtual.instruments.lasers import Flags
from stepdiag.virtual.instruments.readout import HeadView, Readout
from stepdiag.virtual.instruments.talker import (
    AIR_CABLE,
    HEAD_CABLE,
    LASER_CABLE,
    Answering,
    Talker,
    Talking,
)
from stepdiag.virtual.instruments.weather import Logger, Transmitter
from stepdiag.virtual.physics.error_functions import Array
from stepdiag.virtual.physics.machine import Machine
from stepdiag.virtual.plc.attention import Attention
from stepdiag.virtual.plc.modbus_server import RtuSlave, Slave, TcpSlave
from stepdiag.virtual.plc.plc import Plc

_HEAD_CHUNK_S = 0.02
_SEEN, _SEEN_MOVING_S = 0.8, 0.03
"""Polling that a patient machine requires from the recorder: a share of each dwell, and a time in
wall seconds in each move. The limit of a move is a time, because a move can be shorter than a delay
of the recorder."""
Tell = Callable[[dict[str, str]], None]


class _Worker(Protocol):
    def start(self) -> None: ...

    def close(self) -> None: ...


class VirtualBench:
    """The whole bench on loopback; used in a ``with`` statement, or by `start` and `close`.

    ``directory`` is the folder for serial lines with a relative link. A worker thread calls
    ``tell`` with an event when a setup begins, when the program waits for a start, and when the
    program has ended.
    """

    def __init__(
        self, config: BenchConfig, directory: Path, *, tell: Tell | None = None
    ) -> None:
        self.config = config
        self.machine: Machine = build_machine(config)
        self._tell = tell
        self._clock = Clock(config.time_scale)
        self._faults = FaultBoard(config.fault)
        self._attention = Attention(self._faults)
        self._drive = build_drive(config)
        self._plan = build_plan(config)
        self._player = Player(
            steps(self._plan, self._faults),
            self._drive,
            handshake=config.program.handshake,
            seed=config.seed,
            on_enter=self._entered,
            hold=self._unseen if config.program.patient else None,
        )
        self._addresses: dict[str, str | int] = {}
        self._workers: list[_Worker] = []
        self._add_plc(directory)
        self._add_laser(directory)
        self._add_head(directory)
        self._add_air(directory)

    @property
    def addresses(self) -> dict[str, str | int]:
        """Return the addresses of the devices: ``plc_host`` and ``plc_port`` or ``plc_link``,
        ``laser_link``, ``head_link``, ``air_link``."""
        return dict(self._addresses)

    def start(self) -> None:
        for worker in self._workers:
            worker.start()

    def close(self) -> None:
        """Stop every device and close all threads, sockets and ptys."""
        for worker in reversed(self._workers):
            worker.close()
        self._workers.clear()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def start_setup(self, again: str = "") -> None:
        """Begin the next setup, or drive the setup of this name again.

        Raises ValueError for a setup outside the program.
        """
        if again and again not in self._plan.setups:
            raise ValueError(
                f"expected a setup of {', '.join(self._plan.setups)}, found {again!r}"
            )
        self._player.start(
            self._clock.machine_s(),
            one_more(self._plan, again, self._faults) if again else (),
        )

    def inject(self, fault: Fault) -> None:
        """Add a fault. A fault without a place occurs ``delay_s`` from now, a fault with a place
        ``delay_s`` after the program reaches this place."""
        self._faults.inject(fault, self._clock.wall_s())

    def _add_plc(self, directory: Path) -> None:
        part = self.config.plc
        if part is None:
            return
        plc = Plc(
            self._player,
            self._drive,
            self.machine.environment,
            clock=self._clock,
            faults=self._faults,
            scan_s=part.scan_s,
            lag_s=part.lag_s,
            base=part.base,
            order=part.order,
            registers=PositionRegisters(
                shows=part.positions,
                scatter_um=part.scatter_um,
                resolution_mm=part.resolution_mm,
            ),
            seed=self.config.seed,
        )
        slave = Slave(
            plc,
            unit=part.unit,
            clock=self._clock,
            faults=self._faults,
            attention=self._attention,
        )
        if part.transport == "tcp":
            server = TcpSlave(slave, host=part.host, port=part.port)
            self._addresses |= {"plc_host": part.host, "plc_port": server.port}
            self._workers.append(server)
        else:
            line = SerialLine(directory / part.link)
            self._addresses["plc_link"] = str(line.link)
            self._workers.append(RtuSlave(slave, line))

    def _add_laser(self, directory: Path) -> None:
        part = self.config.laser
        if part is None:
            return
        readout = Readout(
            self.machine,
            self._player,
            self._drive,
            setup_builder(self.config, self.machine),
            refresh_s=self.config.time_scale,
        )
        line = (
            TcpLine()
            if part.wire == "tcp"
            else SerialLine(directory / part.link, lossless=part.lossless)
        )
        self._addresses["laser_link"] = line.name
        around = Surroundings(self._climate, self._standing)
        device = build_laser(
            part,
            readout.read,
            self.config.seed,
            around,
            clock=self._clock,
            faults=self._faults,
        )
        self._workers.append(
            Talker(
                line,
                device,
                LASER_CABLE,
                clock=self._clock,
                faults=self._faults,
                powered=lambda: self._faults.inject(
                    Fault(kind="laser-reset"), self._clock.wall_s()
                ),
                chunk_s=part.chunk_s,
            )
        )

    def _climate(self) -> Climate:
        hall, now = self.machine.environment, np.array([self._clock.machine_s()])
        courses = (hall.air_c, hall.pressure_hpa, hall.humidity_percent, hall.material_c)
        return Climate(*(float(course.at(now)[0]) for course in courses))

    def _standing(self, wall_s: Array) -> Flags:
        """Return whether the stop relay is closed at wall times, shape (N,)."""
        machine_s = wall_s * self._clock.scale
        closed = np.zeros(len(machine_s), dtype=np.bool_)
        for segment in self._player.span(float(machine_s[0]), float(machine_s[-1])):
            inside = (machine_s >= segment.start_s) & (machine_s < segment.end_s)
            closed |= inside & (segment.step.kind == "dwell" and segment.step.signalled)
        return closed

    def _add_head(self, directory: Path) -> None:
        part = self.config.head
        if part is None:
            return
        line = SerialLine(directory / part.link)
        self._addresses["head_link"] = str(line.link)
        device = (
            self._angular(part)
            if part.format in ("elcomat", "wyler")
            else self._four_dof(part)
        )
        self._workers.append(
            Talker(
                line,
                device,
                HEAD_CABLE,
                clock=self._clock,
                faults=self._faults,
                chunk_s=_HEAD_CHUNK_S,
            )
        )

    def _add_air(self, directory: Path) -> None:
        part = self.config.air
        if part is None:
            return
        line = TcpLine() if part.wire == "tcp" else SerialLine(directory / part.link)
        self._addresses["air_link"] = line.name
        device = (
            Transmitter(self._climate) if part.format == "ptu300" else Logger(self._climate)
        )
        self._workers.append(
            Talker(
                line,
                device,
                AIR_CABLE,
                clock=self._clock,
                faults=self._faults,
                chunk_s=_HEAD_CHUNK_S,
            )
        )

    def _angular(self, part: HeadPart) -> Talking | Answering:
        stand = self.config.alignment.stand
        view = AngleView(
            self.machine,
            self._player,
            self._drive,
            clock=self._clock,
            stand=stand,
            seed=self.config.seed,
        )
        return Autocollimator(view.look) if part.format == "elcomat" else Level(view.look)

    def _four_dof(self, part: HeadPart) -> Talking | Answering:
        view = HeadView(
            self.machine,
            self._player,
            self._drive,
            part.optics,
            head_builder(self.config, part, self.machine),
            clock=self._clock,
            faults=self._faults,
            stand=self.config.alignment.stand,
        )
        return build_head_device(part, view.look)

    def _entered(self, segment: Segment) -> None:
        step, wall_s = segment.step, segment.start_s / self._clock.scale
        self._faults.reach(step.setup, step.pass_number, step.stop, step.kind, wall_s)
        if step.kind != "pause":
            return
        if step.setup and step.pass_number == 0:
            self._faults.inject(Fault(kind="laser-reset"), wall_s)
            self._say("setup", step.setup)
        elif not step.setup:
            self._say("finished" if step.beam else "waiting", "")

    def _unseen(self, segment: Segment) -> bool:
        """Return whether a step must last longer because the recorder was delayed during the
        step.
        """
        scale = self._clock.scale
        wanted_s = (
            _SEEN * segment.step.duration_s / scale
            if segment.step.kind == "dwell"
            else _SEEN_MOVING_S
        )
        return self._attention.lacking(
            segment.start_s / scale, self._clock.wall_s(), wanted_s
        )

    def _say(self, event: str, setup: str) -> None:
        if self._tell is not None:
            self._tell({"event": event, "setup": setup})
