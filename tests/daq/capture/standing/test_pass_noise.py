"""The slow noise of a pass explains steps and trends of its own size, and no others."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.messages import message
from stepdiag.daq.capture.standing.certain_window import (
    Part,
    PassNoise,
    Taken,
    certain_window,
    take,
)
from stepdiag.daq.capture.standing.window import Window, find_step, sigmas
from stepdiag.daq.survey.models import StopRules
from stepdiag.daq.timing.stream import Span

RULES = StopRules()
WINDOW_S = 0.7


def window(slope_um_s=0.0, *, u_um_s=0.1, trend_sigmas=0.0, step_um=0.0, step_sigmas=20.0):
    """Return a window with this trend, with the doubts that it has by itself."""
    doubts = []
    if abs(slope_um_s) > RULES.max_slope_um_s + 5.0 * u_um_s:
        limit = RULES.max_slope_um_s
        doubts.append(message("stop-doubtful", slope_um_s=slope_um_s, limit_um_s=limit))
    if step_um:
        doubts.append(message("window-step", step_um=step_um))
    statistics = Window(
        mean_mm=0.0,
        u_um=0.1,
        scatter_um=0.3,
        slope_um_s=slope_um_s,
        u_slope_um_s=u_um_s,
        used=35,
        rejected=0,
        duration_s=WINDOW_S,
    )
    return Taken(
        window=statistics,
        from_ns=0.0,
        to_ns=7e8,
        beam=1.0,
        doubts=tuple(doubts),
        step=(step_um, step_sigmas),
        trend_sigmas=trend_sigmas,
    )


def doubts_after(slopes_um_s, last):
    """Return the codes of the last window's doubts in a pass of windows with these trends."""
    noise = PassNoise()
    for slope in slopes_um_s:
        noise.take(window(slope, trend_sigmas=2.0 * abs(slope)), RULES)
    return [doubt.code for doubt in noise.take(last, RULES).doubts]


TURBULENT, QUIET = [0.9, -1.6, 0.4, -0.7, 1.8, -1.1], [0.1, -0.1, 0.05, 0.0, 0.1, -0.1]
CREEPING = [4.8, 5.1, 5.0, 4.9, 5.2, 4.9, 5.0]


@pytest.mark.parametrize(
    ("slopes_um_s", "last", "codes"),
    [
        (TURBULENT, window(-2.2), []),
        (TURBULENT, window(20.0), ["stop-doubtful"]),
        (TURBULENT, window(step_um=1.5), []),
        (TURBULENT, window(step_um=9.0), ["window-step"]),
        (CREEPING, window(5.0, trend_sigmas=10.0), ["stop-doubtful"]),
        (QUIET, window(1.8), ["stop-doubtful"]),
        (QUIET, window(step_um=1.5), ["window-step"]),
        ([], window(1.8, trend_sigmas=4.0), []),
        ([], window(1.8, trend_sigmas=6.0), ["stop-doubtful"]),
        ([], window(step_um=1.5), ["window-step"]),
        ([], window(step_um=1.5, step_sigmas=4.0), []),
        (QUIET, window(step_um=1.5, step_sigmas=4.0), ["window-step"]),
    ],
)
def test_a_doubt_is_explained_by_the_trends_of_the_other_windows(slopes_um_s, last, codes):
    assert doubts_after(slopes_um_s, last) == codes


@pytest.mark.parametrize("rate_hz", [50.0, 100.0])
def test_slow_air_before_a_slow_instrument_is_no_step(rate_hz):
    """First-order noise with a memory of 0.2 s, half a micrometre: 250 windows of 0.7 s."""
    rng = np.random.default_rng(41)
    count, memory = int(WINDOW_S * rate_hz), np.exp(-1.0 / (0.2 * rate_hz))
    noise, left = PassNoise(), 0
    for _ in range(250):
        values = np.empty(count)
        values[0] = rng.normal(0.0, 0.5)
        for at, drawn in enumerate(
            rng.normal(0.0, 0.5 * np.sqrt(1 - memory**2), count - 1), 1
        ):
            values[at] = memory * values[at - 1] + drawn
        mm, ns = 1e-3 * values, np.arange(count) / rate_hz * 1e9
        span = Span(
            time_ns=ns, position_mm=mm, beam=np.ones(count), channels=None, unusable=0
        )
        taken = take(span, 0.0, float(ns[-1]), RULES, 0.001)
        step = find_step(mm)
        steps = (message("window-step", step_um=step[0]),) if step[0] else ()
        alone = replace(taken, doubts=(*taken.doubts, *steps), step=step)
        left += len(noise.take(alone, RULES).doubts)
    assert left == 0


class Laser:
    """Samples of a standstill of 1.2 s at 50 Hz."""

    resolution_um = 0.001
    breaks = ()

    def __init__(self, seed, um):
        self.time_s = np.arange(0.0, 1.2, 0.02)
        noise = np.random.default_rng(seed).normal(0.0, 0.3, len(self.time_s))
        self.mm = (um(self.time_s) + noise) * 1e-3

    def span(self, from_ns, to_ns, arrived_before_ns=np.inf):
        at = (self.time_s * 1e9 >= from_ns) & (self.time_s * 1e9 <= to_ns)
        return Span(
            time_ns=self.time_s[at] * 1e9,
            position_mm=self.mm[at],
            beam=np.ones(int(at.sum())),
            channels=None,
            unusable=0,
        )


def first_doubts(um):
    """Return how many of 20 first windows of a pass have which doubts."""
    found = Counter()
    for seed in range(20):
        taken = certain_window(Laser(seed, um), Part(0.0, 1.2e9), RULES)
        found.update(doubt.key for doubt in PassNoise().take(taken, RULES).doubts)
    return found


def test_a_step_in_the_first_window_of_a_pass_is_found():
    for at_s in (0.41, 0.6, 0.75, 0.9):
        doubts = first_doubts(lambda time_s, at_s=at_s: 5.0 * (time_s >= at_s))
        assert doubts["window-step"] == 20
    assert not first_doubts(np.zeros_like)


def test_a_drift_is_not_hidden_in_the_noise_of_a_shorter_window():
    assert first_doubts(lambda time_s: 5.0 * time_s)["stop-doubtful"] >= 19
    resting = first_doubts(lambda time_s: 20.0 * np.exp(-time_s / 0.08))
    assert resting["stop-doubtful"] == 0, "it comes to rest"


def test_few_values_show_their_noise_badly():
    assert sigmas(5.0, 1.0, 10_000) == pytest.approx(5.0, abs=0.01)
    assert sigmas(11.0, 1.0, 8) < 5.0 < sigmas(12.0, 1.0, 8)
    assert (sigmas(5.0, 1.0, 2), sigmas(5.0, 0.0, 8)) == (0.0, np.inf)
