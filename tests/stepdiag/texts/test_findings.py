"""Every code that the program can say is explained to a person, in the documentation and in both
languages of the page."""

import ast
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from subprocess import run

import pytest

from stepdiag.texts.explained import (
    accepted,
    explained,
    explanations,
    finding_advice,
    keys_of,
)
from stepdiag.texts.patterns import FLOORS, tables
from stepdiag.texts.texts import LANGUAGES, Language
from testkit.german import is_english

ROOT = Path(__file__).parents[3]
SOURCES = ("solver", "exporters", "daq", "stepdiag")
SAYING = frozenset(
    {"Finding", "SafetyError", "finding", "_error", "_warning", "_note", "_remark"}
)
KEBAB = re.compile(r"[a-z0-9]+(-[a-z0-9]+)+(\.[a-z0-9-]+)?")
RENAMED = sorted(
    tomllib.loads(
        (ROOT / "stepdiag" / "texts" / "findings.toml").read_text(encoding="utf-8")
    )["renamed"]
)


@cache
def said() -> tuple[tuple[str, str], ...]:
    """Return (code, file) for every code written out where a finding or a refusal is made."""
    return tuple(_said())


def _said() -> Iterator[tuple[str, str]]:
    for path in (
        path for folder in SOURCES for path in sorted((ROOT / folder).rglob("*.py"))
    ):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and _name(call.func) in SAYING:
                given = [
                    keyword.value for keyword in call.keywords if keyword.arg == "code"
                ] or call.args[:1]
                yield from (
                    (one.value, str(path.relative_to(ROOT))) for one in given if _is_code(one)
                )
    for floor in FLOORS:
        for key in tables(floor)["finding"]:
            yield key, f"{floor}/messages"


def _name(function: ast.expr) -> str:
    return (
        function.id
        if isinstance(function, ast.Name)
        else function.attr
        if isinstance(function, ast.Attribute)
        else ""
    )


def _is_code(value: ast.expr) -> bool:
    return (
        isinstance(value, ast.Constant)
        and isinstance(value.value, str)
        and bool(KEBAB.fullmatch(value.value))
    )


def test_the_search_finds_codes() -> None:
    """The search itself works: codes of three floors are among what it finds."""
    codes = {code.partition(".")[0] for code, _ in said()}
    assert {"mirror-misaligned", "value-large", "unplanned-setup"} <= codes


def test_every_code_is_explained() -> None:
    """No code without cause, cost and action; its documentation is written from the same file
    (tools/findings)."""
    codes = {code.partition(".")[0] for code, _ in said()}
    assert sorted(code for code in codes if explained(code) is None) == []


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("code", explanations())
def test_an_explanation_is_whole(code: str, language: Language) -> None:
    """Cause, cost and what to do are sentences of their language."""
    words = explanations()[code].words[language]
    for sentence in (words.cause, words.cost, words.do):
        assert sentence.endswith(".")
        assert sentence == sentence.strip()
        assert language == "en" or not is_english(sentence)
    assert finding_advice(code, language) == f"{words.cause} {words.cost} {words.do}"


def test_the_documentation_is_written_from_the_catalogue() -> None:
    """A word that changes in findings.toml changes docs/findings.md."""
    done = run(
        [ROOT / "tools" / "findings", "--check", "docs/findings.md"],
        check=False,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_few_codes() -> None:
    """What differs only in who raised it is one code."""
    assert len(explanations()) <= 120


@pytest.mark.parametrize("old", RENAMED)
def test_a_code_of_before_has_its_successor(old: str) -> None:
    """A code of an old log is explained; no new finding has it."""
    assert explained(old) is not None
    assert old not in explanations()
    assert all(key.partition(".")[0] in explanations() for key in keys_of(old))


def test_an_acceptance_of_before_counts() -> None:
    """An old name accepts what it accepted then, and no other finding of the same code."""
    assert accepted(
        "machine-file-differs", "machine-file-differs.increment", ["least-input-differs"]
    )
    assert not accepted(
        "machine-file-differs", "machine-file-differs.diameters", ["least-input-differs"]
    )
    assert accepted("old-table-lost", "old-table-lost.slope-of-table", ["old-slope-lost"])
    assert accepted("value-large", "value-large.lattice", ["value-large"])
    assert not accepted("value-large", "value-large", ["slope-steep"])
