"""A finding about the data: code, severity, action, place, and the message for a person."""

from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Any

from stepdiag.base.messages import (
    Argument,
    Message,
    Place,
    Way,
    Words,
    at,
    message_json,
    message_with,
    rendered,
)
from stepdiag.texts.explained import Action, Severity, accepted, finding_action
from stepdiag.texts.patterns import findings as finding_keys
from stepdiag.texts.texts import Language

__all__ = ["Finding", "Severity", "error", "finding", "in_words", "info", "warning"]

NOWHERE = Place()
PROOF = "proof"
"""Code of the finding that contains the verdict of a proof run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A finding, made by `finding` from a message. ``code`` is stable and documented in
    docs/findings.md.

    ``text`` is the English sentence. Old logs and results contain only this text. ``setup``,
    ``way``, ``pass_number`` and ``stop`` are the place of the finding if known; ``last`` is the
    number of the last stop of the pass. ``size_um`` is the size of the fault. ``among`` contains
    the passes (``ppp/1``) that can be the cause if the data do not show which pass is the cause.
    """

    code: str
    severity: Severity
    text: str
    message: Message | None = None
    setup: str = ""
    way: Way = ""
    pass_number: int | None = None
    stop: int | None = None
    last: int | None = None
    size_um: float | None = None
    among: tuple[str, ...] = ()

    @property
    def action(self) -> Action:
        return finding_action(self.code, self.severity)

    @property
    def key(self) -> str:
        """Return the key of the message (code, or code and variant after a dot). For a message that
        several codes use, return the code of the finding."""
        words = self.message
        return words.key if words is not None and words.code == self.code else self.code

    @property
    def place(self) -> Place:
        return Place(
            setup=self.setup,
            way=self.way,
            pass_number=self.pass_number,
            stop=self.stop,
            last=self.last,
        )

    @property
    def words(self) -> Words:
        """Return the place and the message of the finding. A finding of an old log or result has no
        message; its text is returned."""
        return self.text if self.message is None else at(self.place, self.message)

    def is_accepted(self, accept: Container[str]) -> bool:
        """Return whether a person has accepted the finding by its code, its key, or its code in an
        older version."""
        return accepted(self.code, self.key, accept)

    def as_json(self) -> dict[str, Any]:
        """Return the finding as JSON of contract 4: code, severity, action, text, arguments of the
        text, and place if known.

        ``key`` is included for a code with several sentences.
        """
        place = {
            "setup": self.setup or None,
            "pass": self.pass_number,
            "stop": self.stop,
            "size_um": self.size_um,
        }
        known: dict[str, Any] = {
            name: value for name, value in place.items() if value is not None
        }
        if self.among:
            known["among"] = list(self.among)
        if self.message is not None:
            words = message_json(self.message)
            known |= {"arguments": words["arguments"]} | (
                {} if words["key"] == self.code else {"key": words["key"]}
            )
        return {
            "code": self.code,
            "severity": self.severity,
            "action": self.action,
            "text": self.text,
            **known,
        }


def in_words(found: Finding, language: Language, stops: Sequence[int] = ()) -> str:
    """Return the sentence of a finding in a language. ``stops`` are the stops of the pass that have
    this finding. Without ``stops``, the stop in the finding is used.

    The text of an old log or result stays unchanged.
    """
    if found.message is None:
        return found.text
    own = () if found.stop is None else (found.stop,)
    return rendered(at(found.place, found.message, sorted(set(stops)) or own), language)


def finding(
    severity: Severity,
    words: Message,
    place: Place = NOWHERE,
    *,
    code: str = "",
    size_um: float | None = None,
    among: tuple[str, ...] = (),
) -> Finding:
    """Return the finding of a message. The code of the finding is the first part of the message's
    key, before the dot. A message that several codes use (a phrase) needs ``code``.

    Raises KeyError for a phrase without a code.
    """
    if not code and words.key not in finding_keys():
        raise KeyError(words.key)
    return Finding(
        code=code or words.code,
        severity=severity,
        text=rendered(at(place, words), "en"),
        message=words,
        setup=place.setup,
        way=place.way,
        pass_number=place.pass_number,
        stop=place.stop,
        last=place.last,
        size_um=size_um,
        among=among,
    )


def error(key: str, /, **arguments: Argument) -> Finding:
    """Return an error without a place, from the key and the arguments of its message."""
    return finding("error", message_with(key, arguments))


def warning(key: str, /, **arguments: Argument) -> Finding:
    """Return a warning without a place, from the key and the arguments of its message."""
    return finding("warning", message_with(key, arguments))


def info(key: str, /, **arguments: Argument) -> Finding:
    """Return a note without a place, from the key and the arguments of its message."""
    return finding("info", message_with(key, arguments))
