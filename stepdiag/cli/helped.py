"""The help of every command and option in the language of the user, from ``texts/help.toml``."""

from typing import TYPE_CHECKING, Any

from typer.core import TyperGroup

from stepdiag.cli.completion import PROGRAMS, TABLES
from stepdiag.terminal.viewer import viewers_language
from stepdiag.texts.texts import help_texts

if TYPE_CHECKING:
    from collections.abc import Mapping


class HelpedGroup(TyperGroup):
    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        _fill(self, "", help_texts(viewers_language()))


def _fill(command: Any, name: str, texts: "Mapping[str, Mapping[str, str]]") -> None:
    own = texts["*"] | texts.get(name, {})  # type: ignore[operator]
    command.help = own.get("")
    for option in command.params:
        if option.name in own:
            option.help = own[option.name].format(
                tables=", ".join(TABLES), programs=", ".join(PROGRAMS)
            )
    for inner, each in getattr(command, "commands", {}).items():
        _fill(each, f"{name} {inner}".strip(), texts)
