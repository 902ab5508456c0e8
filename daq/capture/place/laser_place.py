"""Where the laser's count says that the machine stands: a control that gives no position is placed by what was read before.

While the count is unbroken every stop has its reading. It tells a pass that was driven again from one that goes on, a stop that was
missed from one that was counted twice, and a feed hold from a stop.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from stepdiag.daq.capture.place.route import Route, agrees

NEAR = 0.25
"""A reading belongs to a stop if it is off by less than this share of the way to the next stop."""
SCALE = 0.002
"""By so much may machine and mirror be off over a way that was not driven yet."""


class LaserPlaces:
    """What the unbroken count says of the stops of a route: readings in mm by stop."""

    def __init__(self, route: Route, known: Mapping[int, float]) -> None:
        self._route = route
        self._gaps_mm = _gaps_mm(route)
        self.known = dict(known)
        self._nowhere: list[float] = []

    def stop_at(self, reading_mm: float) -> int | None:
        """Return the stop that reads so; None where it is the reading of no stop, or too far from any that was measured."""
        if not self.known:
            return None
        measured = np.array(sorted(self.known))
        stops = np.arange(len(self._route))
        anchor = measured[np.argmin(np.abs(stops[:, None] - measured), axis=1)]
        steps = self._route.nominal_mm - self._route.nominal_mm[anchor]
        off = np.abs(reading_mm - np.array([self.known[int(stop)] for stop in anchor]) - steps)
        best = int(np.argmin(off))
        sure = SCALE * abs(steps[best]) <= NEAR * self._gaps_mm[best]
        return best if sure and off[best] <= NEAR * self._gaps_mm[best] else None

    def take(self, stop: int, reading_mm: float | None, *, anew: bool) -> None:
        """Take the reading of a stop; ``anew``: the count was lost, nothing from before holds."""
        if anew:
            self.known = {}
        self._nowhere = []
        if reading_mm is not None:
            self.known[stop] = reading_mm

    def lost(self) -> None:
        """Forget everything: the count does not reach back."""
        self.known = {}

    def after_nowhere(self, reading_mm: float, expected: int) -> int | None:
        """Return the stop at which the machine stands after standing where no stop is; None where that may have been a feed hold.

        A count that went wrong goes on with the right steps from the wrong place.
        """
        before, self._nowhere = self._nowhere, [*self._nowhere, reading_mm]
        stop = expected + len(before)
        if not before or stop >= len(self._route):
            return None
        return stop if agrees(reading_mm - before[-1], self._route.step_mm(stop - 1, stop)) else None


def _gaps_mm(route: Route) -> NDArray[np.float64]:
    """Return the way from each stop to the nearer of its neighbours, as the laser counts it."""
    steps = np.abs(np.diff(route.nominal_mm))
    gaps: NDArray[np.float64] = np.minimum(np.append(steps, np.inf), np.insert(steps, 0, np.inf))
    return gaps
