"""The sentences of all messages: patterns with typed slots, in every language, with one file per
floor (``messages/*.toml``).

A slot's format is its type, the same in every language:

    {name}            a name shown unchanged (setup, axis, file, field), or a message
    {count:d}         a whole number
    {size_um:+.1f}    a number; its unit is in its name
    {names:list}      names or messages with commas between them; ``each`` with semicolons,
                      ``or`` and ``and`` with that word
    {passes:ranges}   whole numbers as ranges: 5-7, 9
    {stop:stop}       a stop of a pass: the program counts from 0, a person reads from 1
    {stops:stops}     stops as ranges, read from 1
    {number:pass}     the number of a pass with its direction: odd passes lead outward
    {setup:setup}     a setup: a diagonal by its corners, with the short name beside them

An entry is one line. A key of ``[finding]`` is a code, or a code and a variant behind a dot
(``"stop-outlier.alone"``); a key of ``[phrase]`` is a part of other sentences.
"""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import Literal, get_args

from stepdiag.texts.texts import LANGUAGES, Language

Kind = Literal[
    "name",
    "whole",
    "number",
    "list",
    "each",
    "or",
    "and",
    "ranges",
    "stop",
    "stops",
    "pass",
    "setup",
]
_BY_NAME = frozenset(get_args(Kind)) - {"name", "whole", "number"}
FLOORS = ("base", "solver", "exporters", "daq", "stepdiag")


@dataclass(frozen=True, slots=True)
class Slot:
    """A place in a pattern: the name of its argument, its type, and the number format."""

    name: str
    kind: Kind
    form: str


Pattern = tuple[tuple[str, Slot | None], ...]
"""A sentence in parts: a text and the slot after it; the last text has no slot."""


@cache
def tables(floor: str) -> dict[str, dict[str, str]]:
    """Return the tables ``finding`` and ``phrase`` in a floor's file: each key with the unparsed
    rest of its line."""
    path = files("stepdiag.texts").joinpath("messages", f"{floor}.toml")
    found: dict[str, dict[str, str]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("["):
            entries = found.setdefault(line.strip("[]"), {})
        elif line and not line.startswith("#"):
            key, _, words = line.partition(" = ")
            entries[key.strip('"')] = words
    return found


class _Sentences(Mapping[str, dict[Language, Pattern]]):
    """The patterns of every floor by key and language. A pattern is parsed at its first use:
    parsing all two thousand patterns takes a third of the start of a command."""

    def __init__(self) -> None:
        every = (entries for floor in FLOORS for entries in tables(floor).values())
        self._words = {key: words for entries in every for key, words in entries.items()}
        self._read: dict[str, dict[Language, Pattern]] = {}

    def __getitem__(self, key: str) -> dict[Language, Pattern]:
        if key not in self._read:
            words = tomllib.loads(f"words = {self._words[key]}")["words"]
            self._read[key] = {
                language: pattern_of(words[language]) for language in LANGUAGES
            }
        return self._read[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._words)

    def __len__(self) -> int:
        return len(self._words)


@cache
def sentences() -> Mapping[str, dict[Language, Pattern]]:
    """Return the patterns of every floor by key and language. Raises ValueError for a wrong
    slot."""
    return _Sentences()


@cache
def findings() -> frozenset[str]:
    return frozenset(key for floor in FLOORS for key in tables(floor)["finding"])


@cache
def slots(key: str) -> dict[str, Kind]:
    """Return the arguments of a message and their types. Raises KeyError for an unknown key."""
    return _slots(sentences()[key]["en"])


def pattern_of(words: str) -> Pattern:
    """Return the parts of a sentence with slots. Raises ValueError for an invalid format."""
    return tuple(
        (literal, None if name is None else _slot(name, form or ""))
        for literal, name, form, _ in Formatter().parse(words)
    )


def _slot(name: str, form: str) -> Slot:
    if form in _BY_NAME:
        return Slot(name, form, "")  # type: ignore[arg-type]
    if not form:
        return Slot(name, "name", "")
    format(1 if form.endswith("d") else 1.0, form)
    return Slot(name, "whole" if form.endswith("d") else "number", form)


def _slots(pattern: Pattern) -> dict[str, Kind]:
    found: dict[str, Kind] = {}
    for _, slot in pattern:
        if slot is not None and found.setdefault(slot.name, slot.kind) != slot.kind:
            raise ValueError(f"slot {slot.name}: expected one type")
    return found
