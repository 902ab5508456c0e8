"""The newest readings of an instrument at full rate for display: lowest and highest sample of every
short bin.
"""

from collections import deque

import numpy as np

from stepdiag.daq.timing.samples import Samples
from stepdiag.daq.timing.stream import StreamBuffer

BIN_S = 0.02
KEEP_BINS = 75
"""Number of stored bins (1.5 s): a page that misses one or two updates still receives every bin."""
_BIN_NS = round(BIN_S * 1e9)
_KEEP_NS = KEEP_BINS * _BIN_NS


class Strip:
    """Sorts the samples of a stream into bins of time. ``bins`` has the number, lowest and highest
    reading of each bin; the readings are NaN if all samples of the bin are NaN.
    """

    def __init__(self) -> None:
        self.bins: deque[tuple[int, float, float]] = deque(maxlen=KEEP_BINS)
        self._newest_ns = 0

    def follow(self, stream: StreamBuffer) -> None:
        """Add the new samples of the stream. Samples older than the stored bins are skipped."""
        fresh = stream.since(self._newest_ns)
        ends_ns = [int(batch.arrival_ns[-1]) for batch in fresh]
        kept_ns = ends_ns[-1] - _KEEP_NS if fresh else 0
        for batch, end_ns in zip(fresh, ends_ns, strict=True):
            if end_ns < kept_ns:
                self._newest_ns = end_ns
            else:
                self.add(batch)

    def add(self, batch: Samples) -> None:
        """Add a batch; its samples are spread evenly over the time since the previous batch."""
        if not len(batch) or int(batch.arrival_ns[-1]) <= self._newest_ns:
            return
        end = int(batch.arrival_ns[-1])
        begin = max(self._newest_ns, end - _KEEP_NS) if self._newest_ns else end - _BIN_NS
        number = np.linspace(begin, end, len(batch) + 1)[1:].astype(np.int64) // _BIN_NS
        self._newest_ns = end
        edges = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
        lowest, highest = (
            each.reduceat(batch.position_mm, edges).tolist() for each in (np.fmin, np.fmax)
        )
        for at, low, high in zip(number[edges].tolist(), lowest, highest, strict=True):
            self._put(at, low, high)

    def _put(self, number: int, low: float, high: float) -> None:
        if self.bins and self.bins[-1][0] == number:
            _, before, above = self.bins.pop()
            low, high = float(np.fmin(low, before)), float(np.fmax(high, above))
        self.bins.append((number, low, high))
