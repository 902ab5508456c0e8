"""Suggestions of the shell for the Tab key, and the names of controls and formats in the help. The
module imports nothing that takes time."""

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
"""The controls with compensation tables: the names in
`stepdiag.exporters.profiles.registry.CONTROLLERS`."""
FIELDS = ("lattice", "etalon")
"""Other formats of ``export``: correction vectors of the whole volume, and the Etalon Exchange
format."""
PROGRAMS = ("siemens", "fanuc", "heidenhain", "linuxcnc")
"""The controls with NC programs."""
LANGUAGES = ("en", "de")
STREAMS = ("laser", "head", "air")
DECODED = ("csv", "parquet", "mcap")


def tables(begun: str) -> list[str]:
    return _beginning(TABLES, begun)


def exported(begun: str) -> list[str]:
    return _beginning((*TABLES, *FIELDS), begun)


def programs(begun: str) -> list[str]:
    return _beginning(PROGRAMS, begun)


def languages(begun: str) -> list[str]:
    return _beginning(LANGUAGES, begun)


def streams(begun: str) -> list[str]:
    return _beginning(STREAMS, begun)


def decoded_formats(begun: str) -> list[str]:
    return _beginning(DECODED, begun)


def _beginning(names: tuple[str, ...], begun: str) -> list[str]:
    return [name for name in names if name.startswith(begun)]
