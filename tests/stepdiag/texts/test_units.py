"""One micrometre sign in every text that a person reads: µm and µrad in both languages, `um` in
names of keys and arguments alone."""

import re

import pytest
from typer.main import get_command

from stepdiag.cli.app import app, build
from stepdiag.texts.explained import explanations
from stepdiag.texts.patterns import sentences
from stepdiag.texts.texts import LANGUAGES, UNITS, Language, catalogue
from testkit.catalogue import SECTIONS

ASCII_UNIT = re.compile(
    r"(?<=[\d}] )um\b(?! \{| etwa)|(?<![\w{._-])um(?=/)|(?<![\w{._-])urad(?![\w}:`])|\u03bc"
)
"""In German `um` is a word: a unit stands behind a figure, or before a stroke."""
ENGLISH_UNIT = re.compile(r"(?<![\w{._`-])um(?![\w}`])")


def shown(language: Language) -> dict[str, str]:
    """Return every text of the catalogue, of the messages and of the findings; a slot stands as
    ``{}``."""
    words = {
        f"{section}.{key}": text
        for section in SECTIONS
        for key, text in catalogue(section, language).items()
    }
    for key, patterns in sentences().items():
        words[key] = "".join(
            literal + ("" if slot is None else "{}") for literal, slot in patterns[language]
        )
    for code, explanation in explanations().items():
        part = explanation.words[language]
        words[f"{code} explained"] = f"{part.cause} {part.cost} {part.do}"
    return words


@pytest.mark.parametrize("language", LANGUAGES)
def test_one_micrometre_sign_in_every_text(language: Language) -> None:
    found = shown(language)
    assert len(found) > 1500
    assert [key for key, text in found.items() if ASCII_UNIT.search(text)] == []
    if language == "en":
        assert [key for key, text in found.items() if ENGLISH_UNIT.search(text)] == []


def test_one_micrometre_sign_in_the_help() -> None:
    build()
    commands = [get_command(app)]
    texts = []
    while commands:
        command = commands.pop()
        commands += getattr(command, "commands", {}).values()
        texts += [
            command.help or "",
            *(getattr(option, "help", None) or "" for option in command.params),
        ]
    assert len(texts) > 100
    assert [text for text in texts if ENGLISH_UNIT.search(text)] == []


def test_every_unit_of_a_result_has_its_sign() -> None:
    assert {unit: sign for unit, sign in UNITS.items() if re.search("um|urad", sign)} == {}
