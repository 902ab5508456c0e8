"""What a reference file of daq/capture tells, read: series of numbers, streams, signals, dwells,
stops, surveys.

A series is a list of numbers and of parts ``"kind number ..."`` or ``[kind, ...]`` that stand for
several; only the four basic operations are in them, so that every processor makes the same numbers
of them.
"""

import json
from typing import Any

import msgspec
import numpy as np

from stepdiag.base.findings import Finding
from stepdiag.daq.capture.captured_stop import CapturedStop, from_log
from stepdiag.daq.capture.standing.dwell import Dwell
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.models import StopRules, Survey
from stepdiag.daq.timing.stream import Break, Span
from testkit.references import plain
from testkit.timeline import survey_text

MS = 1_000_000


def noise(count: int, seed: int, size: float = 0.2) -> list[float]:
    """Return made-up noise of about that standard deviation: the sum of three draws of a small
    congruential generator."""
    state, found = seed * 2654435761 % 2**32 | 1, []
    for _ in range(count):
        draws = 0.0
        for _ in range(3):
            state = (1664525 * state + 1013904223) % 2**32
            draws += state / 2**32 - 0.5
        found.append(round(2.0 * size * draws, 4))
    return found


def _alike(count: int, seed: int, keep: float, add: float) -> list[float]:
    found = noise(count, seed)
    for k in range(1, count):
        found[k] = round(keep * found[k - 1] + add * found[k], 4)
    return found


def _changed(told: list[Any], *places: list[Any]) -> list[float]:
    found = series(told)
    for at, value in places:
        found[at] = value
    return found


def _fading(count: int, first: float, factor: float) -> list[float]:
    found = [first]
    while len(found) < count:
        found.append(found[-1] * factor)
    return found


PARTS: dict[str, Any] = {
    "noise": noise,
    "alike": _alike,
    "same": lambda count, value: [value] * count,
    "line": lambda count, first, step: [first + step * k for k in range(count)],
    "fading": _fading,
    "turns": lambda count, *values: [values[k % len(values)] for k in range(count)],
    "sum": lambda *columns: [
        sum(values) for values in zip(*map(series, columns), strict=True)
    ],
    "scaled": lambda first, factor, told: [first + factor * each for each in series(told)],
    "with": _changed,
}
"""What stands for several numbers: ``sum`` adds series number by number, ``scaled`` moves and
multiplies one, ``with`` changes some of one, ``turns`` repeats values."""


def series(told: list[Any]) -> list[float]:
    """Return the numbers of a series."""
    found: list[float] = []
    for each in told:
        if isinstance(each, str):
            kind, *numbers = each.split()
            found += PARTS[kind](*map(json.loads, numbers))
        else:
            found += PARTS[each[0]](*each[1:]) if isinstance(each, list) else [each]
    return found


class Told:
    """A stream as a reference file tells it: when its samples were, what they read."""

    def __init__(self, told: dict[str, Any]) -> None:
        mm = np.array(series(told["mm"]), dtype=float)
        count = len(mm)
        every = told.get("from_ns", 0) + told.get("every_ns", 1) * np.arange(count)
        self._time_ns = np.array(
            series(told["time_ns"]) if "time_ns" in told else every, dtype=float
        )
        self._arrival_ns = self._time_ns + np.array(
            series(told["late_ns"]) if "late_ns" in told else 0
        )
        self._mm, self._usable = (
            mm,
            ~np.isin(np.arange(count), series(told.get("unusable", []))),
        )
        beam = np.array(
            series(told["beam"]) if "beam" in told else [-1.0] * count, dtype=float
        )
        self._beam = np.where(beam < 0, np.nan, beam)
        self._flags = np.array(
            series(told.get("flags", [["same", count, 0]])), dtype=np.uint16
        )
        self._channels = (
            np.array([series(column) for column in told["channels"]], dtype=float).T
            if "channels" in told
            else None
        )
        self.breaks = [Break(*each) for each in told.get("breaks", [])]
        self.resolution_um = told.get("resolution_um", np.inf)

    def newest_ns(self) -> float:
        """Return the time of the newest sample."""
        return float(self._time_ns[-1]) if len(self._time_ns) else -np.inf

    def span(self, from_ns: float, to_ns: float, arrived_before_ns: float = np.inf) -> Span:
        """Return the usable samples of a span of time."""
        inside = (
            (self._time_ns >= from_ns)
            & (self._time_ns <= to_ns)
            & (self._arrival_ns < arrived_before_ns)
        )
        usable = inside & self._usable
        channels = None if self._channels is None else self._channels[usable]
        unusable = int(np.count_nonzero(inside & ~usable))
        return Span(
            time_ns=self._time_ns[usable],
            position_mm=self._mm[usable],
            beam=self._beam[usable],
            channels=channels,
            unusable=unusable,
        )

    def flags(self, from_ns: float, to_ns: float) -> Any:
        """Return the flags of all samples of a span of time."""
        return self._flags[(self._time_ns >= from_ns) & (self._time_ns <= to_ns)]


def rules_of(told: dict[str, Any]) -> StopRules:
    """Return the rules of a stop."""
    return msgspec.convert(told.get("rules", {}), StopRules)


def signals_of(told: dict[str, Any]) -> Signals:
    """Return signals; ``at`` is the commanded position."""
    more = {name: value for name, value in told.items() if name != "at"}
    place = dict(zip(("x_mm", "y_mm", "z_mm"), told.get("at", ()), strict=False))
    return Signals(
        **place
        | {name: float("nan") if value == "nan" else value for name, value in more.items()}
    )


def dwell_of(told: dict[str, Any]) -> Dwell:
    """Return a dwell."""
    return Dwell(
        **{"not_before_ns": None} | told | {"signals": signals_of(told.get("signals", {}))}
    )


def stop_of(told: dict[str, Any]) -> CapturedStop:
    """Return a stop of which little is of interest."""
    base = {
        "setup": "ppp",
        "outward": True,
        "stop": 0,
        "position_mm": (0.0, 0.0, 0.0),
        "axis": "",
        "stop_count": None,
        "reading_mm": None,
    }
    more = {
        "u_um": 0.1,
        "scatter_um": 0.2,
        "slope_um_s": 0.0,
        "samples": 9,
        "rejected": 0,
        "window_from_ns": 0,
        "window_to_ns": 0,
    }
    return from_log(base | more | {"time_s": 0.0, "beam": None} | told)


def hint_of(told: dict[str, Any]) -> dict[str, Any]:
    """Return a hint as `PassHint` reads it."""
    known = {int(stop): reading for stop, reading in told.get("known", {}).items()}
    return (
        told | {"known": known} | ({"turn": stop_of(told["turn"])} if "turn" in told else {})
    )


def survey_of(told: dict[str, Any]) -> Survey:
    """Return the timeline's survey with changes: ``[[what stands there, what shall]]``, and what is
    added."""
    text = survey_text(
        **{
            name: tuple(value) if isinstance(value, list) else value
            for name, value in told.get("survey", {}).items()
        }
    )
    for old, new in told.get("changed", []):
        assert old in text, old
        text = text.replace(old, new)
    return parse_survey(told.get("text", text) + told.get("added", ""), "survey.toml")


def brief(said: Any) -> Any:
    """Return findings as code, place and message, dwells as numbers, stops as their name, numbers
    and messages; all else as it is."""
    if isinstance(said, Finding):
        place = f"{said.setup or 'no setup'} {said.way}, {said.stop} of {said.last}"
        return f"{said.severity} {said.code} ({place}): {plain(said.message)}"
    if isinstance(said, Dwell):
        place, count = said.signals.commanded_mm or (), said.signals.stop_count
        return plain(
            [
                said.from_ns,
                said.to_ns,
                said.not_before_ns,
                int(bool(said.signals.stopped)),
                count,
                *place,
            ]
        )
    if isinstance(said, CapturedStop):
        return _stop(said)
    if isinstance(said, list | tuple):
        return [brief(each) for each in said]
    return plain(said)


WORDS = ("broken", "unwatched", "doubts", "refused", "recovered", "turned", "held")


def _stop(stop: CapturedStop) -> list[Any]:
    """Return a stop; its reading as millimetres and the micrometres that are left: else a large one
    hides a small change."""
    reading = (
        []
        if stop.reading_mm is None
        else [round(stop.reading_mm), (stop.reading_mm - round(stop.reading_mm)) * 1e3]
    )
    quality = [
        stop.u_um,
        stop.scatter_um,
        stop.slope_um_s,
        stop.samples,
        stop.rejected,
        stop.window_from_ns,
        stop.window_to_ns,
        stop.time_s,
    ]
    felt = [
        stop.material_temperature_c,
        stop.air_temperature_c,
        stop.air_pressure_hpa,
        stop.relative_humidity_percent,
    ]
    rows = [
        [*stop.position_mm, stop.stop_count, *reading],
        [*quality, stop.beam],
        felt,
        [*stop.channels],
        [*stop.u_channels],
    ]
    words = [f"{name}: {plain(getattr(stop, name))}" for name in WORDS if getattr(stop, name)]
    name = f"{stop.setup} {'out' if stop.outward else 'back'} {stop.stop} {stop.axis}"
    return [name, *(plain(row) for row in rows if row and row != [None] * 4), *words]
