"""A sensor of air and material that sends one text line per measurement; the survey file describes
the line.

Vaisala PTU300 in its factory setting: the sensor answers `SEND` with pressure, temperature and
humidity (``P= 1013.2 hPa T= 31.1 'C RH= 38.3 %RH``; PTU300 User Manual p. 103), optionally after a
prompt and the echo of the request. In the mode `RUN` the sensor sends the same lines without
requests. **Not checked against a document:** asterisks replace a quantity that the sensor cannot
measure.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from stepdiag.base.messages import message
from stepdiag.daq.formats.framing.batch import Batch
from stepdiag.daq.formats.framing.checks import require
from stepdiag.daq.formats.framing.lines import LineBuffer, quote
from stepdiag.daq.formats.instruments.line import line_pattern
from stepdiag.daq.timing.samples import Flag, Samples

MEASURED = (
    "air_temperature_c",
    "air_pressure_hpa",
    "relative_humidity_percent",
    "material_temperature_c",
)
"""The quantities that a line may contain: names of groups in the pattern, in the order of the
channels.
"""
PTU300 = (
    r"[>\s]*P\s*=\s*(?P<air_pressure_hpa>[-+.0-9*]+)\s*hPa\s+T\s*=\s*(?P<air_temperature_c>"
    r"[-+.0-9*]+)\s*'C"
    r"\s+RH\s*=\s*(?P<relative_humidity_percent>[-+.0-9*]+)\s*%RH\s*"
)
TemperatureUnit = Literal["C", "F", "K"]
PressureUnit = Literal["hPa", "mbar", "kPa", "Pa", "bar", "mmHg", "inHg"]
HPA = {
    "hPa": 1.0,
    "mbar": 1.0,
    "kPa": 10.0,
    "Pa": 0.01,
    "bar": 1000.0,
    "mmHg": 1.33322387415,
    "inHg": 33.8638866667,
}
_LINE_CAP = 500
"""Longest line in bytes; a line of a PTU300 has fewer than 60."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AirSettings:
    """Format of a line from the sensor of air and material.

    ``pattern`` matches the whole line and has at least one group of `MEASURED`. The link sends
    ``greeting`` once, and ``request`` every ``poll_s`` seconds. ``request`` is empty for a sensor
    that sends without requests.
    """

    pattern: str
    temperature_unit: TemperatureUnit = "C"
    pressure_unit: PressureUnit = "hPa"
    request: str = ""
    greeting: str = ""
    poll_s: float = 2.0
    terminator: Literal["\n", "\r"] = "\n"

    def __post_init__(self) -> None:
        groups = line_pattern(self.pattern, "survey: environment.sensor.pattern").groupindex
        require(
            bool(groups),
            "environment.sensor.pattern",
            message("named-group", group="(?P<air_temperature_c>...)"),
            self.pattern,
        )
        require(
            set(groups) <= set(MEASURED),
            "environment.sensor.pattern",
            message("no-other-groups", names=MEASURED),
            sorted(groups),
        )
        require(
            (self.request + self.greeting).isascii(),
            "environment.sensor.request",
            message("plain-ascii"),
            self.request,
        )


@cache
def quantities_in(pattern: str) -> tuple[str, ...]:
    groups = line_pattern(pattern, "survey: environment.sensor.pattern").groupindex
    return tuple(name for name in MEASURED if name in groups)


class AirDecoder:
    """Decoder of a sensor of air and material that sends without requests.

    A measurement is a sample without position; ``channels`` has shape (count, 4) in the order of
    `MEASURED`, NaN for a missing quantity. Every number is also an ``environment`` notice. A line
    that is neither a measurement nor the echo of a request is a garbage notice.
    """

    gaps_visible = False
    nominal_rate_hz: float | None = None
    latency_s = 0.0

    def __init__(self, settings: AirSettings) -> None:
        self._settings = settings
        self._pattern = line_pattern(settings.pattern, "survey: environment.sensor.pattern")
        self._end = settings.terminator.encode()
        self._echo = settings.request.strip().encode("ascii").lower()
        self._number = 0
        self.resync()
        self.greeting = settings.greeting.encode("ascii")

    def resync(self) -> None:
        """Discard the incomplete line. The next line may lack its beginning and still match the
        pattern.
        """
        self._lines = LineBuffer(_LINE_CAP, self._end)
        if not self._settings.request:
            self._lines.skip_line()

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        batch = Batch()
        for line in self._lines.feed(chunk).split(self._end)[:-1]:
            if line.strip(b"> \t\r\n\0").lower() not in (b"", self._echo):
                self._add(line, batch)
        return batch.samples(arrival_ns)

    def _add(self, line: bytes, batch: Batch) -> None:
        found = (
            self._pattern.fullmatch(line.decode("latin-1").strip("\r\n\0"))
            if len(line) <= _LINE_CAP
            else None
        )
        if found is None:
            batch.note("garbage", message("line-no-match", quoted=quote(line)))
            return
        groups = found.groupdict()
        values = np.array([self._value(name, groups.get(name)) for name in MEASURED])
        known = np.isfinite(values)
        for name, value in zip(
            np.array(MEASURED)[known].tolist(), values[known].tolist(), strict=True
        ):
            batch.note("environment", name=name, value=value)
        flags = np.array([0 if known.any() else Flag.DEVICE_ERROR], dtype=np.uint16)
        batch.add(
            np.array([self._number]), np.array([np.nan]), flags, channels=values[None, :]
        )
        self._number += 1

    def _value(self, name: str, text: str | None) -> float:
        try:
            number = float(text) if text is not None else math.nan
        except ValueError:
            return math.nan
        if name == "air_pressure_hpa":
            return number * HPA[self._settings.pressure_unit]
        if name == "relative_humidity_percent" or self._settings.temperature_unit == "C":
            return number
        return (
            number - 273.15
            if self._settings.temperature_unit == "K"
            else (number - 32.0) / 1.8
        )


class AskedAirDecoder(AirDecoder):
    """Decoder of a sensor of air and material that answers requests."""

    def __init__(self, settings: AirSettings) -> None:
        super().__init__(settings)
        self.request = settings.request.encode("ascii")
        self.poll_interval_s = settings.poll_s
        self.nominal_rate_hz = 1.0 / settings.poll_s
