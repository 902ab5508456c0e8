"""Sentences that the program composed in English, in another language: by the patterns of the messages and the section ``sentence``.

A pattern is the English sentence with its arguments as ``{name}``; it is matched as a whole, and the arguments, which may be sentences
themselves, are put into the other language's words. Logs and results record the English sentence, so that old ones read in German too.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

from stepdiag.texts.patterns import Pattern, pattern_of, sentences
from stepdiag.texts.texts import LANGUAGES, Language, catalogue, localised

_LISTS = {"; ": "list_semicolon", ", ": "list_comma", " or ": "list_or", " and ": "list_and"}
"""What stands between the parts of a list, and its word in the catalogue's section ``finding_place``."""
_WHOLE = frozenset({"remedy", "those"})
"""Arguments that may be lists themselves."""
NESTED = frozenset({"what", "why", "said", "spot"})
"""Arguments that are sentences themselves, and must be known too."""
_ONE_WORD = frozenset({"um", "limit", "count", "number", "first", "last"})
"""Arguments that are one figure: a sentence in their place is another sentence, which begins like this one."""
_SHORT = 3
"""Letters of a word that marks no sentence by itself: of, and, mm."""
_REMEMBERED = 2048
LONGEST = 4000
"""Characters of a sentence that is looked up; what is longer is none of the program's."""


@dataclass(frozen=True, slots=True)
class _Pattern:
    """A sentence of the catalogue cut at its arguments: ``literals`` has one more entry than ``names``."""

    words: Mapping[Language, Pattern]
    literals: tuple[str, ...]
    names: tuple[str, ...]
    figures: frozenset[str]

    def arguments(self, text: str) -> dict[str, str] | None:
        """Return the arguments of a text, None where it is not this sentence. Each is as short as it can be: one walk."""
        first, *rest = self.literals
        if not text.startswith(first):
            return None
        if not rest:
            return {} if text == first else None
        at, found = len(first), dict[str, str]()
        for place, (name, literal) in enumerate(zip(self.names, rest, strict=True), start=1):
            end = len(text) - len(literal) if place == len(rest) else text.find(literal, at + 1)
            if end <= at or not text.startswith(literal, end):
                return None
            value = text[at:end]
            if found.setdefault(name, value) != value or ("; " in value and name not in _WHOLE) or (" " in value and name in self.figures):
                return None
            at = end + len(literal)
        return found if at == len(text) else None


@cache
def _patterns() -> tuple[_Pattern, ...]:
    """Return every pattern; the longer ones come first, so that the special one wins over the general one."""
    old = {language: catalogue("sentence", language) for language in LANGUAGES}
    known = [(key, {language: pattern_of(words[key]) for language, words in old.items()}) for key in old["en"]]
    # a message of slots and short words would be every sentence
    worded = [
        (key, words)
        for key, words in sentences().items()
        if any((slot is None and part.isalpha()) or _wordy(part) for part, slot in words["en"])
    ]
    made = [_made(words) for _, words in sorted([*worded, *known], key=lambda item: item[0])]
    return tuple(sorted(made, key=lambda one: -sum(map(len, one.literals))))


def _wordy(part: str) -> bool:
    return any(len(word) > _SHORT for word in re.findall("[^\\W\\d_]+", part))


def _made(words: Mapping[Language, Pattern]) -> _Pattern:
    slots = [slot for _, slot in words["en"] if slot is not None]
    literals = tuple(literal for literal, _ in words["en"]) + (("",) if slots and words["en"][-1][1] is not None else ())
    figures = frozenset(slot.name for slot in slots if slot.kind in ("number", "whole") or slot.name in _ONE_WORD)
    return _Pattern(words, literals, tuple(slot.name for slot in slots), figures)


@lru_cache(maxsize=_REMEMBERED)
def _found(text: str) -> tuple[_Pattern, dict[str, str]] | None:
    """Return the pattern of a sentence and its arguments; None where no pattern knows it."""
    if len(text) > LONGEST:
        return None
    for pattern in _patterns():
        arguments = pattern.arguments(text)
        if arguments is not None:
            return pattern, arguments
    return None


@lru_cache(maxsize=_REMEMBERED)
def translated(text: str, language: Language) -> str:
    """Return a sentence of the program in another language; what no pattern knows stays as it is but for its decimal comma."""
    if language == "en" or not text:
        return text
    first, *others = _LISTS
    return _in_parts(text, language, first) or _known(text, language) or _listed(text, language, others) or localised(text, language)


def in_every_language(text: str) -> dict[str, str]:
    """Return a sentence of the program by language."""
    return {language: translated(text, language) for language in LANGUAGES}


def is_known(text: str) -> bool:
    """Tell whether a pattern covers a sentence with those it quotes, or each sentence of a list."""
    found = _found(text)
    if found is None:
        return any(_parts(text, mark) for mark in _LISTS)
    return all(is_known(value) for name, value in found[1].items() if name in NESTED)


def _known(text: str, language: Language) -> str:
    found = _found(text)
    if found is None:
        return ""
    pattern, arguments = found
    filled = {name: translated(value, language) for name, value in arguments.items()}
    return "".join(literal + (filled[slot.name] if slot else "") for literal, slot in pattern.words[language])


def _listed(text: str, language: Language, marks: Sequence[str]) -> str:
    return next((words for mark in marks if (words := _in_parts(text, language, mark))), "")


def _in_parts(text: str, language: Language, mark: str) -> str:
    """Return a list of sentences, each on its own; empty where the text is none or one of them is not known."""
    joined = catalogue("finding_place", language)[_LISTS[mark]]
    return joined.join(translated(part, language) for part in _parts(text, mark))


def _parts(text: str, mark: str) -> list[str]:
    parts = text.split(mark) if len(text) <= LONGEST else []
    return parts if len(parts) > 1 and all(map(is_known, parts)) else []
