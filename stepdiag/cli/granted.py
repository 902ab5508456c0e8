"""The assumptions behind U, which every command prints together with U."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from stepdiag.terminal.viewer import print_words

if TYPE_CHECKING:
    from stepdiag.base.messages import Words
    from stepdiag.base.result.members import Assumed
    from stepdiag.base.result.result import Result


def say_granted(results: "Sequence[Result]") -> None:
    """Print the assumed sizes behind the U of results: once if all results have the same sizes,
    otherwise under the name of each file."""
    from stepdiag.base.messages import message
    from stepdiag.base.result.basis import basis_of

    granted = [_words(basis_of(result).assumed) for result in results]
    say: list[Words] = [*granted[:1]]
    if len(set(granted)) > 1:
        say = [
            message("labelled", name=result.source, what=words or message("granted-unstated"))
            for result, words in zip(results, granted, strict=True)
        ]
    print_words(*(line for line in say if line))


def say_assumed(assumed: "Assumed") -> None:
    """Print the assumed sizes of a survey before the drive."""
    from stepdiag.base.result.basis import sizes_of

    print_words(_words(sizes_of(assumed)))


def _words(assumed: Mapping[str, float]) -> str:
    from stepdiag.conclusion import render, taken_for_granted
    from stepdiag.terminal.viewer import viewers_language

    sentence = taken_for_granted(assumed)
    return "" if sentence is None else render(sentence, viewers_language())
