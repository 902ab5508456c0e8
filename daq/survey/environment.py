"""Conditions that a person states after a survey; they replace recorded conditions."""

from stepdiag.base.messages import message
from stepdiag.base.settings import convert, read_toml, refuse
from stepdiag.daq.survey.models import Environment

AIR = ("air_temperature_c", "air_pressure_hpa", "relative_humidity_percent")
"""The quantities on which the refractive index of the air depends."""
NAMES = (*AIR, "material_temperature_c")


def parse_environment(text: str, source: str) -> dict[str, float]:
    """Return the conditions in a TOML text by name, with or without the header ``[environment]`` of
    a survey file.

    A condition that is missing in the text is unchanged. Raises UsageError for unknown names,
    impossible values, or an empty text.
    """
    document = read_toml(text, source)
    table = document.get("environment", document)
    stated = convert(table, Environment, source, "environment")
    named = [name for name in NAMES if name in table]
    if not named:
        raise refuse(
            source, "environment", message("at-least-one", names=list(NAMES)), list(table)
        )
    return {name: float(getattr(stated, name)) for name in named}
