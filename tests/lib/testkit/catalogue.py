"""The sections of the catalogue of words."""

import tomllib
from importlib.resources import files

SECTIONS = tuple(
    tomllib.loads(
        files("stepdiag.texts").joinpath("catalogue.toml").read_text(encoding="utf-8")
    )
)
