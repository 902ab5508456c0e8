"""From the survey file to the decoders of the survey's streams."""

from typing import Any

import msgspec

from stepdiag.daq.formats.instruments.air import PTU300, AirSettings, quantities_in
from stepdiag.daq.formats.instruments.angles import (
    ELCOMAT,
    ELCOMAT_GREETING,
    WYLER,
    AnglesSettings,
)
from stepdiag.daq.formats.instruments.fourdof import FourdofSettings
from stepdiag.daq.formats.instruments.framed import FramesSettings
from stepdiag.daq.formats.instruments.ids3010 import Ids3010Settings
from stepdiag.daq.formats.instruments.lasertex import LasertexSettings
from stepdiag.daq.formats.instruments.line import LineSettings
from stepdiag.daq.formats.instruments.nd import NdSettings
from stepdiag.daq.formats.instruments.qudis import QudisSettings
from stepdiag.daq.formats.instruments.tqd import TqdSettings
from stepdiag.daq.formats.instruments.umd.decoder import UmdSettings
from stepdiag.daq.formats.registry import FormatSettings, make_decoder
from stepdiag.daq.records.events import Stream
from stepdiag.daq.survey.environment import AIR, NAMES
from stepdiag.daq.survey.models import (
    AirSensor,
    FramesSection,
    Head,
    Laser,
    LineSection,
    Survey,
)
from stepdiag.daq.timing.samples import CountingDecoder, Decoder

LASER_TELLS = {"ids3010": AIR, "lasertex": NAMES}
"""The quantities that a laser's own sensors measure: the environmental unit of an IDS3010, the
wireless sensors of a Lasertex.
"""


def laser_decoder(survey: Survey) -> Decoder:
    return make_decoder(
        survey.laser.format,
        laser_settings(survey.laser, air=survey.environment.source == "laser"),
    )


def repeats_after(survey: Survey) -> float:
    """Return the number of values of the laser's sample number before the number repeats; 0 for a
    laser without a sample number.
    """
    decoder = laser_decoder(survey)
    return decoder.repeats_after if isinstance(decoder, CountingDecoder) else 0.0


def head_decoder(survey: Survey) -> Decoder:
    if survey.head is None:
        raise ValueError("a survey without [head] has no stream of a head")
    return make_decoder(survey.head.format, head_settings(survey.head))


def air_decoder(survey: Survey) -> Decoder:
    if survey.air_sensor is None:
        raise ValueError("a survey without [environment.sensor] has no stream of one")
    return make_decoder(survey.air_sensor.format, air_settings(survey.air_sensor))


def decoders(survey: Survey) -> dict[Stream, Decoder]:
    """Return a new decoder of every stream of the survey, the laser's stream first."""
    found: dict[Stream, Decoder] = {"laser": laser_decoder(survey)}
    if survey.head is not None:
        found["head"] = head_decoder(survey)
    if survey.air_sensor is not None:
        found["air"] = air_decoder(survey)
    return found


def laser_settings(laser: Laser, *, air: bool = False) -> FormatSettings:
    """Return the settings of the laser's format, whose section must exist. With ``air``, the
    settings also request the air from the laser.
    """
    common: dict[str, Any] = {"sign": laser.sign, "latency_s": laser.latency_s}
    if laser.format == "ids3010":
        return Ids3010Settings(**msgspec.structs.asdict(laser.ids3010), **common, air=air)
    if laser.format == "lasertex":
        return LasertexSettings(**msgspec.structs.asdict(laser.lasertex), **common)
    if laser.format == "qudis":
        return QudisSettings(
            axis=laser.qudis.axis,
            average=laser.qudis.average,
            absolute=laser.qudis.absolute,
            **common,
        )
    if laser.format == "umd":
        return UmdSettings(
            axis=laser.umd.axis,
            phase_bits=laser.umd.phase_bits,
            wavelength_nm=laser.wavelength_nm,
            optics=laser.optics,
            sign=laser.sign,
            latency_s=laser.latency_s,
        )
    if laser.line is not None and laser.format == "line":
        return _line_settings(laser, laser.line)
    if laser.frames is not None and laser.format == "frames":
        return _frames(laser, laser.frames)
    return NdSettings(**msgspec.structs.asdict(laser.nd), **common)


def _line_settings(laser: Laser, line: LineSection) -> LineSettings:
    return LineSettings(
        pattern=line.pattern,
        unit=line.unit,
        scale=line.scale,
        counter_modulus=line.counter_modulus or None,
        beam_threshold=line.beam_threshold,
        beam_full=line.beam_full,
        rate_hz=line.rate_hz,
        encoding=line.encoding,
        terminator=line.terminator,
        wavelength_nm=laser.wavelength_nm,
        optics=laser.optics,
        sign=laser.sign,
        latency_s=laser.latency_s,
    )


def _frames(laser: Laser, frames: FramesSection) -> FramesSettings:
    return FramesSettings(
        **msgspec.structs.asdict(frames),
        wavelength_nm=laser.wavelength_nm,
        optics=laser.optics,
        sign=laser.sign,
        latency_s=laser.latency_s,
    )


def head_settings(head: Head) -> FormatSettings:
    if head.format == "tqd":
        tqd = head.tqd
        return TqdSettings(
            poll_hz=tqd.poll_hz,
            full_sum_v=tqd.full_sum_v,
            beam_threshold=tqd.beam_threshold,
            latency_s=head.latency_s,
        )
    if head.angular:
        return _angles(head)
    frames = head.fourdof
    return FourdofSettings(
        encoding=frames.encoding,
        rate_hz=frames.rate_hz,
        full_sum=frames.full_sum,
        beam_threshold=frames.beam_threshold,
        latency_s=head.latency_s,
    )


def promised(survey: Survey) -> tuple[str, ...]:
    """Return the conditions that the survey takes from a sensor or the laser, without conditions
    from the machine.
    """
    if survey.air_sensor is not None:
        return quantities_in(air_pattern(survey.air_sensor))
    if survey.environment.source != "laser":
        return ()
    return tuple(
        name
        for name in LASER_TELLS.get(survey.laser.format, ())
        if name not in survey.plc.signal_names
    )


def air_pattern(sensor: AirSensor) -> str:
    return sensor.pattern or (PTU300 if sensor.format == "ptu300" else "")


def air_settings(sensor: AirSensor) -> AirSettings:
    """Return the settings of the sensor of air and material; by default of a PTU300, which answers
    requests in its factory setting.
    """
    return AirSettings(
        pattern=air_pattern(sensor),
        temperature_unit=sensor.temperature_unit,
        pressure_unit=sensor.pressure_unit,
        request=sensor.request or ("SEND\r" if sensor.format == "ptu300" else ""),
        greeting=sensor.greeting,
        poll_s=sensor.poll_s,
        terminator=sensor.terminator,
    )


def _angles(head: Head) -> AnglesSettings:
    section, elcomat = head.angles, head.format == "elcomat"
    return AnglesSettings(
        pattern=section.pattern or (ELCOMAT if elcomat else WYLER),
        unit=section.unit,
        greeting=ELCOMAT_GREETING if elcomat else "",
        request="" if elcomat else "P",
        poll_hz=section.poll_hz,
        latency_s=head.latency_s,
    )
