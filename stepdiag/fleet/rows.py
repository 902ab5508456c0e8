"""A result as a table: each row has one number and its uncertainty, with the same columns for every
quantity."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import Conditions, Facts
from stepdiag.base.result.result import Function, Result
from stepdiag.base.result.typed import written
from stepdiag.comparing.alike import common_share, standing_of
from stepdiag.conclusion.intervals import reach_in

RMS, LARGEST = "volumetric-rms", "volumetric-largest"
"""Names of the volumetric errors without rigid motion, over the volume of the survey (contract 4,
``predicted``)."""
SCALE = "scale-"
_MOMENT = "%Y-%m-%d %H:%M UTC"


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A number of a result. ``axis`` is the moving axis, empty for a squareness. ``u`` is the
    standard uncertainty (k = 1), None if unknown.

    ``u_common`` is the part of ``u`` that is common to all surveys with the same instruments.
    ``low`` and ``high`` are the ends (k = 2) of a skewed interval; ``u`` is then a quarter of the
    width of the interval.
    """

    quantity: str
    axis: str
    position_mm: float | None
    value: float
    u: float | None
    unit: str
    k: int = 1
    u_common: float | None = None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class About:
    """The columns with equal values in all rows of a result; ``event`` is an event at the machine
    before the survey, ``conditions`` is JSON."""

    machine: str
    survey: str
    time: datetime
    event: str
    method: str
    software: str
    conditions: str


def about(result: Result, survey: str) -> About:
    """Return the facts about a result for its rows; ``survey`` is the name of the survey in the
    archive. Raises DataError for a missing machine or time."""
    facts = result.survey or Facts()
    if not facts.machine.strip():
        raise DataError(
            result.source,
            expected=message("result-with", what=message("machine-name")),
            found=message("none"),
            remedy=message("solve-from-logs"),
        )
    return About(
        machine=facts.machine,
        survey=survey,
        time=_time(facts, result.source),
        event=facts.event,
        method=result.method,
        software=result.software.version,
        conditions=json.dumps(_conditions(result, facts), sort_keys=True, ensure_ascii=False),
    )


def rows_of(result: Result) -> Iterator[Row]:
    """Yield a row for every number that the result identifies: functions, squareness, scale,
    volumetric error."""

    def common(name: str, u: float | None) -> float | None:
        return (
            None
            if u is None
            else u * common_share(result.budget, name, same_instruments=True)
        )

    for name, function in result.errors.items():
        if function.value is None:
            continue
        values = zip(
            function.position_mm.tolist(),
            function.value.tolist(),
            _listed(function),
            strict=True,
        )
        for at, value, u in values:
            yield Row(
                quantity=name,
                axis=name[2],
                position_mm=at,
                value=value,
                u=u,
                unit=function.unit,
                u_common=common(name, u),
            )
    for name, number in result.squareness.items():
        if number.value is not None:
            yield Row(
                quantity=name,
                axis="",
                position_mm=None,
                value=number.value,
                u=number.u,
                unit=number.unit,
                u_common=common(name, number.u),
            )
    for axis, scale in result.scale.items():
        if scale.identified and scale.value is not None:
            yield Row(
                quantity=f"{SCALE}{axis}",
                axis=axis,
                position_mm=None,
                value=scale.value,
                u=scale.u,
                unit=scale.unit,
                u_common=common(axis, scale.u),
            )
    reach = reach_in(result)
    for name, interval in ((RMS, reach.rms_before), (LARGEST, reach.largest_before)):
        yield Row(
            quantity=name,
            axis="",
            position_mm=None,
            value=interval.value_um,
            u=_u_um(interval),
            unit="um",
            low=interval.low_um,
            high=interval.high_um,
        )


def _listed(function: Function) -> list[float | None]:
    return [None] * len(function.position_mm) if function.u is None else function.u.tolist()


def _u_um(interval: Interval) -> float | None:
    """Return the standard uncertainty that corresponds to an interval at k = 2."""
    return (
        None
        if interval.low_um is None or interval.high_um is None
        else (interval.high_um - interval.low_um) / 4
    )


def _time(facts: Facts, source: str) -> datetime:
    for text, form in (
        (facts.ended, _MOMENT),
        (facts.begun, _MOMENT),
        (facts.date, "%Y-%m-%d"),
    ):
        try:
            return datetime.strptime(text, form).replace(tzinfo=UTC)
        except ValueError:
            continue
    raise DataError(
        source,
        expected=message("result-with", what=message("date-of-measuring")),
        found=message("none"),
        remedy=message("solve-from-logs"),
    )


def _conditions(result: Result, facts: Facts) -> dict[str, Any]:
    hashes = sorted(each.sha256[:12] for each in facts.active_files)
    return {
        "sensors": written(result.conditions or Conditions()),
        "active": hashes,
        **asdict(standing_of(result)),
    }
