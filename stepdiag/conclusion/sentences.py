"""A sentence as its key in the catalogue and what is filled in, so that one conclusion reads in every language."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from stepdiag.texts import Language, catalogue, localised
from stepdiag.texts.sentences import NESTED, translated

SECTION = "conclusion"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sentence:
    """``arguments`` are texts or sentences; a number is written with a decimal point and gets its comma where the language has one.

    What is a sentence itself, such as why an export was refused, is put into the language by the catalogue.
    """

    key: str
    arguments: "Mapping[str, str | Sentence]" = field(default_factory=dict)


def render(sentence: Sentence, language: Language) -> str:
    """Return the sentence in words. Raises KeyError for a key that the catalogue lacks."""
    words = catalogue(SECTION, language)
    return words[sentence.key].format(**{name: _argument(name, value, language) for name, value in sentence.arguments.items()})


def _argument(name: str, value: str | Sentence, language: Language) -> str:
    if isinstance(value, Sentence):
        return render(value, language)
    return (translated if name in NESTED else localised)(value, language)
