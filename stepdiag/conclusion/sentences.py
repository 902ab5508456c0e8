"""A sentence as its key in the catalogue and what is filled in, so that one conclusion reads in every language."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from stepdiag.base.messages import Words, rendered
from stepdiag.texts import Language, catalogue

SECTION = "conclusion"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sentence:
    """``arguments`` are texts and messages; a number is written with a decimal point and gets its comma where the language has one."""

    key: str
    arguments: Mapping[str, Words] = field(default_factory=dict)


def render(sentence: Sentence, language: Language) -> str:
    """Return the sentence in words. Raises KeyError for a key that the catalogue lacks."""
    words = catalogue(SECTION, language)
    arguments = {name: rendered(value, language) for name, value in sentence.arguments.items()}
    return words[sentence.key].format(**arguments)
