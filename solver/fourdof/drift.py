"""Drift of the source's pointing during a run, without the noise of the drift detector.

The drift detector PSD1 adds noise, which the lever carries into the straightness: 1.7 urad at 8 m
are 14 um. A source drifts slowly, and a detector's noise has no memory. The model is therefore a
random walk observed with white noise (the local level model; Harvey, Forecasting, Structural Time
Series Models and the Kalman Filter, 1989, sections 2.3 and 4.3). The ratio of the walk's speed to
the noise follows from three sources: the series itself, the noise of each stop within its dwell,
and the quadrant detector. A real drift moves the quadrant detector's spot as well, so correcting it
makes the spot's path smoother. The returned drift is the mean over all likely speeds; its
uncertainty includes the spread between the speeds.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

LEAST_SAMPLES = 5
"""A smaller number of samples does not determine the speed of a drift."""
QUICKEST = 1e4
"""Largest ratio of the variance of the drift's steps to the variance of the noise: beyond it the
detector's values are taken unsmoothed.
"""
SPEEDS = 25
MOST_BENDS = 40
"""Largest number of bends (second differences) of the spot's path that count, even in a longer
series: bends reveal a drift that is left too rough, not the rest of a slow drift.
"""
BENDS_COUNT = 0.1
"""Share of the bends that counts as evidence: bends of a remaining drift are nearly equal at
neighbouring stops. With a share of one half the most likely drift is too smooth: in a pass of 8 m
with 1.7 urad of noise 83 % of the values are within 2 u (10.9 um rms). With a tenth 94 % are (8.6
um), with none 97 % (9.3 um).
"""
BENDS_SHARE = 1.94
"""Factor of the variance of the slope between two series of second differences of white noise:
their correlations are -2/3 and 1/6, so it is 1 + 2 (4/9 + 1/36).
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """The pointing drift and its standard uncertainty, in urad, shapes (N,)."""

    angle_urad: Vector
    u_urad: Vector


def slow_drift(
    time_s: Vector, seen_urad: Vector, u_urad: Vector, spot_um: Vector, lever_mm: Vector
) -> Drift:
    """Return the drift at each time, shapes (N,), from the values ``seen_urad`` of PSD1; times
    ascend.

    ``u_urad`` is the noise of each value by the scatter within its dwell (0: not known).
    ``spot_um`` is half of the quadrant detector's shift, which contains the drift times
    ``lever_mm``. With fewer than `LEAST_SAMPLES` the values are returned unchanged.
    """
    if len(seen_urad) < LEAST_SAMPLES:
        return Drift(angle_urad=seen_urad, u_urad=u_urad)
    step_s = np.diff(time_s)
    usual_s = float(np.mean(step_s)) or 1.0
    # a drift slower than the slowest of these speeds looks like standstill within the run
    speeds = np.geomspace(0.1 / len(seen_urad) ** 2, QUICKEST, SPEEDS)
    found = _smoothed(seen_urad, step_s[:, None] / usual_s * speeds)
    floor = float(np.mean(u_urad**2))
    noise = np.maximum(found.noise, floor)
    # a noise ten times what the dwells show is a hundred times less likely than that
    likely = (
        found.log_likelihood
        - (np.log(noise / floor) if floor > 0.0 else 0.0)
        + _smoothness(spot_um, lever_mm, found.level)
    )
    weight = np.exp(likely - likely.max())
    weight /= weight.sum()
    level = found.level @ weight
    variance = (found.share * noise + (found.level - level[:, None]) ** 2) @ weight
    quick, u_quick = _quick(seen_urad - level, spot_um - 1e-3 * lever_mm * level, lever_mm)
    return Drift(angle_urad=level + quick, u_urad=np.sqrt(variance + u_quick**2))


def _quick(rest_urad: Vector, left_um: Vector, lever_mm: Vector) -> tuple[Vector, Vector]:
    """Return the part of PSD1's fast residual that is real motion of the beam, not noise, and the
    uncertainty of this part, shapes (N,).

    A share g of the residual may be motion of the beam; the second differences of the spot are then
    g times the second differences of the lever times the residual. A regression determines g.
    """
    of_rest, of_spot = np.diff(1e-3 * lever_mm * rest_urad, n=2), np.diff(left_um, n=2)
    power = float(of_rest @ of_rest)
    if power <= 0.0:
        return np.zeros_like(rest_urad), np.zeros_like(rest_urad)
    slope = float(of_rest @ of_spot) / power
    u_slope = min(
        float(np.sqrt(BENDS_SHARE * np.mean((of_spot - slope * of_rest) ** 2) / power)), 1.0
    )
    # before the regression every share from 0 to 1 is equally likely; without evidence from the
    # spot the share is zero
    real = float(np.clip(slope, 0.0, 1.0)) * (1.0 - u_slope)
    open_share = real * (1.0 - real) * float(np.mean(rest_urad**2))
    return real * rest_urad, np.sqrt(open_share + u_slope**2 * rest_urad**2 / 12.0)


@dataclass(frozen=True, slots=True)
class _Smoothed:
    """The drift for every assumed speed: ``level`` and its variance ``share`` relative to the
    noise, shapes (N, speeds); the variance of the noise and the likelihood, shapes (speeds,).
    """

    level: Vector
    share: Vector
    noise: Vector
    log_likelihood: Vector


def _smoothed(seen: Vector, speed: Vector) -> _Smoothed:
    """Return the filtered and smoothed series for a drift whose steps have the variances ``speed``
    (N - 1, speeds), relative to the variance of the noise.
    """
    count = speed.shape[1]
    level, share = np.empty((len(seen), count)), np.empty((len(seen), count))
    ahead = np.empty_like(speed)
    level[0], share[0] = seen[0], 1.0
    squares, logs = np.zeros(count), np.zeros(count)
    for k in range(len(speed)):
        ahead[k] = share[k] + speed[k]
        surprise, width = seen[k + 1] - level[k], ahead[k] + 1.0
        squares += surprise**2 / width
        logs += np.log(width)
        level[k + 1] = level[k] + ahead[k] / width * surprise
        share[k + 1] = ahead[k] / width
    for k in range(len(speed) - 1, -1, -1):
        back = share[k] / ahead[k]
        level[k] += back * (level[k + 1] - level[k])
        share[k] += back**2 * (share[k + 1] - ahead[k])
    # a series without any change has no noise: a millionth of a microradian avoids division by zero
    noise = np.maximum(squares / len(speed), 1e-24)
    return _Smoothed(level, share, noise, -0.5 * (len(speed) * np.log(noise) + logs))


def _smoothness(spot_um: Vector, lever_mm: Vector, level: Vector) -> Vector:
    """Return the logarithm of the likelihood of each drift, shape (speeds,), by the straightness
    that remains after its correction: small bends are likely.

    Second differences are independent of the head's alignment.
    """
    bends = np.diff(spot_um[:, None] - 1e-3 * lever_mm[:, None] * level, n=2, axis=0)
    likely: Vector = (
        -0.5
        * BENDS_COUNT
        * min(len(bends), MOST_BENDS)
        * np.log(np.maximum(np.sum(bends**2, axis=0), 1e-24))
    )
    return likely
