"""The table of faults says what the tests show: every row names a test that exists and asks for
what the row says is said."""

import re
from functools import cache
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[2]
PAGE = (CHECKOUT / "docs" / "faults.md").read_text(encoding="utf-8")
ROWS = [
    line
    for line in PAGE.partition("| fault | finding |")[2].partition("\n\n")[0].splitlines()
    if line.startswith("| ")
]
NO_FINDINGS = {"survey-open", "link-silent", "answers-late", "recorder", "status"}
"""Events of the journal, and commands."""


@cache
def suite():
    """Return the text of all tests of one file name, by that name."""
    found: dict[str, str] = {}
    for path in (CHECKOUT / "tests").rglob("test_*.py"):
        found[path.stem] = found.get(path.stem, "") + path.read_text(encoding="utf-8")
    found["test_files_after_faults"] += (
        CHECKOUT / "tests" / "lib" / "testkit" / "fault_cases.py"
    ).read_text(encoding="utf-8")
    return found


@cache
def known_codes():
    """Return the codes that docs/findings.md explains."""
    return set(
        re.findall(
            r"^\| `([a-z0-9-]+)` \|",
            (CHECKOUT / "docs" / "findings.md").read_text(encoding="utf-8"),
            flags=re.MULTILINE,
        )
    )


def cells_of(row):
    """Return fault, what is said, what becomes of it, what to do, and the test."""
    return [cell.strip() for cell in row.strip("|\n ").split(" | ")]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: cells_of(row)[0])
def test_what_a_row_says_is_asked_by_the_test_that_it_names(row):
    _, said, _, todo, test = cells_of(row)
    named = re.findall(r"`(test_\w+)`", test)
    assert named, "a row without a test"
    assert todo
    assert set(named) <= set(suite())
    codes = [code for code in re.findall(r"`([a-z-]+)`", said) if "." not in code]
    assert set(codes) <= known_codes() | NO_FINDINGS
    asked = "".join(suite()[name] for name in named)
    assert not codes or any(code in asked for code in codes)


def test_the_page_tells_of_every_kind_of_fault_of_the_hall():
    assert len(ROWS) >= 30
