"""A result as tidy rows: one number with its uncertainty a row, the same columns for every quantity."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from stepdiag.base.errors import DataError
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import Conditions, Facts
from stepdiag.base.result.result import Function, Result
from stepdiag.base.result.typed import written
from stepdiag.conclusion.intervals import reach_in

RMS, LARGEST = "volumetric-rms", "volumetric-largest"
"""The volumetric error without rigid motion, over the survey's own volume (contract 4, ``predicted``)."""
SCALE = "scale-"
_MOMENT = "%Y-%m-%d %H:%M UTC"


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One number of a result. ``axis`` is the one that moves, empty for a squareness; ``u`` is at ``k`` = 1, None where none is stated."""

    quantity: str
    axis: str
    position_mm: float | None
    value: float
    u: float | None
    unit: str
    k: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class About:
    """What all rows of a result share; ``event`` says what happened to the machine before the survey, ``conditions`` is JSON."""

    machine: str
    survey: str
    time: datetime
    event: str
    method: str
    software: str
    conditions: str


def about(result: Result, survey: str) -> About:
    """Return what a result says of itself; ``survey`` is its name in the archive. Raises DataError where machine or time is missing."""
    facts = result.survey or Facts()
    if not facts.machine.strip():
        raise DataError(result.source, expected="a result that names its machine", found="none", remedy="solve the survey from its logs")
    return About(
        machine=facts.machine, survey=survey, time=_time(facts, result.source), event=facts.event, method=result.method,
        software=result.software.version, conditions=json.dumps(_conditions(result, facts), sort_keys=True, ensure_ascii=False),
    )  # fmt: skip


def rows_of(result: Result) -> Iterator[Row]:
    """Yield every number that the result identifies: functions, squareness, scale, volumetric error."""
    for name, function in result.errors.items():
        yield from _function(name, function)
    for name, number in result.squareness.items():
        if number.value is not None:
            yield Row(quantity=name, axis="", position_mm=None, value=number.value, u=number.u, unit=number.unit)
    for axis, scale in result.scale.items():
        if scale.identified and scale.value is not None:
            yield Row(quantity=f"{SCALE}{axis}", axis=axis, position_mm=None, value=scale.value, u=scale.u, unit=scale.unit)
    reach = reach_in(result)
    for name, interval in ((RMS, reach.rms_before), (LARGEST, reach.largest_before)):
        yield Row(quantity=name, axis="", position_mm=None, value=interval.value_um, u=_u_um(interval), unit="um")


def _function(name: str, function: Function) -> Iterator[Row]:
    if function.value is None:
        return
    u = [None] * len(function.value) if function.u is None else function.u.tolist()
    for at, value, each in zip(function.position_mm.tolist(), function.value.tolist(), u, strict=True):
        yield Row(quantity=name, axis=name[2], position_mm=at, value=value, u=each, unit=function.unit)


def _u_um(interval: Interval) -> float | None:
    """Return the standard uncertainty that an interval at k = 2 stands for."""
    return None if interval.low_um is None or interval.high_um is None else (interval.high_um - interval.low_um) / 4


def _time(facts: Facts, source: str) -> datetime:
    for text, form in ((facts.ended, _MOMENT), (facts.begun, _MOMENT), (facts.date, "%Y-%m-%d")):
        try:
            return datetime.strptime(text, form).replace(tzinfo=UTC)
        except ValueError:
            continue
    raise DataError(source, expected="a result that says when it was measured", found="no date", remedy="solve the survey from its logs")


def _conditions(result: Result, facts: Facts) -> dict[str, Any]:
    """Return the sensors' extremes and what compensation was active, by the beginning of its hashes."""
    hashes = sorted(each.sha256[:12] for each in facts.active_files)
    return {"sensors": written(result.conditions or Conditions()), "compensation": facts.compensation or "", "active": hashes}
