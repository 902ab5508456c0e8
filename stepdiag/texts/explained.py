"""The meaning of every finding in every language, from ``findings.toml``: its cause, its cost and
its remedy."""

import tomllib
from collections.abc import Container
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal

from stepdiag.texts.texts import LANGUAGES, Language

Action = Literal["repeat", "accept", "mend-wiring", "mend-file", "choose", "know"]
Severity = Literal["info", "warning", "error"]
GROUPS = ("recording", "result", "head", "export", "remark")
"""The groups of findings by their source; the last two groups belong to an export."""
_OF_AN_EXPORT: dict[Severity, Action] = {
    "error": "mend-file",
    "warning": "accept",
    "info": "know",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Words:
    cause: str
    cost: str
    do: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """A code: its source (one of `GROUPS`), the operator's action, and its words in every
    language."""

    group: str
    action: Action
    words: dict[Language, Words]

    def action_at(self, severity: Severity) -> Action:
        """Return the action that a finding with this severity requires from a person. For findings
        of an export, a warning requires that the person accepts its code, and a note requires no
        action."""
        return (
            self.action
            if severity == "error" or self.group not in ("export", "remark")
            else _OF_AN_EXPORT[severity]
        )


@cache
def _tables() -> dict[str, Any]:
    return tomllib.loads(
        files("stepdiag.texts").joinpath("findings.toml").read_text(encoding="utf-8")
    )


@cache
def explanations() -> dict[str, Explanation]:
    """Return the explanation of every code in the order of the documentation."""
    return {
        code: Explanation(
            group=group,
            action=entry["action"],
            words={language: Words(**entry[language]) for language in LANGUAGES},
        )
        for group in GROUPS
        for code, entry in _tables()[group].items()
    }


def keys_of(old: str) -> tuple[str, ...]:
    """Return the present keys (code, or code and variant) of a code of an older version; any other
    code unchanged."""
    return tuple(_tables()["renamed"].get(old, [old]))


def accepted(code: str, key: str, accept: Container[str]) -> bool:
    """Return whether a finding is accepted by its code, its key, or its name in an older
    version."""
    former = (old for old, keys in _tables()["renamed"].items() if key in keys)
    return any(name in accept for name in (code, key, *former))


def explained(code: str) -> Explanation | None:
    """Return the explanation of a code, also of a renamed code, or None for an undocumented
    code."""
    return explanations().get(keys_of(code)[0].partition(".")[0])


def finding_advice(code: str, language: Language) -> str:
    """Return the meaning of a finding, its cost and its remedy; empty texts for an undocumented
    code."""
    entry = explained(code)
    words = None if entry is None else entry.words[language]
    return "" if words is None else f"{words.cause} {words.cost} {words.do}"


def advice_of(code: str, language: Language) -> str:
    """Return the remedy of a finding; empty for an undocumented code."""
    entry = explained(code)
    return "" if entry is None else entry.words[language].do


def finding_action(code: str, severity: Severity) -> Action:
    entry = explained(code)
    return _OF_AN_EXPORT[severity] if entry is None else entry.action_at(severity)
