"""Whether the laser can have seen a machine go beyond its last stop."""

from types import SimpleNamespace

import numpy as np
import pytest

from stepdiag.daq.capture.standing.certain_window import last_beyond_ns, watched_closely

LAST = SimpleNamespace(window_to_ns=0, reading_mm=100.0)


def laser(rate_hz, overrun_s):
    """A laser that sees the machine stand, go 2 mm beyond for a while, and stand again."""
    time_ns = np.arange(0.0, 1e9, 1e9 / rate_hz)
    away = np.abs(time_ns - 0.5e9) < 0.5e9 * overrun_s
    return SimpleNamespace(
        span=lambda *_: SimpleNamespace(
            time_ns=time_ns, position_mm=np.where(away, 102.0, 100.0)
        )
    )


@pytest.mark.parametrize(
    ("rate_hz", "overrun_s", "seen"),
    [(1000.0, 0.1, True), (40.0, 0.1, True), (1000.0, 0.0, False), (8.0, 0.1, False)],
)
def test_an_overrun_is_seen_or_it_is_known_that_it_may_have_been_missed(
    rate_hz, overrun_s, seen
):
    stream = laser(rate_hz, overrun_s)
    assert (last_beyond_ns(stream, LAST, 1.0, 1e9) is not None) is seen
    assert watched_closely(stream, LAST, 1e9) is (rate_hz > 33.0)
