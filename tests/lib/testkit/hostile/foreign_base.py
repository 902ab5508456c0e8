"""What every target of the fuzzing shares: a refusal of ours is an answer, any other exception is a
finding."""

from collections.abc import Callable
from typing import NamedTuple

from stepdiag.base.errors import StepdiagError


class Target(NamedTuple):
    """Something good to begin with, and what reads it. ``weight`` is how often it is tried: a tenth
    for what takes long."""

    seed: bytes
    read: Callable[[bytes], object]
    weight: float = 1.0


def refusing(read: Callable[[bytes], object]) -> Callable[[bytes], object]:
    """Return a reader that takes a refusal as an answer, and nothing else that is raised."""

    def target(data: bytes) -> object:
        try:
            return read(data)
        except StepdiagError:
            return None

    return target


def text_of(data: bytes) -> str:
    """Return the text of a file; what is not UTF-8 is refused before any parser sees it
    (`base.files.as_text`)."""
    from stepdiag.base.files import as_text

    return as_text(data, "foreign")
