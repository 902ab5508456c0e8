"""The language of who reads a terminal, and what is shown there in it."""

import os

import typer

from stepdiag.base.messages import Words, rendered
from stepdiag.terminal.printable import printable
from stepdiag.texts.texts import LANGUAGES, Language


def viewers_language() -> Language:
    """Return the language that the environment names for messages (POSIX: LC_ALL before LC_MESSAGES before LANG), or English."""
    named = next((value for name in ("LC_ALL", "LC_MESSAGES", "LANG") if (value := os.environ.get(name))), "")
    return next((language for language in LANGUAGES if named.split("_")[0].split(".")[0] == language), "en")


def print_words(words: Words, *, err: bool = False) -> None:
    """Print a message in the language of its reader."""
    typer.echo(shown(words), err=err)


def shown(words: Words) -> str:
    """Return a message as the terminal shows it to its reader."""
    return printable(rendered(words, viewers_language()))
