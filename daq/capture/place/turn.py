"""Where a pass begins at the stop at which the one before it ended: whether the machine went beyond it, to come to it from the other side.

Who turns round at a stop comes to it once. What it reads there holds for both passes, with the backlash of the way there; and on the way
back every axis keeps the side of the way there until it moves.
"""

import numpy as np

from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.standing.dwell import IN_A_ROW, STILL_MM
from stepdiag.daq.timing.stream import StreamBuffer

CLOSE_NS = 30_000_000
"""Samples further apart may miss an overrun: 2 mm and back take a quick machine a tenth of a second."""


def watched_closely(laser: StreamBuffer, last: CapturedStop, until_ns: float) -> bool:
    """Tell whether nothing of a move can have escaped the laser since the last stop of a pass was taken, as far as it is in this log."""
    times_ns = laser.span(last.window_to_ns, until_ns).time_ns
    return bool(np.all(np.diff(times_ns) <= CLOSE_NS))


def last_beyond_ns(laser: StreamBuffer, last: CapturedStop, towards: float, until_ns: float) -> float | None:
    """Return when the machine was last seen beyond the last stop of a pass since it was taken; None where it was not.

    ``towards`` has the sign of the reading's change on the way to that stop.
    """
    if last.reading_mm is None:
        return None
    span = laser.span(last.window_to_ns, until_ns)
    off_mm = (span.position_mm - last.reading_mm) * np.sign(towards)
    if len(off_mm) < IN_A_ROW:
        return None
    beyond = np.flatnonzero(np.convolve(off_mm > STILL_MM, np.ones(IN_A_ROW), mode="valid") == IN_A_ROW)
    return float(span.time_ns[beyond[-1] + IN_A_ROW - 1]) if len(beyond) else None
