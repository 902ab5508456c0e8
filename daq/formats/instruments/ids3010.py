"""`ids3010`: attocube IDS3010 fibre interferometers, JSON-RPC 2.0 over TCP 9090, polled.

Built from the maker's public interface (attocube-systems/IDS-APIs @e0fd387, 2025), not yet tested
on the instrument. Every request has an id, and the answer repeats the id, so no answer is assigned
to another request.
"""

from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import numpy as np

from stepdiag.base.messages import message
from stepdiag.daq.formats.framing.batch import NOTHING, Batch, judge_beam
from stepdiag.daq.formats.framing.checks import require, require_sign
from stepdiag.daq.formats.framing.lines import LINE_CAP, LineBuffer, quote
from stepdiag.daq.timing.samples import Flag, Samples


@dataclass(frozen=True, slots=True, kw_only=True)
class Ids3010Settings:
    """Settings for an IDS3010. ``axis`` counts from 1. ``interface`` is ``sen`` for firmware 2 and
    later, ``ids`` for older firmware. The beam strength is the contrast (per mille) divided by
    ``contrast_full``; the beam is lost below ``beam_threshold``. ``air`` reads the environmental
    unit, too.
    """

    axis: Literal[1, 2, 3] = 1
    interface: Literal["ids", "sen"] = "ids"
    poll_hz: float = 50.0
    contrast_full: float = 1000.0
    beam_threshold: float = 0.2
    air: bool = False
    sign: int = 1
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        require(self.axis in (1, 2, 3), "laser.ids3010.axis", "1, 2 or 3", self.axis)
        require(
            0 < self.poll_hz <= 100,
            "laser.ids3010.poll_hz",
            message("number-up-to", most=100),
            self.poll_hz,
        )
        require(
            0 < self.contrast_full <= 1000,
            "laser.ids3010.contrast_full",
            message("number-up-to", most=1000),
            self.contrast_full,
        )
        require(
            0 <= self.beam_threshold < 1,
            "laser.ids3010.beam_threshold",
            message("number-below-1"),
            self.beam_threshold,
        )
        require_sign(self.sign)


QUALITY_EVERY_S, AIR_EVERY_S = 0.2, 5.0
_DISPLACEMENT, _QUALITY = 1, 2
_AIR = {
    3: ("getTemperatureInDegrees", "air_temperature_c"),
    4: ("getPressureInHPa", "air_pressure_hpa"),
    5: ("getHumidityInPercent", "relative_humidity_percent"),
}
_MM = 1e-9
_UNKNOWN_METHOD = -32601
"""Error code of an unknown method (JSON-RPC 2.0, section 5.1)."""
_INVALID_AXES, _OVERDRIVEN = range(1, 8), 8
"""Numbers of the instrument's warnings. In a number from 1 to 7, each set bit marks an axis without
a valid reading. The number 8 means saturation.
"""


class _Answer(msgspec.Struct):
    id: int
    result: list[Any] | None = None
    error: Any = None


_decode = msgspec.json.Decoder(_Answer).decode


class Ids3010Decoder:
    """Decoder of an IDS3010. The host numbers the readings; a lost answer is not noticed."""

    gaps_visible = False

    def __init__(self, settings: Ids3010Settings) -> None:
        self._settings = settings
        self._lines = LineBuffer(LINE_CAP)
        self._number = 0
        self._beam = float("nan")
        names = f"com.attocube.{settings.interface}.displacement."
        self.request = _request(names + "getAxesDisplacement", _DISPLACEMENT)
        self.others = [
            (
                _request(names + "getAxisSignalQuality", _QUALITY, settings.axis - 1),
                QUALITY_EVERY_S,
            )
        ]
        if settings.air:
            self.others += [
                (_request(f"com.attocube.ecu.{method}", number), AIR_EVERY_S)
                for number, (method, _) in _AIR.items()
            ]
        self.poll_interval_s = 1 / settings.poll_hz
        self.nominal_rate_hz: float | None = settings.poll_hz
        self.latency_s = settings.latency_s

    def resync(self) -> None:
        self._lines = LineBuffer(LINE_CAP)

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        block = self._lines.feed(chunk)
        if not block:
            return NOTHING
        batch = Batch()
        for line in block[:-1].split(b"\n"):
            if line.strip():
                self._take(line, batch)
        return batch.samples(arrival_ns)

    def _take(self, line: bytes, batch: Batch) -> None:
        try:
            answer = _decode(line)
            numbers = [
                float(each) for each in answer.result or () if isinstance(each, (int, float))
            ]
        except (msgspec.MsgspecError, UnicodeDecodeError, OverflowError):
            batch.note("garbage", message("no-ids-answer", quoted=quote(line)))
            return
        if (
            answer.error is not None
            or not numbers
            or len(numbers) != len(answer.result or ())
        ):
            self._refused(answer, line, batch)
        elif answer.id == _DISPLACEMENT and len(numbers) == 4:
            self._add(int(numbers[0]), numbers[self._settings.axis], batch)
        elif answer.id == _QUALITY and len(numbers) == 3:
            self._beam = min(max(numbers[1] / self._settings.contrast_full, 0.0), 1.0)
        elif answer.id in _AIR and len(numbers) == 2 and numbers[0] == 0:
            batch.note("environment", name=_AIR[answer.id][1], value=numbers[1])
        else:
            self._refused(answer, line, batch)

    def _refused(self, answer: _Answer, line: bytes, batch: Batch) -> None:
        error = answer.error if isinstance(answer.error, dict) else {}
        why = error.get("message")
        quoted = quote(why.encode()) if isinstance(why, str) else quote(line)
        answers = message("instrument-answers", quoted=quoted)
        batch.note(
            "device",
            message("other-interface", what=answers)
            if error.get("code") == _UNKNOWN_METHOD
            else answers,
        )
        if answer.id == _DISPLACEMENT:
            self._append(float("nan"), Flag.DEVICE_ERROR, batch)

    def _add(self, warning: int, picometres: float, batch: Batch) -> None:
        flag = Flag(0)
        if warning in _INVALID_AXES:
            flag = Flag.BEAM_LOST if warning >> self._settings.axis - 1 & 1 else Flag(0)
        elif warning == _OVERDRIVEN:
            flag = Flag.SATURATED
        elif warning:
            flag = Flag.DEVICE_ERROR
            batch.note("device", message("instrument-warns", number=warning))
        self._append(picometres * _MM * self._settings.sign, flag, batch)

    def _append(self, position_mm: float, flag: Flag, batch: Batch) -> None:
        flags, beam = np.array([flag], dtype=np.uint16), np.array([self._beam])
        judge_beam(beam, self._settings.beam_threshold, flags)
        batch.add(np.array([self._number]), np.array([position_mm]), flags, beam=beam)
        self._number += 1


def _request(method: str, number: int, *parameters: int) -> bytes:
    asked: dict[str, Any] = {"jsonrpc": "2.0", "method": method, "id": number, "api": 2}
    return msgspec.json.encode(asked | ({"params": list(parameters)} if parameters else {}))
