"""A window of readings against itself: a step in it, one value repeated, more samples thrown away than noise explains."""

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Message, message
from stepdiag.daq.capture.standing.window import Window, inliers

BLOCKS = 32
LEAST_BLOCKS = 8
NEAR = 3
"""A step is sharp: the blocks right beside it differ by most of it. What creeps is a drift."""
SHARP = 0.7
LEAST_STEP_UM = 0.5
STEP_SIGMAS = 5.0
UNLIKE_A_DRIFT = 0.35
"""Two levels explain the window if they leave at most so much of the squares that a straight line leaves."""
WRONG_LINES = 3
WRONG_SHARE = 0.01
"""Single wrong lines are thrown away without a word; more than so many, and so large a share of the window, are no accident."""
RESTLESS_UM = 0.02
"""An instrument that resolves this sees air and floor move: in a machine hall it never sends one value for half a window."""
FROZEN_SHARE = 0.5
FROZEN_SAMPLES = 10
LEAVING_SHARE = 0.1
"""A PLC says up to one of its scans too long that the machine stands: so large a share of a window's end may show it leave."""
ON_THE_WAY = 0.5
"""Who leaves is first seen nearer than this share of how far he goes: a count that slips is at once where it stays."""


def against_itself(position_mm: NDArray[np.float64], window: Window, resolution_um: float) -> list[Message]:
    """Return whatever makes a window doubtful by itself; nothing for a quiet one.

    ``position_mm`` (n,) are its samples in order of time, those left out of the mean included; ``resolution_um`` is the least step that the
    instrument has shown.
    """
    count, same = len(position_mm), _longest_run(position_mm)
    if resolution_um <= RESTLESS_UM and same >= max(FROZEN_SAMPLES, FROZEN_SHARE * count):
        return [message("laser-frozen", same=same, count=count)]
    if step_um := step_in_um(position_mm):
        return [message("window-step", step_um=step_um)]
    wrong = window.rejected - _leaving(position_mm)
    if wrong > WRONG_LINES + WRONG_SHARE * count:
        return [message("window-step.strays", wrong=wrong, count=count)]
    return []


def _leaving(position_mm: NDArray[np.float64]) -> int:
    """Return how many samples at the end of a window are those of a machine that drives on, and may stand elsewhere by then.

    It passes what lies between, where a count that slips jumps.
    """
    away_um = (position_mm - np.median(position_mm)) * 1e3
    staying = np.flatnonzero(inliers(away_um) | (np.sign(away_um) != np.sign(away_um[-1])))
    gone_um = np.abs(away_um[staying[-1] + 1 :])
    drives = bool(np.any(gone_um) and gone_um[0] < ON_THE_WAY * np.max(gone_um))
    return len(gone_um) if drives and len(gone_um) <= LEAVING_SHARE * len(away_um) else 0


def step_in_um(position_mm: NDArray[np.float64]) -> float:
    """Return the size of the step between two levels in a window, in um; 0 where it has none."""
    size = -(-len(position_mm) // BLOCKS)
    count = len(position_mm) // size
    if count < LEAST_BLOCKS:
        return 0.0
    blocks = np.median(position_mm[: size * count].reshape(count, size), axis=1) * 1e3
    at = _best_split(blocks)
    before, after = float(np.median(blocks[:at])), float(np.median(blocks[at:]))
    rest = blocks - np.where(np.arange(count) < at, before, after)
    sharp = float(np.median(blocks[at : at + NEAR]) - np.median(blocks[max(0, at - NEAR) : at]))
    step = after - before
    seen = abs(step) > max(LEAST_STEP_UM, STEP_SIGMAS * float(np.std(rest)))
    two_levels = float(rest @ rest) < UNLIKE_A_DRIFT * _squares_of_a_line(blocks)
    return step if seen and two_levels and abs(sharp) > SHARP * abs(step) else 0.0


def _best_split(blocks: NDArray[np.float64]) -> int:
    """Return where a window is best cut in two levels, by least squares; not in its first or last eighth."""
    count = len(blocks)
    first = np.arange(1, count)
    total = np.cumsum(blocks)
    means_apart = (total[-1] - total[:-1]) / (count - first) - total[:-1] / first
    gain = first * (count - first) / count * means_apart**2
    edge = max(2, count // 8)
    return int(np.argmax(gain[edge - 1 : count - edge])) + edge


def _squares_of_a_line(blocks: NDArray[np.float64]) -> float:
    number = np.arange(len(blocks))
    at = number - np.mean(number)
    off = blocks - np.mean(blocks)
    left = off - (at @ off) / (at @ at) * at
    return float(left @ left)


def _longest_run(position_mm: NDArray[np.float64]) -> int:
    """Return how often one value came in a row at most."""
    changes = np.flatnonzero(np.diff(position_mm))
    edges = np.concatenate(([-1], changes, [len(position_mm) - 1]))
    return int(np.max(np.diff(edges))) if len(position_mm) else 0
