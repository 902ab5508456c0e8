"""The assumptions behind U, beside every U that a command prints."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from stepdiag.base.result.members import Assumed
    from stepdiag.base.result.result import Result


def say_granted(results: "Sequence[Result]") -> None:
    """Print the sizes on which the uncertainties of results rest: once where they are the same,
    else each under its file's name."""
    from stepdiag.base.messages import message
    from stepdiag.base.result.basis import basis_of
    from stepdiag.terminal.viewer import shown

    granted = [_words(basis_of(result).assumed) for result in results]
    if len(set(granted)) == 1:
        say = [granted[0]]
    else:
        say = [
            shown(
                message("labelled", name=result.source, what=words or message("granted-unstated"))
            )
            for result, words in zip(results, granted, strict=True)
        ]
    for line in filter(None, say):
        typer.echo(line)


def say_assumed(assumed: "Assumed") -> None:
    """Print the sizes of a survey that was not driven yet."""
    from stepdiag.base.result.basis import sizes_of

    typer.echo(_words(sizes_of(assumed)))


def _words(assumed: Mapping[str, float]) -> str:
    from stepdiag.conclusion import render, taken_for_granted
    from stepdiag.terminal.viewer import viewers_language

    sentence = taken_for_granted(assumed)
    return "" if sentence is None else render(sentence, viewers_language())
