"""The passes to drive: their order, their first stops, and their times, which include the setting
up.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from statistics import median

from stepdiag.base.readings.runs import Plan, run_minutes, run_stops_mm, setup_minutes
from stepdiag.base.setups import Kind, setup_of
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.naming.route import route_of
from stepdiag.daq.passes.driven import Pass
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.records.status import DriveStatus
from stepdiag.daq.survey.models import Survey

PACE_STOPS = 10
"""Number of newest stops from which the pace of the machine is computed."""
LONGEST_SETTING_UP = 3.0
SETTING_UP: Mapping[Kind, str] = {
    "step": "diagonal_setup_min",
    "face": "diagonal_setup_min",
    "body": "diagonal_setup_min",
    "linear": "linear_setup_min",
    "fourdof": "fourdof_setup_min",
}
LONGEST_DWELL = 20.0
"""Factor to the planned time above which the time of a stop contains an interruption and is left
out of the pace.
"""


def to_drive(survey: Survey, book: PassBook, running: str = "") -> tuple[DriveStatus, ...]:
    """Return the open passes of the plan, in the order of driving; empty if every pass is complete
    and free of doubts.

    The time of a partly driven pass begins at the stop where the pass continues. The minutes of a
    pass are computed with the measured pace, or with the planned pace until a pass is measured. The
    first pass of a future setup includes the setting up, with the time measured on earlier setups.
    ``running`` is the setup that the machine drives now.
    """
    plan = survey.plan
    standing = book.last.setup if book.last is not None else ""
    planned = own_minutes(
        survey, (stop for each in book.passes for stop in each.chosen().values())
    )
    order = [
        name for name in dict.fromkeys((running, book.next_setup(), *plan.all_setups)) if name
    ]
    drives: list[DriveStatus] = []
    for name in order:
        stop_s, setting_up_s = _pace(planned, book, name)
        setting_up_s = 0.0 if name == standing and not drives else setting_up_s
        for number in book.open_passes(name):
            drive = _drive(survey, book, name, number, running=name == running)
            drives.append(_with_minutes(drive, stop_s, setting_up_s))
            setting_up_s = 0.0
    return tuple(drives)


def own_minutes(survey: Survey, stops: Iterable[CapturedStop]) -> Plan:
    """Return the plan with the minutes of setting up that were measured in a survey, by kind of
    setup: from the last stop before a setup to the setup's first stop.

    A time longer than planned by the factor `LONGEST_SETTING_UP` was an interruption and is left
    out.
    """
    plan, found = survey.planned, dict[str, list[float]]()
    for before, first in pairwise(sorted(stops, key=lambda stop: stop.time_s)):
        if before.setup == first.setup:
            continue
        one, other = setup_of(before.setup), setup_of(first.setup)
        name = "beam_shift_min" if one.base == other.base else SETTING_UP[other.kind]
        minutes = (first.time_s - before.time_s) / 60.0
        if minutes < LONGEST_SETTING_UP * getattr(plan.pace, name):
            found.setdefault(name, []).append(minutes)
    return replace(
        plan,
        pace=replace(plan.pace, **{name: median(minutes) for name, minutes in found.items()}),
    )


def _drive(
    survey: Survey, book: PassBook, setup: str, number: int, *, running: bool
) -> DriveStatus:
    """Return an open pass, without minutes. A running pass continues at its present stop, and may
    still become complete.
    """
    stops = len(route_of(survey.planned, setup, number))
    begun = next((each for each in book.of(setup) if each.number == number), None)
    if begun is None:
        return DriveStatus(setup=setup, pass_number=number, stops=stops)
    now = running and begun is book.driven
    from_stop = begun.again_from()
    if now and not begun.open_doubts() and (following := _following(begun)) is not None:
        from_stop = following
    again = not now and not book.wrong_line and not begun.is_driven
    return DriveStatus(
        setup=setup,
        pass_number=number,
        from_stop=from_stop,
        stops=stops - from_stop,
        again=again,
    )


def _following(begun: Pass) -> int | None:
    last = max(begun.measured, default=-1)
    return None if begun.missing and begun.missing[0] <= last else last + 1


def _with_minutes(drive: DriveStatus, stop_s: float, setting_up_s: float) -> DriveStatus:
    return DriveStatus(
        setup=drive.setup,
        pass_number=drive.pass_number,
        from_stop=drive.from_stop,
        stops=drive.stops,
        again=drive.again,
        minutes=(drive.stops * stop_s + setting_up_s) / 60.0,
    )


def _pace(plan: Plan, book: PassBook, setup: str) -> tuple[float, float]:
    planned, setting_up = _times(plan, setup)
    measured = _measured_pace_s(book)
    return (
        planned if measured is None or measured >= LONGEST_DWELL * planned else measured
    ), setting_up


@lru_cache(maxsize=256)
def _times(plan: Plan, setup: str) -> tuple[float, float]:
    run = plan.run_of(setup)
    setting_up = setup_minutes(plan, run)
    return 60 * (run_minutes(plan, run) - setting_up) / (
        len(run_stops_mm(plan, run)) * len(run.pass_numbers)
    ), 60 * setting_up


def _measured_pace_s(book: PassBook) -> float | None:
    if book.driven is None:
        return None
    times = sorted(stop.time_s for stop in book.driven.chosen().values())[-PACE_STOPS:]
    return (times[-1] - times[0]) / (len(times) - 1) if len(times) >= 3 else None
