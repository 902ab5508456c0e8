"""The language of who reads a terminal, and what is shown there in it."""

import os
import re
import shutil
import sys
import textwrap
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


def print_words(*lines: Words, err: bool = False) -> None:
    """Print messages in the language of their reader: wrapped at words on a terminal, each under
    its own indent; whole where a file or a program reads them."""
    import typer

    terminal = (sys.stderr if err else sys.stdout).isatty()
    for line in "\n".join(map(shown, lines)).split("\n") if lines else ():
        typer.echo(_wrapped(line) if terminal else line, err=err)


def _wrapped(line: str) -> str:
    """Return a line at most as wide as the terminal; a command in backquotes stays whole, so that
    it can be copied."""
    whole = re.sub(r"`[^`]*`", lambda command: command[0].replace(" ", "\0"), line)
    return textwrap.fill(
        whole,
        shutil.get_terminal_size().columns,
        subsequent_indent=" " * (len(line) - len(line.lstrip()) + 2),
        break_on_hyphens=False,
        break_long_words=False,
    ).replace("\0", " ")


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
