"""The language of who reads a terminal, and what is shown there in it."""

import os
import textwrap
from collections.abc import Iterable
from typing import TYPE_CHECKING

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Message, Words, rendered
from stepdiag.terminal.printable import printable
from stepdiag.texts.texts import LANGUAGES, Language

if TYPE_CHECKING:
    from rich.table import Table


def viewers_language() -> Language:
    """Return the language that the environment names for messages (POSIX: LC_ALL before LC_MESSAGES
    before LANG), or English."""
    named = next(
        (value for name in ("LC_ALL", "LC_MESSAGES", "LANG") if (value := os.environ.get(name))), ""
    )
    return next(
        (language for language in LANGUAGES if named.split("_")[0].split(".")[0] == language), "en"
    )


def language_named(wanted: str) -> Language:
    """Return the language of an option. Raises UsageError for one without texts."""
    chosen = next((known for known in LANGUAGES if known == wanted), None)
    if chosen is None:
        raise UsageError("--language", expected=" or ".join(LANGUAGES), found=wanted)
    return chosen


def print_words(words: Words, *, err: bool = False) -> None:
    """Print a message in the language of its reader."""
    import typer

    typer.echo(shown(words), err=err)


def print_lines(lines: Iterable[str]) -> None:
    """Print lines of text: wrapped at words on a terminal, under their own indent; whole where a
    file or a program reads them."""
    from rich.console import Console

    console = Console(markup=False, highlight=False)
    for line in lines:
        indent = " " * (len(line) - len(line.lstrip()) + 2)
        width = console.width if console.is_terminal else max(len(line), 1)
        console.print(
            textwrap.fill(line, width, subsequent_indent=indent, break_on_hyphens=False),
            soft_wrap=True,
        )


def shown(words: Words) -> str:
    """Return a message as the terminal shows it to its reader."""
    return printable(rendered(words, viewers_language()))


def empty_table(about: Message) -> "Table":
    """Return a table without rows; ``about`` is its title and its columns with | between them, <
    before a column of words."""
    from rich.table import Table

    title, *columns = shown(about).split("|")
    table = Table(title=title or None)
    for column in columns:
        table.add_column(
            column.removeprefix("<"), justify="left" if column.startswith("<") else "right"
        )
    return table
