"""A quantity of a machine over time, and the selection of comparable surveys."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Message, message
from stepdiag.comparing.alike import Standing, apart, same_volume
from stepdiag.fleet.rows import LARGEST, RMS

Array = NDArray[np.float64]
EARLIEST = datetime(1990, 1, 1, tzinfo=UTC)
"""Oldest possible time of a survey: a clock that was never set gives 1970 or 1980."""
AHEAD = timedelta(days=2)
"""Largest lead of a survey's time over the present time: another time zone or a slow clock causes a
smaller lead; a larger lead is a wrong date."""
OF_VOLUME = (RMS, LARGEST)
"""Quantities that depend on the size of the measured volume."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """One survey. ``active`` contains the hashes of the loaded tables; ``standing`` decides which
    other surveys are comparable."""

    time: datetime
    name: str
    event: str = ""
    active: tuple[str, ...] = ()
    software: str = ""
    standing: Standing = field(default_factory=Standing)


class Point(NamedTuple):
    """The value of a quantity in a survey. ``u`` is None if no uncertainty is known; ``low`` and
    ``high`` are NaN for a symmetric interval."""

    survey: Survey
    value: float
    u: float | None
    low: float
    high: float

    @property
    def time(self) -> datetime:
        return self.survey.time

    def interval(self) -> tuple[float, float]:
        """Return the least and the largest magnitude of the value at k = 2; both are the magnitude
        of the value if no uncertainty is known."""
        if math.isfinite(self.low) and math.isfinite(self.high):
            return self.low, self.high
        expanded = 2 * (self.u or 0.0)
        return abs(self.value) - expanded, abs(self.value) + expanded


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """A quantity of a machine over its surveys, oldest first: ``values`` and ``u`` at the nodes,
    shapes (surveys, nodes), NaN for missing values.

    ``common`` is the share of u that is common to surveys with the same instruments. ``shown``
    contains the values for people: value, u, low, high. ``other`` is the reason why these surveys
    are separate from other surveys of the machine, None for the compared surveys.
    """

    machine: str
    quantity: str
    unit: str
    surveys: tuple[Survey, ...]
    nodes_mm: Array
    values: Array
    u: Array
    common: Array
    shown: Array
    other: Message | None = None

    @property
    def points(self) -> tuple[Point, ...]:
        return tuple(map(self.point, range(len(self.surveys))))

    def point(self, number: int) -> Point:
        value, u, low, high = self.shown[number].tolist()
        return Point(self.surveys[number], value, None if np.isnan(u) else u, low, high)


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """A survey outside all series, and the reason."""

    machine: str
    name: str
    why: Message
    damaged: bool = False


def stated(conditions: str) -> tuple[tuple[str, ...], Standing]:
    """Return the hashes of the active tables and the facts of the result, from the conditions of a
    row; empty for missing parts or parts of another type."""
    try:
        stated = json.loads(conditions)
        active = stated.get("active", [])
    except (ValueError, AttributeError, RecursionError):
        return (), Standing()
    usual = Standing()
    known = {
        name: _typed(stated.get(name), getattr(usual, name))
        for name in Standing.__dataclass_fields__
    }
    if len(known["volume_mm"]) != 6 or not all(
        isinstance(each, int | float) for each in known["volume_mm"]
    ):
        known["volume_mm"] = ()
    return (tuple(map(str, active)) if isinstance(active, list) else ()), Standing(**known)


def _typed(value: Any, usual: Any) -> Any:
    if isinstance(usual, tuple):
        return (
            tuple(value)
            if isinstance(value, list)
            and all(isinstance(each, int | float | str) for each in value)
            else usual
        )
    return value if type(value) is type(usual) else usual


Groups = list[tuple[dict[int, Survey], Message | None]]


def parted(
    machine: str, surveys: Mapping[int, Survey], now: datetime
) -> tuple[Groups, list[LeftOut]]:
    """Return groups of comparable surveys, the group of the newest survey first, and the surveys
    outside all groups."""
    kept: dict[int, Survey] = {}
    left_out = []
    for key, each in surveys.items():
        why = _doubt(each, now)
        if why is None:
            kept[key] = each
        else:
            left_out.append(LeftOut(machine=machine, name=each.name, why=why))
    groups: Groups = []
    while kept:
        newest = next(reversed(kept.values()))
        alike = {
            key: each
            for key, each in kept.items()
            if apart(newest.standing, each.standing) is None
        }
        main = next(iter(groups[0][0].values())).standing if groups else None
        groups.append((alike, None if main is None else apart(main, newest.standing)))
        kept = {key: each for key, each in kept.items() if key not in alike}
    return groups, left_out


def _doubt(survey: Survey, now: datetime) -> Message | None:
    if survey.standing.errors:
        return message("left-out-errors", codes=survey.standing.errors)
    if survey.standing.undated or not EARLIEST <= survey.time <= now + AHEAD:
        return message("left-out-clock", day=survey.time.date().isoformat())
    return None


def middle_of(shown: Array) -> Array:
    """Return the values for the comparison, shape (surveys, 1): the middle of the interval, or the
    value itself without an interval. The columns of ``shown`` are value, u, low, high."""
    middle = shown[:, 2:].mean(axis=1)
    return np.where(np.isfinite(middle), middle, shown[:, 0])[:, None]


def by_volume(series: Series) -> Iterator[Series]:
    """Yield the series of a volumetric value, one per measured volume, the series of the newest
    survey first."""
    left = list(range(len(series.surveys)))
    newest = series.surveys[-1].standing
    while left:
        last = series.surveys[left[-1]].standing
        alike = [
            number for number in left if _volume_alike(series.surveys[number].standing, last)
        ]
        other = series.other if last is newest else message("differs-volume")
        yield (
            series
            if len(alike) == len(series.surveys)
            else replace(
                series,
                surveys=tuple(series.surveys[number] for number in alike),
                values=series.values[alike],
                u=series.u[alike],
                common=series.common[alike],
                shown=series.shown[alike],
                other=other,
            )
        )
        left = [number for number in left if number not in alike]


def _volume_alike(one: Standing, other: Standing) -> bool:
    return not one.volume_mm or not other.volume_mm or same_volume(one, other)
