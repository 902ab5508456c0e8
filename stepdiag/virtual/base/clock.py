"""The two times of the bench: wall seconds since its start, and machine seconds, which may pass
faster.
"""

import time
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Clock:
    """The clock of the bench: ``scale`` machine seconds pass in one wall second, so a survey of
    hours becomes a demonstration of seconds.
    """

    scale: float = 1.0
    started_s: float = field(default_factory=time.monotonic)

    def wall_s(self) -> float:
        """Return the wall seconds since the start of the bench."""
        return time.monotonic() - self.started_s

    def machine_s(self) -> float:
        """Return the machine seconds since the start of the bench."""
        return self.wall_s() * self.scale
