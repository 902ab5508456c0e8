"""The language of the person at a terminal, and output in this language."""

import os
import re
import shutil
import textwrap
from itertools import accumulate
from typing import TYPE_CHECKING

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Message, Words, message, rendered
from stepdiag.terminal.printable import printable
from stepdiag.texts.texts import LANGUAGES, Language

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

WIDEST = 100
"""Largest number of columns of a line: in a longer line, the eye does not find the beginning of the
next one."""
WHOLE = re.compile(r"`[^`]*`|\d (?=[µ%°]|(?:mm|min|h|s)\b)")
"""Pattern of the parts of a text that a line end must not divide: a command, which is copied, and a
figure with its unit."""


def viewers_language() -> Language:
    """Return the language of the environment for messages (POSIX: LC_ALL before LC_MESSAGES before
    LANG), or English."""
    named = next(
        (
            value
            for name in ("LC_ALL", "LC_MESSAGES", "LANG")
            if (value := os.environ.get(name))
        ),
        "",
    )
    return next(
        (language for language in LANGUAGES if named.split("_")[0].split(".")[0] == language),
        "en",
    )


def language_named(wanted: str) -> Language:
    """Return the language of an option. Raises UsageError for a language without texts."""
    chosen = next((known for known in LANGUAGES if known == wanted), None)
    if chosen is None:
        raise UsageError("--language", expected=" or ".join(LANGUAGES), found=wanted)
    return chosen


def print_words(*lines: Words, err: bool = False) -> None:
    import typer

    for line in lines:
        typer.echo(wrapped(line), err=err)


def print_first(lines: "Sequence[Words]", most: int, *, verbose: bool) -> None:
    """Print ``lines``. Without ``verbose``, the printed lines fit ``most`` lines of the terminal,
    and the number of the remaining lines is printed. At least one line is always printed."""
    heights = accumulate(wrapped(line).count("\n") + 1 for line in lines)
    fit = len(lines) if verbose else max(sum(height <= most for height in heights), 1)
    print_words(*lines[:fit])
    if lines[fit:]:
        print_words(message("more-lines", count=len(lines) - fit))


def wrapped(words: Words) -> str:
    """Return a message in the language of the reader, wrapped at words to the width of the terminal
    (80 columns without a terminal), at most `WIDEST`. Each line keeps its indent."""
    columns = min(shutil.get_terminal_size().columns, WIDEST)
    return "\n".join(_wrapped(line, columns) for line in shown(words).split("\n"))


def _wrapped(line: str, columns: int) -> str:
    return textwrap.fill(
        WHOLE.sub(lambda part: part[0].replace(" ", "\0"), line),
        columns,
        subsequent_indent=" " * (len(line) - len(line.lstrip()) + 2),
        break_on_hyphens=False,
        break_long_words=False,
    ).replace("\0", " ")


def shown(words: Words) -> str:
    return printable(rendered(words, viewers_language()))


def empty_table(about: Message) -> "Table":
    """Return a table without rows; ``about`` is a message with its title and its columns, separated
    by |. A < before a column means a column of words."""
    from rich.table import Table

    title, *columns = shown(about).split("|")
    table = Table(title=title or None)
    for column in columns:
        table.add_column(
            column.removeprefix("<"), justify="left" if column.startswith("<") else "right"
        )
    return table
