"""Messages as values: every key in every language with typed arguments, rendered where it is shown,
kept through JSON."""

import re
import string
import tomllib
from collections.abc import Callable
from importlib import resources
from typing import get_args

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError
from stepdiag.base.findings import Finding, finding, in_words
from stepdiag.base.messages import (
    LONGEST_PART,
    Message,
    Place,
    at,
    message,
    message_json,
    message_of,
    rendered,
    where,
)
from stepdiag.texts.explained import Action, Severity, explanations, finding_action
from stepdiag.texts.patterns import FLOORS, findings, sentences, slots, tables
from stepdiag.texts.texts import LANGUAGES
from testkit.german import is_english

KEYS = sorted(sentences())
GIVEN = {
    "name": "X7",
    "whole": 3,
    "number": 1.25,
    "list": ["X7", "X8"],
    "each": ["X7"],
    "or": ["X7", "X8"],
    "and": ["X7"],
    "ranges": [1, 2, 4],
    "stop": 3,
    "stops": [1, 2, 4],
    "pass": 2,
    "setup": "npp",
}
WRONG = {
    "whole": 1.5,
    "number": "1.5",
    "list": "X7",
    "each": 1,
    "or": 1.5,
    "and": "X7",
    "ranges": "X7",
    "stop": 1.5,
    "stops": "X7",
    "pass": "1",
}


def sample(key: str) -> Message:
    return message(key, **{name: GIVEN[kind] for name, kind in slots(key).items()})


def in_every_language(key: str) -> None:
    """No slot stays open, no number is left out, no English word is in the German, and figures have
    a decimal comma there."""
    english, german = (rendered(sample(key), language) for language in ("en", "de"))
    assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*(\.[a-z0-9]+(-[a-z0-9]+)*)?", key)
    for text in (english, german):
        assert "{" not in text.replace("{...", "")
        assert text == text.strip(), "what stands around a message is its holder's"
        assert ("X7" in text) >= any(kind == "name" for kind in slots(key).values())
    assert not is_english(german), german
    assert not re.search(r"\b\d+\.\d+ (µm|um|mm|s|%)", german)


def of_named_and_typed_arguments(key: str) -> None:
    """One too few, one too many and one of another type are refused."""
    given_ = {name: GIVEN[kind] for name, kind in slots(key).items()}
    with pytest.raises(TypeError, match="expected the arguments"):
        message(key, **given_, surplus=1)
    for name, kind in slots(key).items():
        with pytest.raises(TypeError, match="expected the arguments"):
            message(key, **{other: value for other, value in given_.items() if other != name})
        if kind in WRONG:
            with pytest.raises(TypeError, match=name):
                message(key, **{**given_, name: WRONG[kind]})


def of_numbers_with_units(key: str) -> None:
    """A unit stands in the name of a number and nowhere else."""
    units = (
        "_um",
        "_mm",
        "_mrad",
        "_urad",
        "_s",
        "_hz",
        "_percent",
        "_um_m",
        "_c",
        "_ppm",
        "_hpa",
    )
    assert [
        name
        for name, kind in slots(key).items()
        if name.endswith(units) and kind not in ("number", "whole")
    ] == []


def the_same_after_a_journey(key: str) -> None:
    """Through a result's JSON, and through the pipe to the page."""
    said = sample(key)
    assert message_of(msgspec.json.decode(msgspec.json.encode(message_json(said)))) == said
    back = msgspec.json.decode(msgspec.json.encode(said), type=Message)
    assert [rendered(back, language) for language in LANGUAGES] == [
        rendered(said, language) for language in LANGUAGES
    ]


@pytest.mark.parametrize(
    "holds",
    [
        in_every_language,
        of_named_and_typed_arguments,
        of_numbers_with_units,
        the_same_after_a_journey,
    ],
)
def test_every_message(holds: Callable[[str], None]) -> None:
    """One test for all messages: a test for each costs more than what it asks."""
    wrong = {}
    for key in KEYS:
        try:
            holds(key)
        except (AssertionError, pytest.fail.Exception) as failure:
            wrong[key] = str(failure)
    assert wrong == {}


def test_every_entry_is_one_line_with_every_language_and_the_same_slots_in_each() -> None:
    """A line is read by itself: what TOML finds in the whole file is the same, and no floor has a
    key of another."""
    folder = resources.files("stepdiag.texts").joinpath("messages")
    every: list[str] = []
    for floor in FLOORS:
        whole = tomllib.loads(folder.joinpath(f"{floor}.toml").read_text(encoding="utf-8"))
        assert whole == {
            table: {
                key: tomllib.loads(f"it = {words}")["it"] for key, words in entries.items()
            }
            for table, entries in tables(floor).items()
        }
        every += [key for entries in whole.values() for key in entries]
        assert {
            frozenset(words) for entries in whole.values() for words in entries.values()
        } == {frozenset(LANGUAGES)}
    assert sorted(every) == KEYS
    for key, patterns in sentences().items():
        slots_of = [
            {(slot.name, slot.kind) for _, slot in patterns[language] if slot is not None}
            for language in LANGUAGES
        ]
        assert slots_of[0] == slots_of[1] == set(slots(key).items()), key


FOREIGN = [
    None,
    7,
    {},
    {"key": "no-such-key", "arguments": {}},
    {"key": "way-out", "arguments": {"a": 1}},
    {"key": "way-out"},
]


@pytest.mark.parametrize("tree", FOREIGN)
def test_what_another_version_wrote_is_no_message(tree: object) -> None:
    """Its text is shown as it stands."""
    assert message_of(tree) is None


def test_a_message_in_a_message() -> None:
    """A refusal's parts are messages or values; lists and ranges of stops are put together in the
    reader's language."""
    way = message("way-back")
    refusal = message("refusal", where="survey.toml: plan", expected=way, found="'ppq'")
    assert rendered(refusal, "de") == "survey.toml: plan: erwartet war zurück, gefunden 'ppq'"
    place = Place(setup="npp+1", way="back", pass_number=2, stop=7, last=30)
    assert rendered(at(place, way), "en") == (
        "diagonal X+Y-Z- to X-Y+Z+ (npp+1) back, stop 8 of 31: back"
    )
    assert rendered(at(place, way, (5, 6, 7, 9)), "de") == (
        "Diagonale X+Y-Z- nach X-Y+Z+ (npp+1) zurück, Messpunkte 6–8, 10: zurück"
    )
    assert rendered(at(Place(setup="linear-x", way="out"), way), "de") == (
        "Linearlauf X (linear-x) hin: zurück"
    )
    assert rendered(where(place), "en") == (
        "diagonal X+Y-Z- to X-Y+Z+ (npp+1), pass 2 back, stop 8"
    )
    assert where(Place(setup="npp")) == ""
    assert at(Place(), way) is way


def test_a_refusal_carries_its_message() -> None:
    """Its English is the text of the exception; its parts are at hand."""
    error = DataError("log.mcap", expected=message("way-out"), found="x" * 3000, remedy="y")
    assert str(error).startswith("log.mcap: expected out, found xxx")
    assert rendered(error.message, "de").startswith(
        "log.mcap: erwartet war hin, gefunden xxx"
    )
    assert len(str(error)) < LONGEST_PART + 100
    assert error.expected == message("way-out")


def test_a_finding_is_made_of_its_message() -> None:
    """Code, English text and place come from the message; the page shows all stops of a cause at
    once."""
    said = message("method-limited.runs", others=["body-ppp", "ppp+1"])
    made = finding(
        "warning", said, Place(setup="ppp", way="out", stop=3, last=30), size_um=1.5
    )
    sentence = "this method uses the four body diagonals only, not body-ppp, ppp+1"
    assert (made.code, made.text, made.stop) == (
        "method-limited",
        f"diagonal X-Y-Z- to X+Y+Z+ (ppp) out, stop 4 of 31: {sentence}",
        3,
    )
    assert (
        in_words(made, "de")
        == "Diagonale X-Y-Z- nach X+Y+Z+ (ppp) hin, Messpunkt 4: dieses Verfahren nutzt nur die "
        "vier Raumdiagonalen, nicht body-ppp, ppp+1"
    )
    assert in_words(made, "en", (3, 4)) == (
        f"diagonal X-Y-Z- to X+Y+Z+ (ppp) out, stops 4–5: {sentence}"
    )
    old = Finding(
        code="count-slip",
        severity="warning",
        text="ppp out, stop 5 of 30: the count was lost",
    )
    assert in_words(old, "de") == old.text
    assert (old.action, made.action) == ("repeat", "choose")


@pytest.mark.parametrize("code", explanations())
def test_every_code_has_an_action(code: str) -> None:
    """Page, status and exit codes go by it."""
    assert all(
        finding_action(code, severity) in get_args(Action) for severity in get_args(Severity)
    )


@given(st.text(string.printable + "{}µ"))
def test_a_text_in_a_message_stands_as_it_is(text: str) -> None:
    """Braces and signs of a foreign file are no slots."""
    assert text[:LONGEST_PART] in rendered(
        message("refusal", where=text, expected="1", found="2"), "en"
    )


def test_a_phrase_is_no_finding() -> None:
    """A finding has a code, with cause and action in the catalogue."""
    assert "way-out" not in findings()
    with pytest.raises(KeyError):
        finding("info", message("way-out"))
