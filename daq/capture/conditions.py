"""Air and material at a stop, judged while recording: impossible values and jumps from the last
value are rejected.

For a rejected value the last credible value is used, with an uncertainty that grows with its age.
Without an earlier value, the value of the survey file is used, and the stop is doubted if its
reading depends on this value. The reading is recorded in any case; the conditions can be corrected
later.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, cast

import msgspec

from stepdiag.base.conditions.air import HALL
from stepdiag.base.messages import Message, message
from stepdiag.daq.capture.noise import LEAST_SAMPLES
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.environment import AIR
from stepdiag.daq.survey.formats import promised
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.stream import StreamBuffer

STALE_NS = 60_000_000_000
"""Age in ns of a sensor's last value above which the sensor counts as silent."""


@dataclass(frozen=True, slots=True)
class Course:
    """Largest change of a quantity from its last credible value: a constant, plus a change per
    hour; and the unit of both.
    """

    at_once: float
    an_hour: float
    unit: str


CONDITIONS: Mapping[str, Message] = {
    "material_temperature_c": message("material-temperature-c"),
    "air_temperature_c": message("air-temperature-c"),
    "air_pressure_hpa": message("air-pressure-hpa"),
    "relative_humidity_percent": message("relative-humidity-percent"),
}
"""The name of each condition in messages."""
COURSES: Mapping[str, Course] = {
    "material_temperature_c": Course(1.0, 5.0, "C"),
    "air_temperature_c": Course(2.0, 10.0, "C"),
    "air_pressure_hpa": Course(2.0, 5.0, "hPa"),
    "relative_humidity_percent": Course(15.0, 30.0, "%"),
}
"""Largest changes of the conditions: an opened door changes the air from one stop to the next, and
the weather changes the pressure within an hour.
"""


UNITS_HPA: Mapping[str, float] = {
    "kPa": 10.0,
    "mmHg": 1.333224,
    "inHg": 33.86389,
    "Pa": 0.01,
    "psi": 68.94757,
    "bar": 1000.0,
}
UNIT_NEAR = 0.06
"""Largest relative difference by weather between a pressure and the pressure of [environment]. A
pressure that is within this difference only in another unit was sent in that unit: 760 mmHg is the
air at sea level, 760 hPa the air at 2300 m.
"""


class Credible(msgspec.Struct, frozen=True, kw_only=True):
    """An accepted value of a condition, and the time of this value (seconds since 1970)."""

    value: float
    time_s: float


class Teller(Protocol):
    """A source of readings of the air and of the material's temperature."""

    @property
    def conditions(self) -> Mapping[str, float]:
        """The newest values of air and material, by the names of the signals."""
        ...


Trouble = Literal["conditions-held.silent", "conditions-held.implausible", "sensor-jump"]


@dataclass(slots=True)
class Judged:
    """The ``signals`` with the accepted values of the sensors. ``held`` are the conditions with a
    replaced value. ``remarks`` are the new remarks. ``doubted`` are the doubts about conditions.
    """

    signals: Signals
    held: tuple[str, ...] = ()
    remarks: list[Message] = field(default_factory=list)
    doubted: list[Message] = field(default_factory=list)


def is_sensed(survey: Survey) -> bool:
    """Return whether the laser or a sensor sends values of air and material; otherwise `with_air`
    changes nothing.
    """
    return survey.environment.source == "laser" or bool(promised(survey))


def with_air(
    survey: Survey,
    signals: Signals,
    sensor: StreamBuffer,
    now_ns: int,
    *,
    silent: float | None = None,
) -> Signals:
    """Return the signals with the values sent by the sensor, or by the laser's own sensors, where
    the survey takes air and material from them.

    An expected quantity that the sensor has not sent for `STALE_NS` gets the value ``silent``.
    `Conditions` requires NaN as this value.
    """
    names = condition_names(survey, sensor)
    # called for every event: the sensor's bytes are decoded only if its values are used
    if not names:
        return signals
    fresh = sensor.conditions_since(now_ns - STALE_NS)
    return replace(signals, **{name: fresh.get(name, silent) for name in names})  # type: ignore[arg-type]


def condition_names(survey: Survey, sensor: Teller) -> tuple[str, ...]:
    """Return the names of the conditions that the survey expects from a sensor or the laser, and of
    the conditions that the laser sends in addition.
    """
    own = promised(survey)
    own_sensors = sensor.conditions if survey.environment.source == "laser" else ()
    return (*own, *(name for name in own_sensors if name in COURSES and name not in own))


def needed_conditions(survey: Survey) -> tuple[str, ...]:
    """Return the conditions that the readings of a survey depend on."""
    air = () if survey.laser.compensated else AIR
    return (*air, *(("material_temperature_c",) if survey.machine.apply_expansion else ()))


def believed_before(
    survey: Survey,
    sensor: StreamBuffer,
    now_ns: int,
    wall_offset_ns: int,
    credible: Mapping[str, Credible],
) -> dict[str, Credible]:
    """Return the credible values at the beginning of a log: the values of the previous logs,
    replaced by credible values that the sensor has sent since.
    """
    fresh = sensor.conditions_since(now_ns - STALE_NS)
    measured = {
        name: fresh[name] for name in condition_names(survey, sensor) if name in fresh
    }
    conditions = Conditions(survey, credible)
    conditions.judge(replace(Signals(), **measured), (now_ns + wall_offset_ns) * 1e-9)  # type: ignore[arg-type]
    return conditions.credible


class Conditions:
    """Follows air and material from stop to stop. ``credible`` are the last accepted values of the
    previous logs.
    """

    def __init__(self, survey: Survey, credible: Mapping[str, Credible]) -> None:
        self._environment, self._signals = survey.environment, survey.plc.signals
        self._needed = needed_conditions(survey)
        self._credible = dict(credible)
        self._trouble: dict[str, Trouble | None] = {}
        self._jumped: dict[str, list[float]] = {}

    @property
    def credible(self) -> dict[str, Credible]:
        """Return the last accepted value of each condition."""
        return dict(self._credible)

    def judge(self, signals: Signals, time_s: float) -> Judged:
        """Return the signals of a stop with the values of air and material in use. The signals are
        unchanged if the survey file fixes the conditions.
        """
        if self._environment.source == "fixed":
            return Judged(signals)
        judged = Judged(signals)
        believed = {
            name: self._believe(name, value, time_s, judged)
            for name in COURSES
            if (value := getattr(signals, name)) is not None
        }
        judged.signals = replace(signals, **believed)  # type: ignore[arg-type]
        return judged

    def _believe(
        self, name: str, value: float, time_s: float, judged: Judged
    ) -> float | None:
        """Return the value of a condition to use: the sensor's value, the last credible value, or
        None without either.
        """
        last = self._credible.get(name)
        if math.isnan(value) and last is not None and time_s - last.time_s < STALE_NS * 1e-9:
            return last.value  # a value from before this log
        code = self._wrong(name, value, time_s)
        if code == "sensor-jump" and self._agreed(name, value):
            judged.doubted.append(
                message(
                    "sensor-jump.believed",
                    found=self._found(name, value, time_s),
                    count=LEAST_SAMPLES,
                )
            )
            code = None
        if code and self._trouble.get(name) != code:
            judged.remarks.append(self._in_words(code, name, value, time_s))
            judged.doubted += self._unknown(name, value)
        self._trouble[name] = code
        if not code:
            self._jumped.pop(name, None)
            self._credible[name] = Credible(value=value, time_s=time_s)
            return value
        judged.held = (*judged.held, name)
        held = self._credible.get(name)
        return None if held is None else held.value

    def _wrong(self, name: str, value: float, time_s: float) -> Trouble | None:
        """Return the code of the finding that rejects a value; None for an accepted value."""
        if math.isnan(value):
            return "conditions-held.silent"
        if not _possible(name, value) or self._unit(name, value):
            return "conditions-held.implausible"
        last = self._credible.get(name)
        return (
            "sensor-jump"
            if last is not None and abs(value - last.value) > self._reach(name, time_s)
            else None
        )

    def _unit(self, name: str, value: float) -> str:
        """Return the unit other than hPa in which a pressure agrees with [environment]; empty if no
        other unit agrees.
        """
        stated = self._environment.air_pressure_hpa
        if name != "air_pressure_hpa" or name in self._credible:
            return ""
        return next(
            (
                unit
                for unit, hpa in UNITS_HPA.items()
                if abs(value * hpa / stated - 1) <= UNIT_NEAR
            ),
            "",
        )

    def _agreed(self, name: str, value: float) -> bool:
        """Return whether `LEAST_SAMPLES` consecutive stops agree on a value after its jump; the
        jump itself remains a doubt.
        """
        seen = [
            other
            for other in self._jumped.get(name, [])
            if abs(other - value) <= COURSES[name].at_once
        ]
        self._jumped[name] = [*seen, value]
        return len(self._jumped[name]) >= LEAST_SAMPLES

    def _reach(self, name: str, time_s: float) -> float:
        course = COURSES[name]
        return (
            course.at_once
            + course.an_hour * max(0.0, time_s - self._credible[name].time_s) / 3600.0
        )

    def _unknown(self, name: str, value: float) -> list[Message]:
        """Return the doubt of a reading that depends on an unmeasured condition; empty for any
        other reading.
        """
        if name in self._credible or name not in self._needed:
            return []
        unit, stated = COURSES[name].unit, getattr(self._environment, name)
        counts = _with_unit(stated, unit)
        if math.isnan(value):
            return [message("air-unknown.silent", name=CONDITIONS[name], stated=counts)]
        return [
            message(
                "air-unknown",
                name=CONDITIONS[name],
                read=_with_unit(value, unit),
                stated=counts,
            )
        ]

    def _found(self, name: str, value: float, time_s: float) -> Message:
        low, high = HALL[name]
        last, unit = self._credible.get(name), COURSES[name].unit
        if last is None or not _possible(name, value):
            return message(
                "no-hall-has",
                name=CONDITIONS[name],
                read=_with_unit(value, unit),
                low=low,
                high=high,
            )
        before, ago_s = _with_unit(last.value, unit), time_s - last.time_s
        return message(
            "reads-after",
            name=CONDITIONS[name],
            read=_with_unit(value, unit),
            before=before,
            ago_s=ago_s,
        )

    def _in_words(self, code: Trouble, name: str, value: float, time_s: float) -> Message:
        unit, last = COURSES[name].unit, self._credible.get(name)
        stated = getattr(self._environment, name)
        if math.isnan(value):
            if last is None:
                return message(
                    "conditions-held.silent",
                    name=CONDITIONS[name],
                    stated=_with_unit(stated, unit),
                )
            return message(
                "conditions-held.silent-held",
                name=CONDITIONS[name],
                held=_with_unit(last.value, unit),
            )
        unit_of, signal = self._unit(name, value), self._signals.get(name)
        if unit_of and signal is not None:
            scale = signal.scale * UNITS_HPA[unit_of]
            return message(
                "conditions-held.unit",
                name=CONDITIONS[name],
                read=_with_unit(value, unit),
                unit=unit_of,
                hpa=value * UNITS_HPA[unit_of],
                line=f"plc.signals.{name}.scale",
                value=f"{scale:.6g}",
                stated=_with_unit(stated, unit),
            )
        found, key = (
            self._found(name, value, time_s),
            cast('Literal["conditions-held.implausible", "sensor-jump"]', code),
        )
        if last is None:
            return message(
                "conditions-held.never", found=found, stated=_with_unit(stated, unit)
            )
        u = self._reach(name, time_s) / math.sqrt(3.0)
        return message(
            key,
            found=found,
            held=_with_unit(last.value, unit),
            u=message("with-unit", value=u, unit=unit),
        )


def _with_unit(value: float, unit: str) -> Message:
    return message("value", value=value, unit=unit)


def _possible(name: str, value: float) -> bool:
    low, high = HALL[name]
    return low < value <= high
