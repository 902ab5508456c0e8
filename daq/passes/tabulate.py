"""From passes to the solver's table of readings, the only place where readings are corrected for
air and material.
"""

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from stepdiag.base.conditions.air import Air, Done, displacement_mm, refractive_index
from stepdiag.base.conditions.expansion import expansion_um, reading_at_20_c_mm
from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.base.readings.runs import beam_mm
from stepdiag.base.volume import Vector
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.passes.counts import Counted, on_one_count
from stepdiag.daq.passes.driven import Pass
from stepdiag.daq.passes.stretches import OnZero
from stepdiag.daq.survey.environment import AIR
from stepdiag.daq.survey.models import Environment, Survey


def tabulate(
    survey: Survey, passes: list[Pass], environment: Mapping[str, float] | None = None
) -> Readings:
    """Return the readings of complete laser passes, in the order of passes and stops.

    Readings are relative to the first stop of the setup while the laser's count is unbroken;
    ``zero`` is the number of the unbroken count. For an instrument that counts in vacuum
    wavelengths, the air of each stop is used. If the survey file requests it, each axis is reduced
    to 20 C. Runs of the 4-DOF head have no laser reading and are left out. ``environment`` contains
    conditions, by their names in the survey file, that replace the recorded values.
    """
    stated = dict(environment or {})
    survey = msgspec.structs.replace(
        survey, environment=msgspec.structs.replace(survey.environment, **stated)
    )
    used = [each for each in passes if each.whole and not each.route.travel.is_fourdof]
    counted = on_one_count(used)
    first = {
        (one.driven.route.setup, one.zero): one
        for one in sorted(counted, key=lambda one: -one.driven.number)
    }
    tables = [
        _pass_rows(survey, one, first[one.driven.route.setup, one.zero], stated)
        for one in counted
    ]
    begin = min(
        (stop.time_s for each in used for stop in each.chosen().values()), default=0.0
    )
    return make_readings(
        setup=[
            each.route.setup for each, rows in zip(used, tables, strict=True) for _ in rows[0]
        ],
        pass_number=[
            each.number for each, rows in zip(used, tables, strict=True) for _ in rows[0]
        ],
        stop=[stop for rows in tables for stop in range(len(rows[0]))],
        position_mm=np.vstack([[stop.position_mm for stop in rows[1]] for rows in tables])
        if used
        else np.zeros((0, 3)),
        reading_mm=np.concatenate([rows[0] for rows in tables]) if used else np.zeros(0),
        u_um=[stop.u_um for rows in tables for stop in rows[1]],
        temperature_c=[
            _known_material_c(survey.environment, stop) for rows in tables for stop in rows[1]
        ],
        time_s=[stop.time_s - begin for rows in tables for stop in rows[1]],
        beam_mm=np.vstack([_beam(survey, each) for each in used]) if used else None,
        zero=[one.zero for one, rows in zip(counted, tables, strict=True) for _ in rows[0]],
        at_20_c=[survey.machine.apply_expansion for rows in tables for _ in rows[0]],
        turned=[stop.turned for rows in tables for stop in rows[1]],
    )


def _pass_rows(
    survey: Survey, one: Counted, first: Counted, stated: dict[str, float]
) -> tuple[Vector, list[OnZero]]:
    """Return the corrected readings of a pass and their stops. The readings are relative to the
    first stop of the ``first`` pass on the same count. The conditions ``stated`` afterwards replace
    the recorded conditions of the stops.
    """
    chosen = one.driven.chosen()
    stops = [
        msgspec.structs.replace(chosen[index], **stated)
        for index in range(len(one.driven.route))
    ]
    counts = np.array([stop.reading_mm for stop in stops]) + one.offset_mm
    origin = msgspec.structs.replace(first.driven.chosen()[0], **stated)
    readings = counts - (origin.reading_mm + first.offset_mm)
    if not survey.laser.compensated:
        readings = in_this_air(
            survey, first.driven, [origin, *stops], np.concatenate([[0.0], readings])
        )[1:]
    if survey.machine.apply_expansion:
        readings = _at_20_c(survey, one.driven, origin, stops, readings)
    return readings, stops


def in_this_air(
    survey: Survey, first: Pass, stops: Sequence[CapturedStop], readings: Vector
) -> Vector:
    """Return the true displacements in mm since the first of ``stops``. The effect of the dead path
    is zero at this first stop.
    """
    values = {
        name: np.array([_environment(survey.environment, stop, name) for stop in stops])
        for name in AIR
    }
    air = Air(
        temperature_c=values["air_temperature_c"],
        pressure_hpa=values["air_pressure_hpa"],
        humidity_percent=values["relative_humidity_percent"],
    )
    index = refractive_index(air, survey.laser.wavelength_nm)
    start_mm = 0.0 if first.route.outward else float(-first.route.nominal_mm[-1])
    dead_path = survey.laser.dead_path_mm + start_mm
    return displacement_mm(
        readings, index, zero_index=float(index[0]), dead_path_mm=dead_path, done=Done(0)
    )


def _at_20_c(
    survey: Survey,
    each: Pass,
    origin: CapturedStop,
    stops: Sequence[CapturedStop],
    readings: Vector,
) -> Vector:
    way = np.array(each.route.travel.signs) * np.array(survey.volume.size_mm)
    along = way / np.linalg.norm(way)
    temperature = np.array([[_material_c(survey.environment, stop)] * 3 for stop in stops])
    travel = np.array([np.subtract(stop.position_mm, origin.position_mm) for stop in stops])
    grown = expansion_um(travel, along, survey.machine.expansion_um_m_c, temperature)
    return reading_at_20_c_mm(readings, grown, Done(0))


def _beam(survey: Survey, each: Pass) -> Vector:
    setup, count = each.route.travel, len(each.route)
    if not setup.shift:
        return np.full((count, 3), np.nan)
    return np.tile(beam_mm(survey.planned, survey.planned.run_of(setup.name)), (count, 1))


def _environment(environment: Environment, stop: CapturedStop, name: str) -> float:
    measured = getattr(stop, name) if environment.source != "fixed" else None
    return float(measured if measured is not None else getattr(environment, name))


def _known_material_c(environment: Environment, stop: CapturedStop) -> float:
    """Return the material temperature from a sensor or the operator, otherwise NaN, because a
    machine without thermometer is not at 20 C.
    """
    if environment.source != "fixed" and stop.material_temperature_c is None:
        return float("nan")
    return _material_c(environment, stop)


def _material_c(environment: Environment, stop: CapturedStop) -> float:
    return _environment(environment, stop, "material_temperature_c")
