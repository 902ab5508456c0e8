"""A finding in words: place, sentence and advice in the language of the reader."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from stepdiag.texts.explained import explained
from stepdiag.texts.ranges import ranges
from stepdiag.texts.sentences import is_known, translated
from stepdiag.texts.texts import Language, catalogue

_PLACE = re.compile(
    r"(?P<setup>[pn]{3}(?:\+\d+)?|(?:linear|fourdof)-[xyz]) (?P<way>out|back)(?: pass (?P<number>\d+))?"
    r"(?:, stop (?P<stop>\d+) of (?P<last>\d+))?: (?P<rest>.*)",
    re.DOTALL,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a finding was: ``run`` names setup and way (empty where it belongs to none), ``rest`` is the rest of the sentence."""

    run: str
    setup: str
    way: str
    stop: int | None
    rest: str


def place_of(text: str) -> Place:
    """Return the place that a finding's sentence begins with."""
    match = _PLACE.fullmatch(text)
    if match is None:
        return Place(run="", setup="", way="", stop=None, rest=text)
    stop = None if match["stop"] is None else int(match["stop"])
    return Place(run=f"{match['setup']} {match['way']}", setup=match["setup"], way=match["way"], stop=stop, rest=match["rest"])


def sentence(code: str, text: str, language: Language, stops: Sequence[int] = ()) -> str:
    """Return a finding's sentence with its place; ``stops`` are all stops of the pass that have it.

    Where the catalogue has no pattern for the sentence, another language than English gets what the code means: never half of each.
    """
    place = place_of(text)
    words = catalogue("finding_place", language)
    where = ""
    if place.run:
        numbers = sorted(set(stops)) or ([] if place.stop is None else [place.stop])
        at = "" if not numbers else words["stop" if len(numbers) == 1 else "stops"].format(stops=ranges(numbers))
        where = words["run"].format(setup=place.setup, way=words[place.way], at=at)
    rest = translated(place.rest, language) if language == "en" or is_known(place.rest) else meaning_of(code, language)
    return f"{where}{rest}"


def meaning_of(code: str, language: Language) -> str:
    """Return the cause of a finding; the code where it is not documented."""
    entry = explained(code)
    return code if entry is None else entry.words[language].cause.rstrip(".")


def advice_of(code: str, language: Language) -> str:
    """Return what a finding costs and what to do about it; empty where it is not documented."""
    entry = explained(code)
    return "" if entry is None else entry.words[language].advice
