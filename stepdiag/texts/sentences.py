"""Sentences that the program composed in English, in another language: by the patterns of the catalogue's section ``sentence``.

A pattern is the English sentence with its arguments as ``{name}``; it is matched as a whole, and the arguments, which may be sentences
themselves, are put into the other language's words. Logs and results record the English sentence, so that old ones read in German too.
"""

import re
from functools import cache, lru_cache

from stepdiag.texts.texts import Language, catalogue, localised

_ARGUMENT = re.compile(r"\\\{(\w+)\\\}")
_LISTS = ("; ", ", ")


@cache
def _patterns() -> tuple[tuple[re.Pattern[str], str], ...]:
    """Return every pattern with the key of its sentence; the longer ones come first, so that the special one wins over the general one."""
    known = catalogue("sentence", "en")
    ordered = sorted(known.items(), key=lambda item: (-len(re.sub(r"\{\w+\}", "", item[1])), item[0]))
    return tuple((_compiled(words), key) for key, words in ordered)


def _compiled(words: str) -> re.Pattern[str]:
    seen: set[str] = set()

    def group(match: re.Match[str]) -> str:
        name = match[1]
        if name in seen:
            return f"(?P={name})"
        seen.add(name)
        return f"(?P<{name}>(?:(?!; ).)+?)"  # a list of sentences is no argument

    return re.compile(_ARGUMENT.sub(group, re.escape(words)), re.DOTALL)


@lru_cache(maxsize=2048)
def translated(text: str, language: Language) -> str:
    """Return a sentence of the program in another language; what no pattern knows stays as it is but for its decimal comma."""
    if language == "en" or not text:
        return text
    return _in_parts(text, language) or _known(text, language) or localised(text, language)


def is_known(text: str) -> bool:
    """Tell whether a pattern covers a sentence."""
    return any(pattern.fullmatch(text) for pattern, _ in _patterns())


def _known(text: str, language: Language) -> str:
    words = catalogue("sentence", language)
    for pattern, key in _patterns():
        match = pattern.fullmatch(text)
        if match is not None:
            return words[key].format(**{name: translated(value, language) for name, value in match.groupdict().items()})
    return ""


def _in_parts(text: str, language: Language) -> str:
    """Return a list of sentences, each on its own; empty where the text is none or one of them is not known."""
    for mark in _LISTS:
        parts = text.split(mark)
        if len(parts) > 1 and all(is_known(part) for part in parts):
            return mark.join(_known(part, language) for part in parts)
    return ""
