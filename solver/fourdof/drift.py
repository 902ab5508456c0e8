"""The pointing drift of the laser source during a run, without the noise of the drift detector.

The lever multiplies the noise of the drift detector PSD1: 1.7 urad at 8 m are 14 um of
straightness. A source drifts slowly, and noise has no memory, so the model is a random walk
observed with white noise (the local level model; Harvey, Forecasting, Structural Time Series Models
and the Kalman Filter, 1989, sections 2.3 and 4.3). The speed of the drift (the step of the random
walk relative to the noise) is estimated from the series of PSD1, from the noise within the dwells,
and from the quadrant detector. A real drift also moves the spot on the quadrant detector, so the
right correction makes the path of this spot smoother. The result is the mean over all likely
speeds; its uncertainty includes the spread between the speeds.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

LEAST_SAMPLES = 5
"""Smallest number of samples that determines the speed of a drift."""
QUICKEST = 1e4
"""Largest ratio of the variance of the drift's steps to that of the noise; at this ratio the
values are not smoothed."""
SPEEDS = 25
MOST_BENDS = 40
"""Largest number of bends (second differences) of the spot's path in the likelihood. Bends show a
remaining drift that changes from stop to stop, but not a slow remaining drift."""
BENDS_COUNT = 0.1
"""Weight of the bends in the likelihood, below 1 because bends of a remaining drift are nearly
equal at neighbouring stops. In a pass of 8 m with a noise of 1.7 urad, a weight of 0.5 smooths
the drift too much: 83 % of the values are within 2 u (10.9 um rms). With a weight of 0.1, 94 %
are within 2 u (8.6 um); with 0, 97 % (9.3 um)."""
BENDS_SHARE = 1.94
"""The second differences of white noise are correlated with their neighbours by -2/3 and 1/6. The
variance of a slope between two such series is therefore larger by this factor: 1 + 2 (4/9 +
1/36)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """The pointing drift and its standard uncertainty in urad, shapes (N,)."""

    angle_urad: Vector
    u_urad: Vector


def slow_drift(
    time_s: Vector, seen_urad: Vector, u_urad: Vector, spot_um: Vector, lever_mm: Vector
) -> Drift:
    """Return the drift at each time, shapes (N,), from the values ``seen_urad`` of PSD1; times
    ascend.

    ``u_urad`` is the noise of each value within its dwell (0: unknown). ``spot_um`` is half of the
    quadrant detector's shift, which contains the drift times ``lever_mm``. Fewer than
    `LEAST_SAMPLES` values are returned unchanged.
    """
    if len(seen_urad) < LEAST_SAMPLES:
        return Drift(angle_urad=seen_urad, u_urad=u_urad)
    step_s = np.diff(time_s)
    usual_s = float(np.mean(step_s)) or 1.0
    # a drift slower than these speeds cannot be distinguished from standstill
    speeds = np.geomspace(0.1 / len(seen_urad) ** 2, QUICKEST, SPEEDS)
    found = _smoothed(seen_urad, step_s[:, None] / usual_s * speeds)
    floor = float(np.mean(u_urad**2))
    noise = np.maximum(found.noise, floor)
    # a drift whose noise is ten times the noise within the dwells has a hundredth of the weight
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
    """Return the part of the fast residual of PSD1 that is a real motion of the beam, and its
    uncertainty, shapes (N,).

    A regression estimates g, the share of the residual that is a motion of the beam: the second
    differences of the spot are g times the second differences of (lever * residual).
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
    level: Vector
    share: Vector
    noise: Vector
    log_likelihood: Vector


def _smoothed(seen: Vector, speed: Vector) -> _Smoothed:
    """Return the series ``seen`` (N,) without its noise, once for each possible speed of the drift.

    ``speed`` (N - 1, speeds) contains, for each possible speed, the variances of the steps of the
    drift divided by the variance of the noise.
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
    # a constant series has no noise; the lower limit avoids a division by zero
    noise = np.maximum(squares / len(speed), 1e-24)
    return _Smoothed(level, share, noise, -0.5 * (len(speed) * np.log(noise) + logs))


def _smoothness(spot_um: Vector, lever_mm: Vector, level: Vector) -> Vector:
    """Return the log-likelihood of each drift, shape (speeds,), by the second differences (bends)
    of the straightness after its correction. Second differences do not depend on the head's
    alignment."""
    bends = np.diff(spot_um[:, None] - 1e-3 * lever_mm[:, None] * level, n=2, axis=0)
    likely: Vector = (
        -0.5
        * BENDS_COUNT
        * min(len(bends), MOST_BENDS)
        * np.log(np.maximum(np.sum(bends**2, axis=0), 1e-24))
    )
    return likely
