"""From which side the machine came to a stop, in the laser's samples."""

import math

import numpy as np
import pytest

from stepdiag.daq.capture.standing.certain_window import Taken, came_along
from stepdiag.daq.capture.standing.window import summarise
from stepdiag.daq.timing.stream import Break, Span

S = 1_000_000_000
BEGIN_S, LEVEL_MM = 10.0, 50.0


class Laser:
    """Samples at 100 Hz that come from a place within 0.5 s and stand at `LEVEL_MM` from `BEGIN_S`
    on."""

    resolution_um = 0.01

    def __init__(self, from_mm, breaks=(), spikes=(), least_s=0.0):
        self.time_s = np.arange(least_s, 12.0, 0.01)
        noise = np.random.default_rng(1).normal(0.0, 1e-4, len(self.time_s))
        self.mm = (
            np.interp(self.time_s, [BEGIN_S - 0.5, BEGIN_S], [from_mm, LEVEL_MM]) + noise
        )
        for at_s, off_mm in spikes:
            self.mm[np.searchsorted(self.time_s, at_s)] += off_mm
        self.breaks = [Break(int(at_s * S), "beam lost") for at_s in breaks]

    def newest_ns(self):
        return self.time_s[-1] * S

    def span(self, from_ns, to_ns, arrived_before_ns=math.inf):
        at = (self.time_s * S >= from_ns) & (self.time_s * S <= to_ns)
        time_ns = self.time_s[at] * S
        return Span(
            time_ns=time_ns,
            position_mm=self.mm[at],
            beam=np.ones(len(time_ns)),
            channels=None,
            unusable=0,
        )


def along(laser, step_mm, begin_s=BEGIN_S + 0.05):
    at = (laser.time_s > BEGIN_S + 0.2) & (laser.time_s < BEGIN_S + 0.8)
    taken = Taken(
        window=summarise(laser.time_s[at], laser.mm[at]),
        from_ns=10.2 * S,
        to_ns=10.8 * S,
        beam=1.0,
    )
    return came_along(laser, taken, begin_s * S, step_mm)


@pytest.mark.parametrize("step_mm", [-20.0, -2.0, -0.1, 0.1, 2.0, 20.0])
def test_the_side_is_that_of_the_last_way(step_mm):
    assert along(Laser(LEVEL_MM - step_mm), step_mm) is True
    assert along(Laser(LEVEL_MM + step_mm), step_mm) is False


@pytest.mark.parametrize("late_s", [0.0, 0.3, 2.0])
def test_a_stop_signal_that_comes_late_or_a_slow_way_changes_nothing(late_s):
    assert along(Laser(LEVEL_MM - 20.0), 20.0, BEGIN_S + late_s) is True
    assert along(Laser(LEVEL_MM + 0.3), 20.0, BEGIN_S + late_s) is False


def test_what_nobody_saw_is_not_said():
    assert along(Laser(LEVEL_MM), 20.0) is None, "it stood there all the time"
    assert along(Laser(LEVEL_MM + 20.0, least_s=BEGIN_S + 0.01), 20.0) is None, (
        "the recording began afterwards"
    )
    assert along(Laser(LEVEL_MM + 20.0, breaks=[BEGIN_S]), 20.0) is None, (
        "the count was lost on the way"
    )
    assert along(Laser(LEVEL_MM + 20.0), 0.03) is None, "no way to speak of"


def test_single_wrong_lines_and_what_became_of_the_count_before_or_after_are_no_way():
    spikes = [(BEGIN_S + 0.01, 5.0), (BEGIN_S + 0.03, 5.0)]
    assert along(Laser(LEVEL_MM - 20.0, spikes=spikes), 20.0) is True
    assert along(Laser(LEVEL_MM - 20.0, breaks=[BEGIN_S - 2.0, BEGIN_S + 1.0]), 20.0) is True
