"""Air and material at a stop, judged while recording: what no hall can have is not believed, nor what jumps away from its own last value.

The last credible value is held instead, with an uncertainty that grows with its age. Where there never was one the survey file's counts,
and the stop is doubted where the reading depends on it. A reading is taken in any case: its air can be put right afterwards.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import msgspec

from stepdiag.base.conditions.air import HALL
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.environment import AIR
from stepdiag.daq.survey.formats import promised
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.stream import StreamBuffer

BELIEVED_STOPS = 5
"""A value that has jumped is believed when so many stops in a row agree on it; that it has jumped stays a doubt."""
STALE_NS = 60_000_000_000
"""What a sensor told longer ago is not its present reading: it has fallen silent."""


@dataclass(frozen=True, slots=True)
class Course:
    """How far a quantity may lie from its last credible value: at once, and more with every hour; and its unit."""

    at_once: float
    an_hour: float
    unit: str


COURSES: Mapping[str, Course] = {
    "material_temperature_c": Course(1.0, 5.0, "C"),
    "air_temperature_c": Course(2.0, 10.0, "C"),
    "air_pressure_hpa": Course(2.0, 5.0, "hPa"),
    "relative_humidity_percent": Course(15.0, 30.0, "%"),
}
"""A door that is opened changes the air by so much from one stop to the next; weather changes its pressure by so much an hour."""


class Credible(msgspec.Struct, frozen=True, kw_only=True):
    """A value that was believed, and when (seconds since 1970)."""

    value: float
    time_s: float


class Teller(Protocol):
    """Who tells of air and material."""

    @property
    def told(self) -> Mapping[str, float]:
        """What it told last, by the names of the signals."""
        ...


Remark = tuple[str, str]
"""A finding's code and its words."""


@dataclass(slots=True)
class Judged:
    """The signals with what is believed of the sensors; which were ``held``; what is new to be ``said``, and what is to be ``doubted``."""

    signals: Signals
    held: tuple[str, ...] = ()
    said: list[Remark] = field(default_factory=list)
    doubted: list[Remark] = field(default_factory=list)


def with_air(survey: Survey, signals: Signals, sensor: StreamBuffer, now_ns: int, *, silent: float | None = None) -> Signals:
    """Return the signals with what the sensor, or the laser's own sensors, told, where the survey takes air and material from them.

    ``silent`` stands for what it should tell and has not for `STALE_NS`: None, or NaN for who judges it (`Conditions`).
    """
    told = told_names(survey, sensor)
    fresh = sensor.told_since(now_ns - STALE_NS)
    return replace(signals, **{name: fresh.get(name, silent) for name in told}) if told else signals  # type: ignore[arg-type]


def told_names(survey: Survey, sensor: Teller) -> tuple[str, ...]:
    """Return the conditions that a sensor or the laser is to tell, and those that the laser tells besides; none where neither is asked."""
    own = promised(survey)
    told = sensor.told if survey.environment.source == "laser" else ()
    return (*own, *(name for name in told if name in COURSES and name not in own))


def needed_conditions(survey: Survey) -> tuple[str, ...]:
    """Return the conditions that the readings of a survey depend on."""
    air = () if survey.laser.compensated else AIR
    return (*air, *(("material_temperature_c",) if survey.machine.apply_expansion else ()))


def believed_before(
    survey: Survey, sensor: StreamBuffer, now_ns: int, wall_offset_ns: int, credible: Mapping[str, Credible]
) -> dict[str, Credible]:
    """Return the values that a log begins with: those of the logs before, and what a sensor has told since as far as it is believed."""
    fresh = sensor.told_since(now_ns - STALE_NS)
    told = {name: fresh[name] for name in told_names(survey, sensor) if name in fresh}
    conditions = Conditions(survey, credible)
    conditions.judge(replace(Signals(), **told), (now_ns + wall_offset_ns) * 1e-9)  # type: ignore[arg-type]
    return conditions.credible


class Conditions:
    """Follows air and material from stop to stop. ``credible`` are the last values that were believed in the logs before."""

    def __init__(self, survey: Survey, credible: Mapping[str, Credible]) -> None:
        self._environment = survey.environment
        self._needed = needed_conditions(survey)
        self._credible = dict(credible)
        self._trouble: dict[str, str] = {}
        self._jumped: dict[str, list[float]] = {}

    @property
    def credible(self) -> dict[str, Credible]:
        """Return the last values that were believed."""
        return dict(self._credible)

    def judge(self, signals: Signals, time_s: float) -> Judged:
        """Return what is believed of the sensors at a stop; everything where the survey file fixes the conditions itself."""
        if self._environment.source == "fixed":
            return Judged(signals)
        judged = Judged(signals)
        believed = {name: self._believe(name, value, time_s, judged) for name in COURSES if (value := getattr(signals, name)) is not None}
        judged.signals = replace(signals, **believed)  # type: ignore[arg-type]
        return judged

    def _believe(self, name: str, value: float, time_s: float, judged: Judged) -> float | None:
        """Return the value that counts: as it is, the last credible one, or None where there is none."""
        last = self._credible.get(name)
        if math.isnan(value) and last is not None and time_s - last.time_s < STALE_NS * 1e-9:
            return last.value  # told before this log began
        code = self._wrong(name, value, time_s)
        if code == "sensor-jump" and self._agreed(name, value):
            judged.doubted.append((code, f"{self._found(name, value, time_s)}, at {BELIEVED_STOPS} stops in a row: it is believed now"))
            code = ""
        if code and self._trouble.get(name) != code:
            judged.said.append((code, self._in_words(name, value, time_s)))
            judged.doubted += self._unknown(name, value)
        self._trouble[name] = code
        if not code:
            self._jumped.pop(name, None)
            self._credible[name] = Credible(value=value, time_s=time_s)
            return value
        judged.held = (*judged.held, name)
        held = self._credible.get(name)
        return None if held is None else held.value

    def _wrong(self, name: str, value: float, time_s: float) -> str:
        """Return the finding's code of a value that is not believed; empty for one that is."""
        if math.isnan(value):
            return "conditions-held"
        if not _possible(name, value):
            return "conditions-held"
        last = self._credible.get(name)
        return "sensor-jump" if last is not None and abs(value - last.value) > self._reach(name, time_s) else ""

    def _agreed(self, name: str, value: float) -> bool:
        """Tell whether enough stops in a row agree on a value after its jump."""
        seen = [other for other in self._jumped.get(name, []) if abs(other - value) <= COURSES[name].at_once]
        self._jumped[name] = [*seen, value]
        return len(self._jumped[name]) >= BELIEVED_STOPS

    def _reach(self, name: str, time_s: float) -> float:
        course = COURSES[name]
        return course.at_once + course.an_hour * max(0.0, time_s - self._credible[name].time_s) / 3600.0

    def _unknown(self, name: str, value: float) -> list[Remark]:
        """Return the doubt where the reading depends on what nobody has measured."""
        if name in self._credible or name not in self._needed:
            return []
        unit, stated = COURSES[name].unit, getattr(self._environment, name)
        read = f"{name} is not told" if math.isnan(value) else f"{name} reads {value:g} {unit}"
        text = (
            f"{read}, and {stated:g} {unit} of [environment] "
            'counts in its place: set it and source = "fixed" there, or solve with --environment FILE'
        )
        return [("air-unknown", text)]

    def _found(self, name: str, value: float, time_s: float) -> str:
        low, high = HALL[name]
        last, unit = self._credible.get(name), COURSES[name].unit
        if last is None or not _possible(name, value):
            return f"{name} reads {value:g} {unit}, which no hall has ({low:g} to {high:g})"
        return f"{name} reads {value:g} {unit} after {last.value:g} {unit}, {time_s - last.time_s:.0f} s ago"

    def _in_words(self, name: str, value: float, time_s: float) -> str:
        unit, last = COURSES[name].unit, self._credible.get(name)
        stated = getattr(self._environment, name)
        if math.isnan(value):
            remedy = "check the sensor's cable and power, or solve with --environment FILE"
            if last is None:
                return f"{name} has not been told yet: {stated:g} {unit} of [environment] is used; {remedy}"
            return f"{name} has not been told for a minute: {last.value:g} {unit} is held; {remedy}"
        found = self._found(name, value, time_s)
        if last is None:
            return f"{found}: {stated:g} {unit} of [environment] is used; check the sensor, its register and its scale"
        u = self._reach(name, time_s) / math.sqrt(3.0)
        return f"{found}: {last.value:g} {unit} is held, u = {u:.2g} {unit}; check the sensor, or solve with --environment FILE"


def _possible(name: str, value: float) -> bool:
    low, high = HALL[name]
    return low < value <= high
