"""How long a survey still takes: the stops that are missing at the pace of the last ones, and setting up, as the planner counts it."""

from functools import lru_cache

from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.survey.models import Survey
from stepdiag.solver.geometry.volume import Volume
from stepdiag.solver.planning.runs import Pace, Plan, Run, run_minutes, run_stops_mm, setup_minutes

PACE_STOPS = 10
"""The pace is told from this many stops."""
LONGEST_DWELL = 20.0
"""A stop that took so many times longer than planned was an interruption, not the pace."""
UNSHIFTED, SHIFTED = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)
"""A shifted beam on a setup that stands is set up sooner; how far it is shifted does not matter."""


def seconds_left(survey: Survey, book: PassBook) -> float:
    """Return the time left: missing stops at the measured pace (as planned before there is one), and the setups not begun."""
    plan = survey.plan
    pace = Pace(feed_mm_min=plan.feed_mm_min, dwell_s=plan.dwell_s, overrun_mm=plan.overrun_mm)
    measured = _pace_s(book)
    total = 0.0
    for name in plan.all_setups:
        run = Run(setup=name, repeats=plan.repeats, return_pass=plan.return_pass, beam_offset_mm=SHIFTED if "+" in name else UNSHIFTED)
        stops, planned, setting_up = _times(survey.volume, survey.axis_order, run, pace)
        begun = book.of(name)
        missing = stops * len(book.wanted()) - sum(len(each.chosen()) for each in begun if each.number in book.wanted())
        usable = measured is not None and measured < LONGEST_DWELL * planned
        total += missing * (measured if usable and measured is not None else planned)
        total += setting_up if not begun else 0.0
    return total


@lru_cache(maxsize=256)
def _times(volume: Volume, axis_order: str, run: Run, pace: Pace) -> tuple[int, float, float]:
    """Return the stops of a pass, the seconds from stop to stop, and the seconds of setting up, as the planner counts them."""
    plan = Plan(volume=volume, runs=(run,), axis_order=axis_order, pace=pace)
    stops = len(run_stops_mm(plan, run))
    setting_up = setup_minutes(pace, run)
    return stops, 60 * (run_minutes(plan, run) - setting_up) / (stops * len(run.pass_numbers)), 60 * setting_up


def _pace_s(book: PassBook) -> float | None:
    """Return the time from stop to stop of the pass driven last; None before it has three."""
    if book.driven is None:
        return None
    times = sorted(stop.time_s for stop in book.driven.chosen().values())[-PACE_STOPS:]
    return (times[-1] - times[0]) / (len(times) - 1) if len(times) >= 3 else None
