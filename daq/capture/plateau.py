"""Where the laser alone says that the machine stood still."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BIN_NS = 20_000_000
QUIET_UM = 3.0
"""Neighbouring 20 ms means of a standing machine differ by less; at the slowest feed in use (10 mm/min) a moving one goes 3.3 um."""


@dataclass(frozen=True, slots=True)
class Plateau:
    """A stretch of quiet readings: its bounds, and its level."""

    from_ns: float
    to_ns: float
    level_mm: float


def find_plateaus(time_ns: NDArray[np.float64], position_mm: NDArray[np.float64], at_least_s: float) -> list[Plateau]:
    """Return the plateaus of at least a duration, in order of time. Both columns have shape (n,), times ascending."""
    if len(time_ns) < 2:
        return []
    bins = ((time_ns - time_ns[0]) // BIN_NS).astype(np.int64)
    filled, first = np.unique(bins, return_index=True)
    levels = np.add.reduceat(position_mm, first) / np.diff(np.append(first, len(position_mm)))
    quiet = (np.abs(np.diff(levels)) * 1e3 < QUIET_UM) & (np.diff(filled) <= 3)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], quiet, [False])).astype(np.int8)))
    starts = time_ns[0] + filled.astype(np.float64) * BIN_NS
    plateaus = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        from_ns, to_ns = float(starts[begin]), float(starts[end] + BIN_NS)
        if to_ns - from_ns >= at_least_s * 1e9:
            plateaus.append(Plateau(from_ns, to_ns, float(np.median(levels[begin : end + 1]))))
    return plateaus
