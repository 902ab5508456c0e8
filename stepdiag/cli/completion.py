"""The shell's suggestions on the Tab key, and the names of controls and formats in the help; this
module imports nothing that takes time.
"""

from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json")]
Verbose = Annotated[bool, typer.Option("--verbose")]
TABLES = (
    "siemens",
    "fanuc",
    "heidenhain",
    "linuxcnc",
    "beckhoff",
    "mitsubishi",
    "fagor",
    "neutral",
)
"""The controls for which tables can be written: the names of
`stepdiag.exporters.profiles.registry.CONTROLLERS`.
"""
FIELDS = ("lattice", "etalon")
"""Outputs of ``export`` besides the controls: correction vectors of the whole volume, and the
Etalon Exchange format.
"""
PROGRAMS = ("siemens", "fanuc", "heidenhain", "linuxcnc")
"""The controls for which programs can be written."""
LANGUAGES = ("en", "de")
STREAMS = ("laser", "head", "air")
DECODED = ("csv", "parquet", "mcap")


def tables(begun: str) -> list[str]:
    """Return the controls whose names begin with the typed text."""
    return _beginning(TABLES, begun)


def exported(begun: str) -> list[str]:
    """Return the formats of ``export`` whose names begin with the typed text."""
    return _beginning((*TABLES, *FIELDS), begun)


def programs(begun: str) -> list[str]:
    """Return the controls with programs whose names begin with the typed text."""
    return _beginning(PROGRAMS, begun)


def languages(begun: str) -> list[str]:
    """Return the languages whose names begin with the typed text."""
    return _beginning(LANGUAGES, begun)


def streams(begun: str) -> list[str]:
    """Return the streams of a log whose names begin with the typed text."""
    return _beginning(STREAMS, begun)


def decoded_formats(begun: str) -> list[str]:
    """Return the formats of ``decode`` whose names begin with the typed text."""
    return _beginning(DECODED, begun)


def _beginning(names: tuple[str, ...], begun: str) -> list[str]:
    return [name for name in names if name.startswith(begun)]
