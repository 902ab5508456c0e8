"""The slow noise of a pass explains steps and trends of its own size, and no others."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.messages import message
from stepdiag.daq.capture.standing.certain_window import PassNoise, Taken, take
from stepdiag.daq.capture.standing.window import Window, find_step
from stepdiag.daq.survey.models import StopRules
from stepdiag.daq.timing.stream import Span

RULES = StopRules()
WINDOW_S = 0.7


def window(slope_um_s=0.0, *, u_um_s=0.1, step_um=0.0, step_sigmas=20.0):
    """Return a window with this trend, with the doubts that it has by itself."""
    doubts = []
    if abs(slope_um_s) > RULES.max_slope_um_s + 3.0 * u_um_s:
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
    )


def doubts_after(slopes_um_s, last):
    """Return the codes of the last window's doubts in a pass of windows with these trends."""
    noise = PassNoise()
    for slope in slopes_um_s:
        noise.take(window(slope), RULES)
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
        (CREEPING, window(5.0), ["stop-doubtful"]),
        (QUIET, window(1.8), ["stop-doubtful"]),
        (QUIET, window(step_um=1.5), ["window-step"]),
        ([], window(1.8), []),
        ([], window(2.4), ["stop-doubtful"]),
        ([], window(step_um=1.5), ["window-step"]),
        ([], window(step_um=1.5, step_sigmas=6.0), []),
        (QUIET, window(step_um=1.5, step_sigmas=6.0), ["window-step"]),
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
