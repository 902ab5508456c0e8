"""The values of the control's position registers at a stop."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stepdiag.virtual.physics.error_functions import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionRegisters:
    """The position registers of the control at a stop.

    ``shows``: the commanded position, or the actual (encoder) position. ``scatter_um`` is the
    standard deviation of the actual position of a standing axis from reading to reading.
    ``resolution_mm`` is the last digit of a position, 0 without rounding.
    """

    shows: Literal["commanded", "actual"] = "commanded"
    scatter_um: float = 0.0
    resolution_mm: float = 0.0

    def shown_mm(
        self, commanded_mm: Array, servo_um: Array, rng: np.random.Generator
    ) -> Array:
        """Return the register values for commanded positions (N, 3), shape (N, 3)."""
        shown = commanded_mm
        if self.shows == "actual":
            shown = shown + 1e-3 * (
                servo_um + rng.normal(scale=self.scatter_um, size=commanded_mm.shape)
            )
        if self.resolution_mm:
            shown = np.round(shown / self.resolution_mm) * self.resolution_mm
        return shown
