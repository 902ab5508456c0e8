"""The PLC of the virtual machine: the register block of contract 2. This code follows the table of
contract 2 and not the code of the recorder."""

import struct
import threading
from collections.abc import Sequence

import numpy as np

from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.base.faults import FaultBoard
from stepdiag.virtual.drive.player import Drive, Player, Segment
from stepdiag.virtual.drive.registers import PositionRegisters
from stepdiag.virtual.drive.sequence import register_of
from stepdiag.virtual.physics.environment import Environment
from stepdiag.virtual.physics.error_functions import Array
from stepdiag.virtual.plc.modbus import ILLEGAL_ADDRESS, ModbusError

CAPTURED_REGISTER = 100
_BYTE_ORDERS = {
    "ABCD": (0, 1, 2, 3),
    "CDAB": (2, 3, 0, 1),
    "BADC": (1, 0, 3, 2),
    "DCBA": (3, 2, 1, 0),
}
_HEARTBEAT_S = 0.4
_STOPPED, _RUNNING, _ALARM = 1, 2, 4


class Plc:
    """The registers of the PLC at the time of a master's request.

    The image is renewed every ``scan_s``, so a change in the control appears up to ``scan_s``
    later. Counter and position appear later by a further ``lag_s``. ``order`` is the byte order of
    the 32-bit positions, ``base`` the address of the block. ``registers`` selects commanded or
    actual positions; ``seed`` draws the scatter of actual positions for each scan. Coils and
    discrete inputs 0 to 2 repeat the bits of the state word.
    """

    def __init__(  # noqa: PLR0913 - one argument a property of the PLC
        self,
        player: Player,
        drive: Drive,
        environment: Environment,
        *,
        clock: Clock,
        faults: FaultBoard,
        scan_s: float = 0.01,
        lag_s: float = 0.0,
        base: int = 0,
        order: str = "ABCD",
        registers: PositionRegisters | None = None,
        seed: int = 0,
    ) -> None:
        self._player = player
        self._drive = drive
        self._environment = environment
        self._clock = clock
        self._faults = faults
        self._scan_s = scan_s
        self._lag_s = lag_s
        self._base = base
        self._order = _BYTE_ORDERS[order]
        self._registers = registers or PositionRegisters()
        self._seed = seed
        self._lock = threading.Lock()
        self._captured = 0
        self._counted_before_reboot = 0
        self._frozen: list[int] | None = None

    def reboot(self, *, counts_on: bool = False) -> None:
        """Discard the captured stop, and set the stop counter to 0 unless the PLC keeps the
        counter."""
        with self._lock:
            if not counts_on:
                self._counted_before_reboot = self._player.advance(
                    self._clock.machine_s()
                ).stop_count
            self._captured = 0
            self._player.forget_captured()

    def read(self, table: str, address: int, count: int) -> Sequence[int]:
        """Return registers or bits of the image. Raises `ModbusError` for an address outside the
        image, or during a fault that causes an exception."""
        if fault := self._faults.active("plc-exception", self._clock.wall_s()):
            raise ModbusError(int(fault.value) or 4)
        with self._lock:
            image = self._image()
            if table in ("coil", "discrete"):
                bits = [image[2] >> bit & 1 for bit in range(3)]
                return _slice(bits, address, count)
            if address == CAPTURED_REGISTER and table == "holding":
                return _slice([self._captured], 0, count)
            return _slice(image, address - self._base, count)

    def write(self, table: str, address: int, values: Sequence[int]) -> None:
        """Store the register ``captured``; any other address is refused."""
        if table != "holding" or address != CAPTURED_REGISTER or len(values) != 1:
            raise ModbusError(ILLEGAL_ADDRESS)
        with self._lock:
            self._captured = values[0]
            self._player.capture(
                (values[0] + self._counted_before_reboot) % 65536, self._clock.machine_s()
            )

    def _image(self) -> list[int]:
        wall_s = self._clock.wall_s()
        if self._faults.active("plc-frozen", wall_s):
            self._frozen = self._frozen or self._fresh_image(wall_s)
            return self._frozen
        self._frozen = None
        return self._fresh_image(wall_s)

    def _fresh_image(self, wall_s: float) -> list[int]:
        scanned_s = wall_s // self._scan_s * self._scan_s
        machine_s = scanned_s * self._clock.scale
        segment = self._player.advance(machine_s)
        step = segment.step
        stopped = (
            step.kind == "dwell"
            and step.signalled
            and not self._faults.active("stop-flicker", scanned_s)
        )
        alarm = step.alarm or self._faults.active("plc-alarm", scanned_s) is not None
        state = (
            _STOPPED * stopped
            | _RUNNING * (bool(step.setup) and not step.alarm)
            | _ALARM * alarm
        )
        if self._lag_s:
            machine_s -= self._lag_s * self._clock.scale
            segment = self._player.span(machine_s, machine_s)[0]
        shown_mm = self._shown_mm(segment, machine_s, round(scanned_s / self._scan_s))
        count = (segment.stop_count - self._counted_before_reboot) % 65536
        setup = register_of(step.setup) if step.setup else 0
        words = [int(scanned_s / _HEARTBEAT_S) % 65536, count, state, setup]
        for position_mm in shown_mm:
            words += self._long(round(float(position_mm) * 1e4))
        return words + self._air(machine_s)

    def _shown_mm(self, segment: Segment, machine_s: float, scan: int) -> Array:
        """Return the values of the position registers in one scan of the PLC, shape (3,)."""
        done = self._drive.fraction(
            segment.distance_mm, np.array([machine_s - segment.start_s])
        )[0]
        commanded_mm = segment.from_mm + done * (segment.to_mm - segment.from_mm)
        servo_um = segment.servo_um[0] + done * (segment.servo_um[1] - segment.servo_um[0])
        rng = np.random.default_rng((self._seed, scan))
        shown: Array = self._registers.shown_mm(commanded_mm[None], servo_um[None], rng)[0]
        return shown

    def _long(self, value: int) -> list[int]:
        abcd = struct.pack(">i", value)
        return list(struct.unpack(">HH", bytes(abcd[place] for place in self._order)))

    def _air(self, machine_s: float) -> list[int]:
        hall, now = self._environment, np.array([machine_s])
        courses = {
            "material_temperature_c": (hall.material_c, 100.0),
            "air_temperature_c": (hall.air_c, 100.0),
            "air_pressure_hpa": (hall.pressure_hpa, 10.0),
            "relative_humidity_percent": (hall.humidity_percent, 10.0),
        }
        broken = self._faults.active("plc-sensor", self._clock.wall_s())
        values = {
            name: broken.value
            if broken and broken.text in ("", name)
            else float(course.at(now)[0])
            for name, (course, _) in courses.items()
        }
        return [round(values[name] * scale) & 0xFFFF for name, (_, scale) in courses.items()]


def _slice(values: list[int], first: int, count: int) -> list[int]:
    if first < 0 or first + count > len(values):
        raise ModbusError(ILLEGAL_ADDRESS)
    return values[first : first + count]
