"""Messages: the key of a sentence and its arguments, whose names contain their units. The text is
made only for display.

    words = message("stop-outlier.alone", stop=5, size_um=12.3, setup="ppp")
    rendered(words, "de")

`texts.patterns` contains the sentence of every key in every language and the type of every
argument. Old logs and results contain only text, which is shown unchanged.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from stepdiag.texts.patterns import Kind, Slot, sentences, slots
from stepdiag.texts.ranges import ranges
from stepdiag.texts.setup_words import setup_words
from stepdiag.texts.texts import LANGUAGES, Language, localised

Way = Literal["", "out", "back"]

LONGEST_PART = 2000
"""Largest number of characters of a text in a message; foreign files can contain megabytes in place
of a word."""
LONGEST_QUOTE = 60
_BETWEEN: dict[Kind, dict[Language, str]] = {
    "list": {"en": ", ", "de": ", "},
    "each": {"en": "; ", "de": "; "},
    "or": {"en": " or ", "de": " oder "},
    "and": {"en": " and ", "de": " und "},
}


def shortened(text: str, most: int = LONGEST_PART) -> str:
    """Return a text; of a long text only its beginning and its length."""
    return text if len(text) <= most else f"{text[:most]}... ({len(text)} characters)"


def excerpt(text: str) -> str:
    """Return the part of a text that a message quotes: of a long text only its beginning."""
    return shortened(text, LONGEST_QUOTE)


@dataclass(frozen=True, slots=True)
class Message:
    """A sentence of the catalogue and its arguments; ``str(message)`` is the English sentence. Use
    `message` to make one."""

    key: str
    arguments: "dict[str, Kept]" = field(default_factory=dict)

    def __hash__(self) -> int:
        return hash((self.key, *self.arguments))

    def __str__(self) -> str:
        return rendered(self, "en")

    @property
    def code(self) -> str:
        return self.key.partition(".")[0]


Words = Message | str
"""A message, or a text that is shown unchanged, such as a name or a value of a file."""
Item = Message | str | int
Argument = Message | str | int | float | Sequence[Item]
Kept = Message | str | int | float | tuple[Item, ...]
"""The stored form of an argument of a message. A message read from JSON and a message made by the
program have the same form."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Place of an event: setup, direction, pass, stop of the pass and its last stop, if known."""

    setup: str = ""
    way: Way = ""
    pass_number: int | None = None
    stop: int | None = None
    last: int | None = None


def message(key: str, /, **arguments: Argument) -> Message:
    """Return a message. Raises KeyError for a key outside the catalogue, TypeError for arguments
    with other names or types."""
    return message_with(key, arguments)


def message_with(key: str, arguments: Mapping[str, Argument]) -> Message:
    """Return a message from a mapping of its arguments. Raises the errors of `message`."""
    wanted = slots(key)
    if arguments.keys() != wanted.keys():
        raise TypeError(
            f"message {key}: expected the arguments {', '.join(wanted)}, found "
            f"{', '.join(arguments)}"
        )
    return Message(
        key, {name: _plain(key, name, kind, arguments[name]) for name, kind in wanted.items()}
    )


def _plain(key: str, name: str, kind: Kind, value: Argument) -> Kept:
    """Return an argument in a form that JSON can represent: numpy numbers become Python numbers,
    long texts are shortened."""
    match kind:
        case (
            "name" | "setup"
        ):  # mypy checks the type: an error message must not fail because of its own arguments
            return value if isinstance(value, Message) else shortened(str(value))
        case "number" if isinstance(value, int | float):
            return float(value)
        case "whole" | "stop" | "pass" if hasattr(value, "__index__"):
            return int(value)
        case "ranges" | "stops" if isinstance(value, Sequence) and not isinstance(value, str):
            return tuple(int(item) for item in value)  # type: ignore[arg-type]
        case "list" | "each" | "or" | "and" if isinstance(value, Sequence) and not isinstance(
            value, str
        ):
            return tuple(shortened(item) if isinstance(item, str) else item for item in value)
    raise TypeError(f"message {key}: {name}: expected a {kind}, found {type(value).__name__}")


def rendered(words: Words, language: Language) -> str:
    """Return a message in a language. A text stays unchanged, except that its numbers get the
    decimal comma of the language."""
    if isinstance(words, str):
        return localised(words, language)
    known = sentences().get(words.key)
    if (
        known is None or slots(words.key).keys() != words.arguments.keys()
    ):  # a message from a log of another version, without its text
        return words.key
    filled = (
        "" if slot is None else _filled(slot, words.arguments[slot.name], language)
        for _, slot in known[language]
    )
    return "".join(
        part
        for (literal, _), value in zip(known[language], filled, strict=True)
        for part in (literal, value)
    )


def _filled(slot: Slot, value: Any, language: Language) -> str:
    if isinstance(
        value, Message | str
    ):  # in a log of an older version some numbers are texts
        text = rendered(value, language)
        return setup_words(text, language) if slot.kind == "setup" else text
    match slot.kind:
        case "whole" | "number":
            text = format(value, slot.form)
            return text.replace(".", ",") if language == "de" else text
        case "stop":
            return str(value + 1)
        case "stops":
            return ranges([stop + 1 for stop in value])
        case "pass":
            way = way_of("out" if value % 2 else "back")
            return rendered(message("pass-way", number=value, way=way), language)
        case "ranges":
            return ranges(value)
        case kind:
            return _BETWEEN[kind][language].join(rendered(item, language) for item in value)


def way_of(way: Way) -> Message:
    """Return the direction of a pass as a message: out or back."""
    return message("way-out" if way == "out" else "way-back")


def run(setup: str, way: Way) -> Message:
    """Return the name of a pass as a message: its setup and its direction."""
    return message("run", setup=setup, way=way_of(way))


def at(place: Place, words: Words, stops: Sequence[int] = ()) -> Words:
    """Return a message preceded by its pass and stop. ``stops`` are several stops of the pass; if
    empty, the stop of ``place`` is used."""
    if not place.way:
        return words
    run: dict[str, Argument] = {"setup": place.setup, "way": way_of(place.way), "what": words}
    if stops:
        return message("at-stop" if len(stops) == 1 else "at-stops", stops=stops, **run)
    if place.stop is None:
        return message("in-pass", **run)
    return message("at-stop-of", stop=place.stop, last=place.last or 0, **run)


def where(place: Place) -> Words:
    """Return a place as words: setup, pass, and the stop if known; empty without a pass."""
    if place.pass_number is None:
        return ""
    about: dict[str, Argument] = {"setup": place.setup, "number": place.pass_number}
    if place.stop is None:
        return message("pass-of-setup", **about)
    return message("stop-of-setup", stop=place.stop, **about)


def joined(parts: Sequence[Words]) -> Words:
    """Return several sentences as one text, separated by semicolons."""
    return message("several", parts=parts) if len(parts) > 1 else next(iter(parts), "")


def in_every_language(words: Words) -> dict[Language, str]:
    return {language: rendered(words, language) for language in LANGUAGES}


def message_json(words: Message) -> dict[str, Any]:
    """Return a message as JSON: its key and its arguments, including arguments that are
    messages."""
    return {
        "key": words.key,
        "arguments": {name: _json(value) for name, value in words.arguments.items()},
    }


def _json(value: Argument | Item) -> Any:
    if isinstance(value, Message):
        return message_json(value)
    return (
        [_json(item) for item in value]
        if isinstance(value, Sequence) and not isinstance(value, str)
        else value
    )


def kept(words: Words) -> str:
    """Return a message as JSON text for a log, which stores it beside the English text; empty for
    words without a message. `of_log` reads this JSON text."""
    return (
        json.dumps(message_json(words), ensure_ascii=False)
        if isinstance(words, Message)
        else ""
    )


def of_log(text: str, kept_message: str) -> Words:
    """Return the message stored in a log; a message of another program is returned as its text.
    Raises ValueError for a text that is not JSON."""
    return (message_of(json.loads(kept_message)) if kept_message else None) or text


def message_of(tree: object) -> Message | None:
    """Return the message in a JSON value; None for JSON of another program."""
    try:
        return _message_of(tree)
    except (KeyError, TypeError, AttributeError):
        return None


def _message_of(tree: Any) -> Message:
    arguments: Mapping[str, Any] = tree["arguments"]
    return message_with(
        tree["key"], {name: _argument_of(value) for name, value in arguments.items()}
    )


def _argument_of(value: Any) -> Any:
    if isinstance(value, dict):
        return _message_of(value)
    return [_argument_of(item) for item in value] if isinstance(value, list) else value
