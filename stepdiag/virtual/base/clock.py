"""The two times of the bench: wall seconds since its start, and machine seconds, which can pass
faster."""

import time
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Clock:
    """The clock of the bench: ``scale`` machine seconds pass in one wall second."""

    scale: float = 1.0
    started_s: float = field(default_factory=time.monotonic)

    def wall_s(self) -> float:
        return time.monotonic() - self.started_s

    def machine_s(self) -> float:
        return self.wall_s() * self.scale
