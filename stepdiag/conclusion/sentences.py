"""A sentence of the conclusion: its key in the catalogue and its values, so that the sentence can
be shown in every language.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from stepdiag.base.messages import Words, rendered
from stepdiag.texts import Language, catalogue

SECTION = "conclusion"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sentence:
    """``arguments`` are texts, messages or sentences; a number in a text has a decimal point, which
    is replaced by a comma in a language with decimal commas.
    """

    key: str
    arguments: "Mapping[str, Words | Sentence]" = field(default_factory=dict)


def render(sentence: Sentence, language: Language) -> str:
    """Return the sentence in words of a language. Raises KeyError for a key that the catalogue
    lacks.
    """
    words = catalogue(SECTION, language)
    return words[sentence.key].format(
        **{name: _argument(value, language) for name, value in sentence.arguments.items()}
    )


def _argument(value: Words | Sentence, language: Language) -> str:
    return (
        render(value, language) if isinstance(value, Sentence) else rendered(value, language)
    )
