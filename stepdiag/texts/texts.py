"""The words of the page and the report in English and German, from a single catalogue;
`texts.explained` contains the explanations of findings."""

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Literal, get_args

Language = Literal["en", "de"]
LANGUAGES: tuple[Language, ...] = get_args(Language)
UNITS = {
    "um": "µm",
    "urad": "µrad",
    "um/m": "µm/m",
    "um/h": "µm/h",
    "um/stop": "µm/stop",
    "nm": "nm",
    "mm": "mm",
    "mrad": "mrad",
    "arcsec": "arcsec",
    "c": "°C",
    "hpa": "hPa",
    "percent": "%",
    "s": "s",
}
"""Units for people, by their names in results and arguments."""
_POINT = re.compile(r"(?<![\w.])(\d+)\.(\d+)(?!\.?\w)")


@cache
def _entries() -> dict[str, dict[str, dict[str, str]]]:
    text = files("stepdiag.texts").joinpath("catalogue.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


@cache
def catalogue(section: str, language: Language) -> Mapping[str, str]:
    """Return the words of a section of `SECTIONS` in one language, by key."""
    return {key: words[language] for key, words in _entries()[section].items()}


def help_texts(language: Language) -> dict[str, dict[str, str]]:
    """Return the help by command and option. The option "" is the command itself; the command "*"
    contains the options that several commands have."""
    tables = tomllib.loads(
        files("stepdiag.texts").joinpath("help.toml").read_text(encoding="utf-8")
    )
    return {
        command: {option: words[language] for option, words in options.items()}
        for command, options in tables.items()
    }


def localised(text: str, language: Language) -> str:
    """Return a text with its numbers in the notation of the language: a decimal comma in German."""
    return _POINT.sub(r"\1,\2", text) if language == "de" else text
