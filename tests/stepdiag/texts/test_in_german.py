"""A German reader reads German: report and page with findings of every code, refusals, what the
system refuses, names of the budget."""

import errno
import html
import os
import re
from dataclasses import replace

import pytest

from stepdiag.base.errors import UsageError, system_words
from stepdiag.base.findings import Finding, finding, in_words
from stepdiag.base.messages import (
    Argument,
    Message,
    Place,
    at,
    joined,
    kept,
    message,
    rendered,
)
from stepdiag.daq.records.status import FindingStatus
from stepdiag.page.view import grouped
from stepdiag.report.document import build_report
from stepdiag.solver.methods.solve import solve
from stepdiag.texts.explained import advice_of, explanations
from stepdiag.texts.patterns import Kind, findings, slots
from stepdiag.texts.ranges import ranges
from stepdiag.texts.texts import catalogue, localised
from testkit.exact.madeup import made_up_result
from testkit.exact.surveys import Bench
from testkit.german import is_english

GIVEN: dict[Kind, Argument] = {
    "name": "X7",
    "whole": 3,
    "number": 1.25,
    "list": ["X7", "X8"],
    "each": ["X7", "X8"],
    "or": ["X7", "X8"],
    "and": ["X7", "X8"],
    "stops": [1, 2, 4],
    "ranges": [1, 2, 4],
    "stop": 3,
    "pass": 2,
    "setup": "npp",
}
HERE = "Diagonale X-Y-Z- nach X+Y+Z+ (ppp) hin, Messpunkt 6: "
PLACE = Place(setup="ppp", way="out", pass_number=1, stop=5, last=30)


def made(key: str) -> Finding:
    """Return the finding of a key with all its arguments."""
    given = {name: GIVEN[kind] for name, kind in slots(key).items()}
    return finding("warning", message(key, **given), PLACE)


MADE = [made(key) for key in sorted(findings())]


def read_in(document: str) -> list[str]:
    """Return the texts between the tags of a document, without style, script, names of files and
    hashes."""
    bare = re.sub(r"<(style|script|code|title)\b.*?</\1>", " ", document, flags=re.DOTALL)
    return [
        html.unescape(text).strip() for text in re.split(r"<[^<>]*>", bare) if text.strip()
    ]


def test_the_report_with_every_finding_is_german() -> None:
    """Findings of every code and variant, with their advice, tables, headings and the budget."""
    result = made_up_result(
        budget={
            "assumptions": {},
            "shares": {"EXX": {"wander": 0.1}},
            "combined": {"EXX": 0.1},
        }
    )
    result = replace(result, findings=tuple(MADE))
    document = build_report(result, source="r.json", language="de").html
    assert [text for text in read_in(document) if is_english(text)] == []
    assert all(
        f">{code}<" in document or code in document for code in {one.code for one in MADE}
    )
    assert is_english(build_report(result, source="r.json", language="en").html)


def test_the_page_with_every_finding_is_german() -> None:
    """Each with its place, its arguments and what to do."""
    shown = [
        FindingStatus(
            code=one.code, severity=one.severity, text=one.text, message=one.message, at=PLACE
        )
        for one in MADE
    ]
    entries = [entry for one in shown for entry in grouped([one])]
    german = [
        text for entry in entries for text in (entry["sentence"]["de"], entry["advice"]["de"])
    ]
    assert [text for text in german if is_english(text)] == []
    assert all(entry["sentence"]["de"].startswith(HERE) for entry in entries)
    assert {entry["code"] for entry in entries} == {one.code for one in MADE}


@pytest.mark.parametrize("code", explanations())
def test_advice_is_german(code: str) -> None:
    """What a finding costs and what to do, of every code."""
    assert advice_of(code, "de")
    assert not is_english(advice_of(code, "de"))


def test_the_words_of_the_system_are_german() -> None:
    """A port that is gone, taken, or not allowed, with the very words of the system in English."""
    codes = (
        "ENOENT EACCES EPERM EBUSY EAGAIN EIO ENODEV ENXIO ENOSPC EROFS ECONNREFUSED ECONNRESET "
        "ECONNABORTED EPIPE EHOSTUNREACH EHOSTDOWN"
    )
    codes += " ENETUNREACH ENETDOWN ETIMEDOUT EINVAL ENOTTY EDQUOT"
    for code in (getattr(errno, name) for name in codes.split()):
        for words in (system_words(code), system_words(OSError(code, os.strerror(code)))):
            assert rendered(words, "en") == os.strerror(code)
            assert rendered(words, "de") != os.strerror(code)
    assert system_words(OSError(errno.EXDEV, "another disk")) == "another disk"
    assert system_words(ValueError("no number")) == "no number"


def test_a_refusal_reads_in_german() -> None:
    """Whole, with the refusal of the system in it."""
    refusal = UsageError(
        message("where-serial", name="/dev/ttyUSB0"),
        expected=message("expects-opens"),
        found=system_words(errno.EACCES),
        remedy=message("try-again"),
    )
    assert rendered(refusal.message, "de") == (
        "serielle Schnittstelle /dev/ttyUSB0: erwartet war eine Schnittstelle, die sich öffnen "
        "lässt, gefunden keine Berechtigung; "
        "noch einmal versuchen"
    )


STEP = message("window-step", step_um=2.5)
LOST = message("losses", causes=[message("beam-was-lost"), message("laser-head-error")])
READ = [
    message(
        "pass-why",
        number=1,
        why=message(
            "stops-without-start",
            stops=[5, 6],
            why=LOST,
            again=message("again-from-or-whole", stop=4),
        ),
    ),
    message("stops-misfit", stops=[5], misfit_um=2.5),
    message("pass-why", number=1, why=message("stops-off", stops=[5, 6], why=STEP, stop=2)),
    joined(
        [
            STEP,
            message("window-step.strays", wrong=25, count=40),
            message("laser-frozen", same=20, count=41),
        ]
    ),
    at(
        Place(setup="ppp", way="back", stop=5, last=30),
        message("beam-lost", why=message("no-sample-for", seconds_s=2.5)),
    ),
    message("recording-gap", events=12, bytes=25, why=message("disk-slower")),
    message(
        "of-stream",
        stream=message("stream-laser"),
        what=message("samples-between", count=2, a=65203, b=65205),
    ),
    message("bytes-lost-at", causes=[message("lost-framing", count=4)]),
]


@pytest.mark.parametrize("words", READ, ids=lambda words: words.key)
def test_the_words_of_the_recorder_are_german_with_their_figures(words: Message) -> None:
    """A reason of a setup, a doubt, a finding: none stays English, however deep it is nested."""
    german = rendered(words, "de")
    assert not is_english(german), german
    assert re.findall(r"\d+", german) == re.findall(r"\d+", rendered(words, "en"))


def test_the_budget_is_german() -> None:
    """Every source, every assumption and every quantity of a solved survey has words of its own in
    German."""
    result = solve(Bench(seed=5, increments=4).survey())
    assert result.budget is not None
    english, german = (catalogue("report", language) for language in ("en", "de"))
    for source in result.budget.assumptions:
        key = f"source_{source.replace(' ', '_')}"
        assert english[key] == source
        assert german[key]
    assert all(
        isinstance(words, Message) and not is_english(rendered(words, "de"))
        for words in result.budget.assumptions.values()
    )


def test_an_old_text_stands_as_it_is() -> None:
    """Of a log or result that holds no message."""
    old = Finding(
        code="count-slip",
        severity="warning",
        text="ppp out, stop 5 of 30: the laser's count jumped by +1.9 µm",
    )
    assert in_words(old, "de") == old.text
    assert kept(old.text) == ""


@pytest.mark.parametrize(
    ("text", "german"),
    [
        ("1.5 µm", "1,5 µm"),
        ("stepdiag 0.1.0", "stepdiag 0.1.0"),
        ("192.168.1.10", "192.168.1.10"),
        ("−20.05", "−20,05"),
        ("Ende 5.", "Ende 5."),
    ],
)
def test_only_numbers_get_a_comma(text: str, german: str) -> None:
    """Versions, addresses and the ends of sentences keep their points."""
    assert localised(text, "de") == german
    assert localised(text, "en") == text


def test_ranges_of_stops() -> None:
    """Neighbours are one range."""
    assert ranges([5, 6, 7, 9, 11, 12]) == "5–7, 9, 11–12"
