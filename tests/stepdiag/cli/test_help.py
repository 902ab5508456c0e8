"""The help of every command and option, in the reader's language."""

from collections.abc import Iterator
from typing import Any, get_args

import pytest
from typer.main import get_command

from stepdiag.cli.app import app, build
from stepdiag.texts.texts import LANGUAGES, Language, help_texts
from testkit.cli import stepdiag

OF_THE_LIBRARY = {"help", "install_completion", "show_completion"}
OF_THE_RECORDER = {"complete": "folder", "pack": "folder max_gb"}
"""Hidden commands, started by `run` alone: their arguments need no help."""


def commands(command: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every command by its name."""
    yield name, command
    for inner, each in getattr(command, "commands", {}).items():
        yield from commands(each, f"{name} {inner}".strip())


def known() -> dict[str, set[str]]:
    """Return command -> its options."""
    build()
    return {
        name: {option.name for option in each.params} - OF_THE_LIBRARY
        for name, each in commands(get_command(app))
    }


@pytest.mark.parametrize("language", get_args(Language))
def test_every_command_and_every_option_has_its_help(
    language: Language, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LC_ALL", f"{language}_XX.UTF-8")
    texts = help_texts(language)
    build()
    for name, command in commands(get_command(app)):
        assert command.help == texts[name][""], name
        shown = {
            option.name: option.help
            for option in command.params
            if option.name not in OF_THE_LIBRARY
        }
        assert [
            f"{name} {each}"
            for each, text in shown.items()
            if not text and each not in OF_THE_RECORDER.get(name, "")
        ] == []


def test_no_help_belongs_to_a_command_or_an_option_that_is_not_there() -> None:
    options = known()
    several = {option for each in options.values() for option in each}
    surplus = {
        name: set(texts) - {""} - options.get(name, set())
        for name, texts in help_texts("en").items()
        if name != "*"
    }
    assert {name: each for name, each in surplus.items() if each or name not in options} == {}
    assert set(help_texts("en")["*"]) <= several


def test_both_languages_have_their_own_words() -> None:
    english, german = (help_texts(language) for language in LANGUAGES)
    same = [
        (name, option)
        for name, texts in english.items()
        for option, text in texts.items()
        if text == german[name][option]
    ]
    assert [each for each in same if english[each[0]][each[1]].count(" ") > 3] == []


@pytest.mark.parametrize("group", [(), ("fourdof",)])
def test_german_lists_of_commands_are_whole_sentences(
    group: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LC_ALL", "de_DE.UTF-8")
    listed = stepdiag(*group, "--help").out.partition("Commands:")[2].strip().splitlines()
    assert [line for line in listed if line.endswith("...") or not line.endswith(".")] == []
