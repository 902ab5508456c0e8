"""A sentence of the conclusion: its key in the catalogue and its values, for display in every
language."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from stepdiag.base.messages import Words, rendered
from stepdiag.texts import Language, catalogue

SECTION = "conclusion"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sentence:
    """``arguments`` are texts, messages or sentences. A number in a text has a decimal point, which
    becomes a comma in German."""

    key: str
    arguments: "Mapping[str, Words | Sentence]" = field(default_factory=dict)


def render(sentence: Sentence, language: Language) -> str:
    """Return the sentence in a language. Raises KeyError for a key outside the catalogue."""
    words = catalogue(SECTION, language)
    return words[sentence.key].format(
        **{name: _argument(value, language) for name, value in sentence.arguments.items()}
    )


def _argument(value: Words | Sentence, language: Language) -> str:
    return (
        render(value, language) if isinstance(value, Sentence) else rendered(value, language)
    )
