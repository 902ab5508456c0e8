"""The user's assumptions about machine, laser and hall, from the ``[uncertainty]`` of a survey
file.
"""

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from stepdiag.base.conditions.air import Air, AirUncertainty, index_u
from stepdiag.base.conditions.assumptions import Assumptions, usual_sizes
from stepdiag.base.messages import message
from stepdiag.base.settings import convert, read_toml, refuse
from stepdiag.daq.survey.models import Environment, Survey, Tolerance, Uncertainty

VACUUM_WAVELENGTH_NM = 633.0
"""Wavelength in nm for the uncertainty of the refractive index, which hardly depends on the
wavelength.
"""


def assumptions_of(survey: Survey) -> Assumptions:
    """Return the assumptions of a survey. Lengths reduced to 20 C carry the uncertainty of the
    material temperature.
    """
    machine = survey.machine
    warm = survey.environment.material_temperature_c
    return replace(
        _stated(survey.uncertainty, survey.environment),
        expansion_um_m_c=machine.expansion_um_m_c,
        material_c=(warm, warm, warm),
        reduced_to_20_c=machine.apply_expansion,
    )


def parse_uncertainty(text: str, source: str) -> Assumptions:
    """Return the assumptions under ``[uncertainty]`` of a TOML text; a missing assumption has its
    usual value.

    Raises UsageError for unknown names and impossible values.
    """
    document = read_toml(text, source)
    if "uncertainty" not in document:
        raise refuse(source, "uncertainty", message("table-uncertainty"), list(document))
    return _stated(
        convert(document["uncertainty"], Uncertainty, source, "uncertainty"), Environment()
    )


def parse_tolerance(text: str, source: str) -> dict[str, float]:
    """Return the tolerances by quantity under ``[tolerance]`` of a TOML text. Raises the errors of
    `parse_uncertainty`.
    """
    document = read_toml(text, source)
    if "tolerance" not in document:
        raise refuse(source, "tolerance", "a table [tolerance]", list(document))
    return convert(document["tolerance"], Tolerance, source, "tolerance").by_quantity()


def _index(section: Uncertainty, environment: Environment) -> float:
    """Return the relative standard uncertainty of refractive index and wavelength, from
    certificates or, without certificates, as assumed.
    """
    sensors = AirUncertainty(
        temperature_c=section.u_air_temperature_c,
        pressure_hpa=section.u_air_pressure_hpa,
        humidity_percent=section.u_relative_humidity_percent,
    )
    if not any(
        (
            sensors.temperature_c,
            sensors.pressure_hpa,
            sensors.humidity_percent,
            section.u_laser_ppm,
        )
    ):
        return 1e-6 * section.index_ppm
    air = Air(
        temperature_c=np.array([environment.air_temperature_c]),
        pressure_hpa=np.array([environment.air_pressure_hpa]),
        humidity_percent=np.array([environment.relative_humidity_percent]),
    )
    return float(
        np.hypot(index_u(air, VACUUM_WAVELENGTH_NM, sensors)[0], 1e-6 * section.u_laser_ppm)
    )


def _stated(section: Uncertainty, environment: Environment) -> Assumptions:
    return Assumptions(
        **_sizes(section),
        index=_index(section, environment),
        index_setup=1e-6 * section.index_setup_ppm,
        u_material_c=section.u_material_c,
        # The template contains the usual value, so the usual value is no statement by a person.
        material_stated=section.u_material_c != Assumptions().u_material_c,
        u_expansion_um_m_c=section.u_expansion_um_m_c,
        alignment_mrad=section.alignment_mrad,
        reading_um=section.reading_um,
    )


def _sizes(section: Uncertainty) -> dict[str, Any]:
    stated = msgspec.structs.asdict(section)
    usual = usual_sizes(section.machine_class, section.feedback)
    return {
        name: size if stated[name] is None else stated[name] for name, size in usual.items()
    }
