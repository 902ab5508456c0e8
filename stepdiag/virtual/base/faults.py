"""Scripted faults and their times.

    laser     beam-lost, laser-reset, laser-jump (value um), laser-frozen, laser-silent,
              laser-unplug, laser-garbage (value bytes), laser-baud
    head      head-blocked, head-silent, head-unplug, head-garbage (value bytes), head-baud
    air       air-silent, air-unplug, air-garbage (value bytes), air-baud
    PLC       plc-silent, plc-late (value s), plc-exception (value code), plc-frozen,
              plc-reboot (value other than 0: its counter is kept),
              plc-sensor (text name, value), stop-flicker, plc-alarm
    program   stop-skipped, stop-unsignalled, count-missed, count-doubled,
              count-stuck (to the end of its pass), axis-order (text such as "yxz"),
              feed-hold (half way to the stop, its duration in machine seconds),
              dwell-longer (additional machine seconds at the stop),
              program-aborted (value: number of stops to go back before the restart; its
              duration in machine seconds)

A negative value for garbage is a number of lost bytes. A fault occurs once. A fault with a place
(setup, pass or stop) occurs ``delay_s`` after the program reaches this place. Any other fault
occurs ``delay_s`` after the start of the bench.
"""

import threading
from typing import Literal, get_args

import msgspec

ProgramFault = Literal[
    "stop-skipped",
    "stop-unsignalled",
    "count-missed",
    "count-doubled",
    "count-stuck",
    "feed-hold",
    "dwell-longer",
    "axis-order",
    "program-aborted",
]
FaultKind = Literal[
    "beam-lost",
    "laser-reset",
    "laser-jump",
    "laser-frozen",
    "laser-silent",
    "laser-unplug",
    "laser-garbage",
    "laser-baud",
    "head-blocked",
    "head-silent",
    "head-unplug",
    "head-garbage",
    "head-baud",
    "air-silent",
    "air-unplug",
    "air-garbage",
    "air-baud",
    "plc-silent",
    "plc-late",
    "plc-exception",
    "plc-frozen",
    "plc-reboot",
    "plc-sensor",
    "stop-flicker",
    "plc-alarm",
    ProgramFault,
]
PROGRAM = frozenset(get_args(ProgramFault))


class Fault(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A fault. ``setup``, ``pass_number`` and ``stop`` are its place (None: any); its times are
    wall seconds."""

    kind: FaultKind
    setup: str | None = None
    pass_number: int | None = None
    stop: int | None = None
    phase: Literal["dwell", "move"] = "dwell"
    delay_s: float = 0.0
    duration_s: float = 0.5
    value: float = 0.0
    text: str = ""

    @property
    def placed(self) -> bool:
        return not (self.setup is None and self.pass_number is None and self.stop is None)

    def is_at(self, setup: str, pass_number: int, stop: int) -> bool:
        wanted = ((self.setup, setup), (self.pass_number, pass_number), (self.stop, stop))
        return self.placed and all(mine is None or mine == here for mine, here in wanted)


class FaultBoard:
    """Arms faults at their places, and passes the active faults to the devices; thread-safe."""

    def __init__(self, faults: tuple[Fault, ...] = ()) -> None:
        self._lock = threading.Lock()
        self._waiting = [fault for fault in faults if fault.placed]
        self._armed = [(fault.delay_s, fault) for fault in faults if not fault.placed]

    def inject(self, fault: Fault, wall_s: float) -> None:
        """Add a fault. A fault without a place occurs ``delay_s`` after ``wall_s``, a fault with a
        place ``delay_s`` after the program reaches this place."""
        with self._lock:
            if fault.placed:
                self._waiting.append(fault)
            else:
                self._armed.append((wall_s + fault.delay_s, fault))

    def reach(
        self, setup: str, pass_number: int, stop: int, phase: str, wall_s: float
    ) -> None:
        """Arm the faults with this place. Faults of the program are not armed, because the program
        removes these faults by `take`."""
        with self._lock:
            for fault in [
                f
                for f in self._waiting
                if f.kind not in PROGRAM
                and f.phase == phase
                and f.is_at(setup, pass_number, stop)
            ]:
                self._waiting.remove(fault)
                self._armed.append((wall_s + fault.delay_s, fault))

    def take(self, kind: FaultKind, setup: str, pass_number: int, stop: int) -> Fault | None:
        """Remove a fault of the program with this place, and return the fault."""
        with self._lock:
            for fault in self._waiting:
                if fault.kind == kind and fault.is_at(setup, pass_number, stop):
                    self._waiting.remove(fault)
                    return fault
        return None

    def active(self, kind: FaultKind, wall_s: float) -> Fault | None:
        with self._lock:
            for start_s, fault in self._armed:
                if fault.kind == kind and start_s <= wall_s < start_s + fault.duration_s:
                    return fault
        return None

    def spans(self, kind: FaultKind) -> list[tuple[float, float]]:
        """Return start and end of every armed fault of this kind, for devices that process their
        samples in batches."""
        with self._lock:
            return [
                (start_s, start_s + fault.duration_s)
                for start_s, fault in self._armed
                if fault.kind == kind
            ]

    def due(self, kind: FaultKind, wall_s: float) -> list[Fault]:
        """Remove the faults of this kind that occurred up to ``wall_s``, and return these faults.
        This function is for kinds without a duration."""
        with self._lock:
            struck = [
                entry for entry in self._armed if entry[1].kind == kind and entry[0] <= wall_s
            ]
            for entry in struck:
                self._armed.remove(entry)
        return [fault for _, fault in struck]
