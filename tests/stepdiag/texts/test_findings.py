"""Every code that the program can say is explained to a person, in the documentation and in both languages of the page."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from stepdiag.texts.patterns import FLOORS, tables
from stepdiag.texts.texts import LANGUAGES, catalogue, finding_advice

ROOT = Path(__file__).parents[3]
SOURCES = ("solver", "exporters", "daq", "stepdiag")
SAYING = frozenset({"Finding", "SafetyError", "finding", "_error", "_warning", "_note", "_remark"})
KEBAB = re.compile(r"[a-z0-9]+(-[a-z0-9]+)+")


def documented() -> list[str]:
    """Return the codes of docs/findings.md in the order of its tables."""
    return re.findall(r"^\| `([a-z0-9-]+)` \|", (ROOT / "docs" / "findings.md").read_text(encoding="utf-8"), re.MULTILINE)


@cache
def said() -> tuple[tuple[str, str], ...]:
    """Return (code, file) for every code written out where a finding or a refusal is made."""
    return tuple(_said())


def _said() -> Iterator[tuple[str, str]]:
    for path in (path for folder in SOURCES for path in sorted((ROOT / folder).rglob("*.py"))):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and _name(call.func) in SAYING:
                given = [keyword.value for keyword in call.keywords if keyword.arg == "code"] or call.args[:1]
                yield from ((one.value, str(path.relative_to(ROOT))) for one in given if _is_code(one))
    for floor in FLOORS:
        for key in tables(floor)["finding"]:
            yield key.partition(".")[0], f"{floor}/messages"


def _name(function: ast.expr) -> str:
    return function.id if isinstance(function, ast.Name) else function.attr if isinstance(function, ast.Attribute) else ""


def _is_code(value: ast.expr) -> bool:
    return isinstance(value, ast.Constant) and isinstance(value.value, str) and bool(KEBAB.fullmatch(value.value))


def test_the_search_finds_codes() -> None:
    """The search itself works: codes of three floors are among what it finds."""
    codes = {code for code, _ in said()}
    assert {"mirror-misaligned", "value-beyond-limit", "unplanned-setup"} <= codes


def test_every_code_is_documented_once() -> None:
    """No code without its line in docs/findings.md, and no line twice."""
    codes = documented()
    assert sorted({f"{code} in {path}" for code, path in said() if code not in codes}) == []
    assert len(codes) == len(set(codes))


@pytest.mark.parametrize("language", LANGUAGES)
def test_what_the_page_shows_has_advice(language: str) -> None:
    """Every finding of recording and solving, not those of an export, has advice in both languages."""
    for code, path in said():
        if path.startswith(("solver/", "daq/")):
            assert finding_advice(code, language), f"{code} in {path}"


def test_the_documentation_says_what_the_page_says() -> None:
    """The first tables are the catalogue's English texts, word for word."""
    text = (ROOT / "docs" / "findings.md").read_text(encoding="utf-8")
    for code, words in catalogue("finding", "en").items():
        assert f"| `{code}` | {words} |" in text
