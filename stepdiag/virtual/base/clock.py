"""The bench's two times: wall seconds since its start, and machine seconds that may run faster."""

import time
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Clock:
    """``scale`` machine seconds pass in one wall second: a survey of hours becomes a demonstration
    of seconds."""

    scale: float = 1.0
    started_s: float = field(default_factory=time.monotonic)

    def wall_s(self) -> float:
        """Return the wall seconds since the start."""
        return time.monotonic() - self.started_s

    def machine_s(self) -> float:
        """Return the machine seconds since the start."""
        return self.wall_s() * self.scale
