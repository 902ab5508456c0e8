"""Growth of a machine's axes while the machine warms up."""

from dataclasses import dataclass

import numpy as np

from stepdiag.virtual.physics.error_functions import Array

Three = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth:
    """The growth of the axes: each axis lengthens from its fixed bearing by ``um_m * (1 - exp(-(t +
    begun_s) / tau_s))``.

    ``um_m`` is the final growth in um per metre of travel, ``bearing_mm`` the machine coordinate of
    the fixed bearing of each axis, ``begun_s`` the running time of the machine at machine time
    zero.
    """

    um_m: Three
    bearing_mm: Three = (0.0, 0.0, 0.0)
    tau_s: float = 3600.0
    begun_s: float = 0.0

    def share(self, time_s: Array) -> Array:
        """Return the reached share of the final growth at each time, 0 to 1, shape like
        ``time_s``."""
        running_s = np.maximum(np.asarray(time_s, dtype=np.float64) + self.begun_s, 0.0)
        grown: Array = -np.expm1(-running_s / self.tau_s)
        return grown

    def displacement_um(self, axis: int, position_mm: Array, share: Array) -> Array:
        """Return the displacement of carriage ``axis`` along its axis by the growth, at positions
        (N,), shape (N,)."""
        moved: Array = (
            self.um_m[axis] * share * (np.asarray(position_mm) - self.bearing_mm[axis]) * 1e-3
        )
        return moved
