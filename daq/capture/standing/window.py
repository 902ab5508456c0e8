"""The mean of a standing laser's samples, its uncertainty, and the reasons to doubt a window from
its own samples; and the machine's standstills by the laser alone.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.ma  # np.unique needs this module; it is loaded here, not at the first stop
from numpy import fft
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from stepdiag.base.messages import Message, message
from stepdiag.daq.capture.noise import LEAST_SAMPLES, MAJORITY, SERIES, SIGMAS
from stepdiag.daq.timing.stream import Break, Span

BLOCKS = 256
"""Number of block means from which the autocorrelation is estimated, so that a window of any length
has the same cost.
"""
STEP_BLOCKS = 32
"""Largest number of blocks in which steps and slow noise are searched."""
RESOLUTION_FLOOR_UM = 0.002
"""Least uncertainty in um for a window of equal samples, whose standard deviation is zero: the
finest known instruments have steps of one or two nanometres.
"""
MAD_TO_SIGMA = 1.4826
BIN_NS = 20_000_000
EDGE_NS = 2 * BIN_NS
"""Time in ns at the end of a plateau that may contain the beginning of the move."""
QUIET_UM = 3.0
"""Limit in um of the difference between neighbouring 20 ms means of a standing machine; at the
slowest feed in use (10 mm/min) a machine moves 3.3 um in 20 ms.
"""


class Placing(Protocol):
    """The stream that determines the window of a stop: the laser's stream, or
    `daq.capture.head_stop.QdView` in a run of the 4-DOF head.
    """

    @property
    def breaks(self) -> list[Break]: ...
    @property
    def resolution_um(self) -> float: ...

    def newest_ns(self) -> float: ...
    def span(
        self, from_ns: float, to_ns: float, arrived_before_ns: float = math.inf
    ) -> Span: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Statistics of the samples of a stop.

    ``u_um`` is the standard uncertainty of the mean, autocorrelation and resolution included;
    ``scatter_um`` is the standard deviation of the samples; ``slope_um_s`` is the trend, and
    ``u_slope_um_s`` the trend's standard uncertainty.
    """

    mean_mm: float
    u_um: float
    scatter_um: float
    slope_um_s: float
    u_slope_um_s: float
    used: int
    rejected: int
    duration_s: float


def summarise(
    time_s: NDArray[np.float64],
    position_mm: NDArray[np.float64],
    resolution_um: float = RESOLUTION_FLOOR_UM,
) -> Window:
    """Return the statistics of samples ``position_mm`` taken at ``time_s`` (seconds, ascending),
    both of shape (n,), n at least 1.

    ``resolution_um`` is the smallest known step of the instrument, used as the uncertainty of equal
    samples. Samples further than five robust standard deviations from the median are left out:
    single wrong lines must not change the reading of a stop.
    """
    centre = float(np.median(position_mm))
    deviation_um = (position_mm - centre) * 1e3
    keep = inliers(deviation_um)
    values, times = deviation_um[keep], time_s[keep]
    mean = float(np.mean(values))
    scatter = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    slope, u_slope = _trend(times, values)
    inflation = _variance_inflation(values - mean)
    resolution = (
        _resolution_um(values)
        if np.ptp(values) > 0.0
        else max(resolution_um, RESOLUTION_FLOOR_UM)
    )
    return Window(
        mean_mm=centre + mean * 1e-3,
        u_um=float(
            np.hypot(scatter * np.sqrt(inflation / len(values)), resolution / np.sqrt(12.0))
        ),
        scatter_um=scatter,
        slope_um_s=slope,
        u_slope_um_s=u_slope,
        used=len(values),
        rejected=len(deviation_um) - len(values),
        duration_s=float(time_s[-1] - time_s[0]),
    )


def inliers(deviation_um: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return a mask of the samples without outliers, shape (n,), from their deviations from the
    median.
    """
    robust = MAD_TO_SIGMA * float(np.median(np.abs(deviation_um)))
    floor = max(robust, _resolution_um(deviation_um))
    keep: NDArray[np.bool_] = np.abs(deviation_um) <= SIGMAS * floor
    return keep


def _resolution_um(values: NDArray[np.float64]) -> float:
    """Return the smallest step in um between different values, which estimates the resolution of
    the instrument.
    """
    steps = np.diff(np.unique(values))
    steps = steps[steps > RESOLUTION_FLOOR_UM]
    if len(steps) == 0 or len(steps) > BLOCKS:
        return RESOLUTION_FLOOR_UM
    return float(np.min(steps))


def _trend(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the least-squares slope of values per second, and its standard uncertainty with the
    correlation of the samples.
    """
    if len(values) < LEAST_SAMPLES:
        return 0.0, 0.0
    centred = time_s - np.mean(time_s)
    spread = float(centred @ centred)
    if spread <= 0.0:
        return 0.0, 0.0
    slope = float(centred @ values) / spread
    residual = values - np.mean(values) - slope * centred
    variance = residual @ residual / (len(values) - 2) / spread
    return slope, float(np.sqrt(variance * _variance_inflation(residual)))


def sigmas_of_trend(position_mm: NDArray[np.float64], window: Window, um_s: float) -> float:
    """Return the part ``um_s`` of a window's trend in standard deviations (`sigmas`) of the
    window's own noise. The noise consists of the trend's uncertainty and of slow changes of the
    readings after subtraction of the trend.
    """
    blocks = _blocks(position_mm * 1e3)
    trend_um = window.slope_um_s * window.duration_s * np.linspace(0.0, 1.0, len(blocks))
    slow_um_s = _wander_um(blocks - trend_um) / max(window.duration_s, 1e-9)
    return sigmas(um_s, math.hypot(window.u_slope_um_s, slow_um_s), len(blocks))


def _blocks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the middle values of the at most `STEP_BLOCKS` blocks of a window. In a block with an
    even number of values the upper middle value is used: the mean of the two middle values would
    lie between the levels of a step.
    """
    size = -(-len(values) // STEP_BLOCKS)
    count = len(values) // size
    middle = size // 2
    blocks: NDArray[np.float64] = np.partition(
        values[: size * count].reshape(count, size), middle, axis=1
    )[:, middle]
    return blocks


def _wander_um(rest: NDArray[np.float64]) -> float:
    """Return the root mean square of the change between neighbouring parts of a window; 0 if there
    are too few blocks. A part is the median of `LEAST_SAMPLES` blocks.

    This change contains the slow noise, which the scatter of single values does not show.
    """
    if len(rest) < 2 * LEAST_SAMPLES:
        return 0.0
    parts = np.median(sliding_window_view(rest, LEAST_SAMPLES), axis=1)
    changes = parts[LEAST_SAMPLES:] - parts[:-LEAST_SAMPLES]
    return float(np.sqrt(np.mean(changes**2)))


def sigmas(size: float, noise: float, count: int) -> float:
    """Return ``size`` in standard deviations of a noise that is estimated from ``count`` values:
    the root of twice the logarithm of the likelihood ratio of the hypotheses with and without this
    size.

    The noise of few values is uncertain: with eight values, eleven times the estimated noise is
    five standard deviations.
    """
    if count < LEAST_SAMPLES:
        return 0.0
    if noise <= 0.0:
        return math.inf
    return math.sqrt(count * math.log1p((size / noise) ** 2 / (count - 2)))


def _variance_inflation(residual: NDArray[np.float64]) -> float:
    """Return the factor (at least 1) by which the correlation of the samples raises the variance of
    their mean.

    The factor comes from the initial positive sequence of the autocorrelation of block means (Geyer
    1992): vibration and slow air make neighbouring samples similar, and similar samples count as
    fewer.
    """
    size = max(1, len(residual) // BLOCKS)
    count = len(residual) // size
    variance = float(np.mean(residual**2))
    if count < SERIES:
        return 1.0
    blocks = residual[: size * count].reshape(count, size).mean(axis=1)
    spectrum = np.abs(fft.rfft(blocks, 2 * count)) ** 2
    covariance = fft.irfft(spectrum)[:count] / count
    if covariance[0] <= 0.0:
        return 1.0
    pairs = covariance[1 : count - 1 : 2] + covariance[2:count:2]
    positive = int(np.argmax(pairs <= 0.0)) if np.any(pairs <= 0.0) else len(pairs)
    total = covariance[0] + 2.0 * float(np.sum(pairs[:positive]))
    return max(1.0, float(total) * size / variance)


@dataclass(frozen=True, slots=True)
class Plateau:
    """A stretch of quiet readings: its bounds, its level, and its number where the marker input of
    the instrument counts the standstills.
    """

    from_ns: float
    to_ns: float
    level_mm: float
    count: int | None = None


def find_plateaus(
    time_ns: NDArray[np.float64], position_mm: NDArray[np.float64], at_least_s: float
) -> list[Plateau]:
    """Return the plateaus that last at least ``at_least_s``, in order of time. ``time_ns`` and
    ``position_mm`` have shape (n,), times ascending.
    """
    if not len(time_ns):
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
            plateaus.append(
                Plateau(from_ns, to_ns, float(np.median(levels[begin : end + 1])))
            )
    return plateaus


LEAST_STEP_UM = 0.5
"""Smallest step in um that is reported: smaller steps are within the repeatability of an ordinary
machine.
"""
WRONG_SHARE = 0.01
"""Largest share of wrong lines in a window that may be accidental, in addition to `LEAST_SAMPLES`
wrong lines.
"""
RESTLESS_UM = 0.02
"""Resolution in um of an instrument that records the movements of air and floor: in a machine hall
such an instrument never sends one constant value for half a window.
"""
LEAVING_SHARE = 0.1
"""Share of the samples of a standstill that may be from a move: a PLC reports the standstill for up
to a scan too long.
"""


def against_itself(
    position_mm: NDArray[np.float64], window: Window, resolution_um: float
) -> list[Message]:
    """Return every reason in the samples to doubt a window; empty for a quiet window.

    ``position_mm`` (n,) are the samples of the window in order of time, including the outliers;
    ``resolution_um`` is the smallest step of the instrument until now.
    """
    count = len(position_mm)
    if resolution_um <= RESTLESS_UM:
        same = _longest_run(position_mm)
        if same >= max(SERIES, MAJORITY * count):
            return [message("laser-frozen", same=same, count=count)]
    if step_um := step_in_um(position_mm):
        return [message("window-step", step_um=step_um)]
    wrong = strays(position_mm, window)
    return [message("window-step.strays", wrong=wrong, count=count)] if wrong else []


def strays(position_mm: NDArray[np.float64], window: Window) -> int:
    """Return the number of outliers of a window; 0 if the outliers may be accidental, or if the
    machine leaves the stop in these samples.
    """
    wrong, accidents = window.rejected, LEAST_SAMPLES + WRONG_SHARE * len(position_mm)
    wrong -= _leaving(position_mm) if wrong > accidents else 0
    return wrong if wrong > accidents else 0


def on_the_way(position_mm: NDArray[np.float64]) -> bool:
    """Return whether the outliers of a window lie on a move to the window's level. After a slip of
    the count, the outliers have a common level instead.
    """
    away_um = (position_mm - np.median(position_mm)) * 1e3
    away_um = away_um[~inliers(away_um)]
    return len(away_um) > 0 and bool(np.ptp(away_um) > MAJORITY * np.max(np.abs(away_um)))


def _leaving(position_mm: NDArray[np.float64]) -> int:
    """Return the number of samples at the end of a window that show the machine leaving the stop.

    A moving machine passes all positions between its stops; a slip of the count is a jump.
    """
    away_um = (position_mm - np.median(position_mm)) * 1e3
    staying = np.flatnonzero(inliers(away_um) | (np.sign(away_um) != np.sign(away_um[-1])))
    gone_um = np.abs(away_um[staying[-1] + 1 :])
    drives = bool(np.any(gone_um) and gone_um[0] < MAJORITY * np.max(gone_um))
    return len(gone_um) if drives and len(gone_um) <= LEAVING_SHARE * len(away_um) else 0


def step_in_um(position_mm: NDArray[np.float64]) -> float:
    """Return the size of the step between two levels in a window, in um; 0 without a step."""
    return find_step(position_mm)[0]


def find_step(position_mm: NDArray[np.float64]) -> tuple[float, float]:
    """Return the size of the step between two levels in a window, in um and in standard deviations
    (`sigmas`); 0 without a step.

    A step is sharp: more than half of the change happens between neighbouring blocks. Two levels
    must fit the window better than a straight line, with less than half of the sum of squared
    residuals. Any other change is a drift. The noise of a step has two parts, both from this
    window: the scatter around the two levels, and the slow noise.
    """
    blocks = _blocks(position_mm * 1e3)
    count = len(blocks)
    if count < SERIES:
        return 0.0, 0.0
    at = _best_split(blocks)
    before, after = float(np.median(blocks[:at])), float(np.median(blocks[at:]))
    step = after - before
    if abs(step) <= LEAST_STEP_UM:
        return 0.0, 0.0
    rest = blocks - np.where(np.arange(count) < at, before, after)
    sharp = abs(
        float(
            np.median(blocks[at : at + LEAST_SAMPLES])
            - np.median(blocks[max(0, at - LEAST_SAMPLES) : at])
        )
    )
    two_levels = float(rest @ rest) < MAJORITY * _squares_of_a_line(blocks)
    scatter_um, wander_um = float(np.std(rest)), _wander_um(rest)
    found = sharp > SIGMAS * max(scatter_um, wander_um) and sharp > MAJORITY * abs(step)
    if not (found and two_levels):
        return 0.0, 0.0
    noise_um = max(math.hypot(scatter_um, wander_um), RESOLUTION_FLOOR_UM)
    return step, sigmas(sharp, noise_um, count)


def _best_split(blocks: NDArray[np.float64]) -> int:
    """Return the index of the block at which two levels fit a window best, by least squares; not in
    the first or last eighth.
    """
    count = len(blocks)
    first = np.arange(1, count)
    total = np.cumsum(blocks)
    means_apart = (total[-1] - total[:-1]) / (count - first) - total[:-1] / first
    gain = first * (count - first) / count * means_apart**2
    edge = max(2, count // SERIES)
    return int(np.argmax(gain[edge - 1 : count - edge])) + edge


def _squares_of_a_line(blocks: NDArray[np.float64]) -> float:
    number = np.arange(len(blocks))
    at = number - np.mean(number)
    off = blocks - np.mean(blocks)
    left = off - (at @ off) / (at @ at) * at
    return float(left @ left)


def _longest_run(position_mm: NDArray[np.float64]) -> int:
    changes = np.flatnonzero(np.diff(position_mm))
    edges = np.concatenate(([-1], changes, [len(position_mm) - 1]))
    return int(np.max(np.diff(edges))) if len(position_mm) else 0
