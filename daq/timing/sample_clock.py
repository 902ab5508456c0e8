"""From arrival times to sample times.

The samples of an instrument are evenly spaced; their arrivals are not. An arrival is the time of
the sample plus a delay with a fixed minimum. So the line below all points (counter, arrival) is the
clock of the instrument, late by the minimum delay. A least-squares line would be late by the mean
delay, which is ten milliseconds behind a 16 ms USB timer. The line touches the lower convex hull of
the points (Graham scan) at the mean counter.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BIN_NS = 250_000_000
"""Interval in ns in which only the arrival with the least delay is stored as a point."""
MEMORY_BINS = 480
"""Number of stored points, two minutes: long compared with the jitter, short compared with the
thermal drift of a quartz.
"""
FREE_SLOPE_SPAN_NS = 10_000_000_000
"""Least span of the points in ns for a measured rate: over a shorter span the rate from the
instrument is more accurate than the slope of the points.
"""
WRONG_RATE_NS, WRONG_RATE_SHARE = 500_000_000, 0.2
"""Largest possible delay (ns) and largest possible error of a quartz (share): a rate that the
arrivals contradict by more than both is not the rate of the instrument.
"""
SKIP_BINS = 8
"""Number of newest points (two seconds) that show a skip: if all these points are late by most of a
sample period, samples were skipped without notice. Jitter does not delay all points.
"""


@dataclass(frozen=True, slots=True)
class Line:
    """``time = origin_ns + period_ns * (counter - origin_counter)``."""

    origin_counter: int
    origin_ns: float
    period_ns: float

    def at(self, counter: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the times of samples in ns of the host's clock, shape like ``counter``."""
        times: NDArray[np.float64] = self.origin_ns + self.period_ns * (
            counter - self.origin_counter
        ).astype(np.float64)
        return times


def lower_line(
    counters: NDArray[np.float64], arrivals: NDArray[np.float64]
) -> tuple[float, float]:
    """Return (offset, slope) of the line below all points with the least mean distance to the
    points.

    The line is the edge of the lower convex hull below the mean counter. At least two points are
    needed, with ascending counters.
    """
    hull: list[int] = []
    for index in range(len(counters)):
        while len(hull) > 1 and _turns_up(counters, arrivals, hull[-2], hull[-1], index):
            hull.pop()
        hull.append(index)
    mean = float(np.mean(counters))
    right = min(int(np.searchsorted(counters[hull], mean, side="right")), len(hull) - 1)
    a, b = hull[right - 1], hull[right]
    slope = (arrivals[b] - arrivals[a]) / (counters[b] - counters[a])
    return float(arrivals[a] - slope * counters[a]), float(slope)


def _turns_up(x: NDArray[np.float64], y: NDArray[np.float64], a: int, b: int, c: int) -> bool:
    return bool((y[b] - y[a]) * (x[c] - x[a]) >= (y[c] - y[a]) * (x[b] - x[a]))


class SampleClock:
    """The clock of one segment of a stream. A segment has no gap of unknown length and no change of
    rate.

    ``rate_hz`` is the rate from the instrument or its data sheet (None: unknown); the rate is used
    while the arrivals do not contradict it. ``latency_s`` is the known delay inside the instrument.
    ``gaps_visible`` means that the counter of the instrument also counts lost samples; if False,
    the clock detects samples that were skipped without notice.
    """

    def __init__(
        self, rate_hz: float | None, latency_s: float = 0.0, *, gaps_visible: bool = True
    ) -> None:
        self._latency_ns = latency_s * 1e9
        self._gaps_visible = gaps_visible
        self._points: deque[tuple[int, int]] = deque(maxlen=MEMORY_BINS)
        self._bin = -1
        self._line: Line | None = None
        self._period_ns = 1e9 / rate_hz if rate_hz else None

    def add(self, counter: int, arrival_ns: int) -> bool:
        """Add the last sample of a chunk. Return False if samples were skipped without notice; the
        earlier points are then discarded.
        """
        if self._points and counter <= self._points[-1][0]:
            return True
        number = arrival_ns // BIN_NS
        if number != self._bin or not self._points:
            self._bin = number
            self._points.append((counter, arrival_ns))
            self._line = None
            return not self._skipped()
        if self._delay(counter, arrival_ns) < self._delay(*self._points[-1]):
            self._points[-1] = (counter, arrival_ns)
            self._line = None
        return True

    def times_ns(self, counter: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the times of samples in ns, shape like ``counter``. The clock needs at least one
        point.
        """
        return self.line().at(counter)

    def line(self) -> Line:
        if self._line is None:
            self._line = self._fit(list(self._points))
        return self._line

    def _delay(self, counter: int, arrival_ns: int) -> float:
        """Return the delay of an arrival in ns, up to a constant that is the same for all
        arrivals.
        """
        first_counter, first_ns = self._points[0]
        return (arrival_ns - first_ns) - self._period() * (counter - first_counter)

    def _period(self) -> float:
        (first_counter, first_ns), (last_counter, last_ns) = self._points[0], self._points[-1]
        count, passed_ns = max(last_counter - first_counter, 1), last_ns - first_ns
        if self._period_ns is not None:
            off_ns = abs(passed_ns - self._period_ns * count)
            if off_ns <= max(WRONG_RATE_NS, WRONG_RATE_SHARE * passed_ns):
                return self._period_ns
        return passed_ns / count

    def _fit(self, points: list[tuple[int, int]]) -> Line:
        origin_counter, origin_ns = points[0]
        counters = np.array([point[0] - origin_counter for point in points], dtype=np.float64)
        arrivals = np.array([point[1] - origin_ns for point in points], dtype=np.float64)
        free = arrivals[-1] > FREE_SLOPE_SPAN_NS or self._period() != self._period_ns
        if free and len(points) > 1:
            offset, slope = lower_line(counters, arrivals)
        else:
            slope = self._period()
            offset = float(np.min(arrivals - slope * counters))
        return Line(origin_counter, origin_ns + offset - self._latency_ns, slope)

    def _skipped(self) -> bool:
        """Return whether the points of the last two seconds are all late by most of a sample
        period; if so, discard the earlier points.

        If an instrument drops a sample that its counter does not count, every later sample is late
        by one period.
        """
        if self._gaps_visible or self._period_ns is None or len(self._points) < 3 * SKIP_BINS:
            return False
        points = list(self._points)
        line = self._fit(points[:-SKIP_BINS])
        late = [
            arrival - line.at(np.array([counter]))[0] - self._latency_ns
            for counter, arrival in points[-SKIP_BINS:]
        ]
        if min(late) < 0.8 * self._period_ns:
            return False
        self._points = deque(points[-SKIP_BINS:], maxlen=MEMORY_BINS)
        self._line = None
        return True
