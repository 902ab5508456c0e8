"""From which side the machine came to a stop, as the laser saw it come.

A stop there and one back at the same place differ by the reversal value. Position registers say the place alone; a counter that follows
its stops says the direction as well. Where there is none, a stop of the way back looks like one of the way out.
"""

import numpy as np

from stepdiag.daq.capture.standing.certain_window import Placing, Taken

LOOK_BACK_NS = 5_000_000_000
AWAY_MM = 0.2
"""Who is further away is on the way: no machine swings so far, and no drive overshoots by it."""
AWAY_SHARE = 0.25
"""Of a step that is shorter, so much."""
LEAST_AWAY_MM = 0.02
"""A standing machine may be so far off while it comes to rest; of shorter steps nothing is said."""
IN_A_ROW = 3
"""Single wrong lines are no move."""


def came_along(stream: Placing, taken: Taken, begin_ns: float, step_mm: float) -> bool | None:
    """Tell whether the machine came to a standstill from where a step of the pass begins, not from beyond.

    The standstill begins at ``begin_ns`` and reads what was ``taken``; ``step_mm`` is what the step to it should read. None where nobody
    saw: too short a step, no samples, a count that may have been lost on the way.
    """
    away_mm = min(AWAY_MM, AWAY_SHARE * abs(step_mm))
    if away_mm < LEAST_AWAY_MM:
        return None
    span = stream.span(begin_ns - LOOK_BACK_NS, begin_ns)
    off_mm = (span.position_mm - taken.window.mean_mm) * np.sign(step_mm)
    sides = np.sign(np.where(np.abs(off_mm) > away_mm, off_mm, 0.0))
    in_a_row = np.convolve(sides, np.ones(IN_A_ROW), mode="valid") if len(sides) >= IN_A_ROW else sides[:0]
    away = np.flatnonzero(np.abs(in_a_row) == IN_A_ROW)
    if not len(away) or any(span.time_ns[away[-1]] <= each.time_ns <= taken.to_ns for each in stream.breaks):
        return None
    return bool(in_a_row[away[-1]] < 0.0)
