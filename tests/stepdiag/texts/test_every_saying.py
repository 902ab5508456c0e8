"""Every sentence that recording and solver can say to the page has its German: found in the source, so that a new one without it fails."""

import ast
import errno
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from stepdiag.base.errors import UsageError
from stepdiag.texts import LANGUAGES, catalogue
from stepdiag.texts.findings import sentence
from stepdiag.texts.patterns import FLOORS, tables
from stepdiag.texts.sentences import is_known, translated

ROOT = Path(__file__).parents[3]
SAYING = frozenset({"Finding", "finding", "Doubt", "Notice", "_remark", "marked", "Told", "_error", "_warning"})
REFUSING = (
    "daq/links", "daq/service/status_source.py", "stepdiag/completion/completion.py", "daq/service/daemon.py", "daq/replay.py",
    "daq/recording/verdicts.py", "daq/recording/session.py", "daq/recording/rounds.py", "stepdiag/page/remote.py",
    "exporters", "solver/adjustment", "solver/methods", "solver/model", "stepdiag/base/readings",
)  # fmt: skip
"""Where what is refused to a person at the page, said of a link, or in the way of result and export is made."""
OF_A_TERMINAL = frozenset({"address.py", "rtl.py", "sign_run.py", "sign_test.py", "verify.py", "etalon.py", "curves_csv.py"})
"""A survey file is refused before there is a page; sign tests, `verify` and other programs' files are read by commands alone."""
OF_A_ROOM = frozenset({"exporters/programs"})
"""NC programs are written by a command alone."""
WORDY = re.compile(r"[a-z]{2,} [a-z]{2,}")
FIELD = re.compile(r"\{:\w+\}")
"""A number in a text that is filled in later."""
MESSAGES = [words["en"] for floor in FLOORS for table in tables(floor).values() for words in table.values()]
ENGLISH = "\n".join([*catalogue("sentence", "en").values(), *MESSAGES])


def name_of(function: ast.expr) -> str:
    return function.id if isinstance(function, ast.Name) else function.attr if isinstance(function, ast.Attribute) else ""


class Module:
    """A file's functions and constants, to follow a name to the texts that it may hold."""

    def __init__(self, path: Path) -> None:
        self.tree = ast.parse(path.read_text(encoding="utf-8"))
        self._known: dict[ast.AST, dict[str, list[ast.expr]]] = {}
        self._exports = path.is_relative_to(ROOT / "exporters")
        made = [node for node in ast.walk(self.tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
        self.functions = {function.name: function for function in made}
        self.scope = {node: function for function in made for node in ast.walk(function)}

    def said(self) -> Iterator[str]:
        """Yield the pieces of text of every finding, doubt and remark."""
        for call in ast.walk(self.tree):
            if isinstance(call, ast.Call) and name_of(call.func) in SAYING and not self._is_note(call):
                given = [word.value for word in call.keywords if word.arg == "text"] or call.args[-1:]
                for value in given:
                    yield from self.pieces(value, self.scope.get(call), set())

    def _is_note(self, call: ast.Call) -> bool:
        """Tell whether a call makes a mere note of an export: it stands in the text file beside the tables, and nowhere else."""
        given = {word.arg: word.value for word in call.keywords}
        severity = given.get("severity")
        return self._exports and isinstance(severity, ast.Constant) and severity.value == "info"

    def refused(self) -> Iterator[str]:
        """Yield the pieces of what was expected, found and is to be done, in every refusal."""
        for call in ast.walk(self.tree):
            if isinstance(call, ast.Call) and name_of(call.func).endswith("Error"):
                for word in call.keywords:
                    if word.arg in ("expected", "found", "remedy"):
                        yield from self.pieces(word.value, self.scope.get(call), set())

    def pieces(self, value: ast.expr, scope: ast.AST | None, seen: set[str]) -> Iterator[str]:
        """Yield the texts written out in an expression, and in what its names hold."""
        for node in ast.walk(value):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield node.value
            elif isinstance(node, ast.Name) and node.id not in seen:
                seen.add(node.id)
                for held in self._held(node.id, scope):
                    yield from self.pieces(held, scope, seen)
            elif isinstance(node, ast.Call) and (called := self.functions.get(name_of(node.func))) and called.name not in seen:
                seen.add(called.name)
                for back in ast.walk(called):
                    if isinstance(back, ast.Return | ast.Yield) and back.value is not None:
                        yield from self.pieces(back.value, called, seen)

    def _held(self, name: str, scope: ast.AST | None) -> Iterator[ast.expr]:
        for where in (scope, self.tree):
            if where is not None:
                yield from self._assigned(where).get(name, [])

    def _assigned(self, where: ast.AST) -> dict[str, list[ast.expr]]:
        """Return what a function, or the whole file, puts under each name."""
        if where not in self._known:
            known: dict[str, list[ast.expr]] = {}
            for node in ast.walk(where):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AugAssign) else []
                for one in targets:
                    if isinstance(one, ast.Name):
                        known.setdefault(one.id, []).append(node.value)
            self._known[where] = known
        return self._known[where]


def without_german(texts: Iterator[str]) -> set[str]:
    """Return the pieces of several words that stand in no sentence of the catalogue, each between its semicolons."""
    whole = (piece for text in texts for piece in FIELD.split(text))
    parts = (part for text in whole for part in ([text] if text.strip(" ;,:()") in ENGLISH else text.split("; ")))
    return {part for part in parts if WORDY.search(part) and part.strip(" ;,:()") not in ENGLISH}


def of_a_terminal(path: Path) -> bool:
    return path.name in OF_A_TERMINAL or str(path.parent.relative_to(ROOT)) in OF_A_ROOM


def sources(*places: str) -> list[Path]:
    found = [ROOT / place for place in places]
    return sorted(path for place in found for path in (place.rglob("*.py") if place.is_dir() else [place]))


@pytest.mark.parametrize("path", sources("daq", "solver", "exporters"), ids=lambda path: str(path.relative_to(ROOT)))
def test_every_finding_and_doubt_has_its_german(path: Path) -> None:
    """What recording and solver say of a survey and what stops an export, word for word."""
    assert without_german(Module(path).said()) == set()


@pytest.mark.parametrize(
    "path", [path for path in sources(*REFUSING) if not of_a_terminal(path)], ids=lambda path: str(path.relative_to(ROOT))
)
def test_every_refusal_and_link_error_has_its_german(path: Path) -> None:
    """What a person is told who presses a button, and why a link is lost."""
    assert without_german(Module(path).refused()) == set()


def test_the_words_of_the_system_have_their_german() -> None:
    """A port that is gone, taken, or not allowed: what Linux says stands in brackets, and not in English."""
    codes = (
        "ENOENT EACCES EPERM EBUSY EAGAIN EIO ENODEV ENXIO ENOSPC EROFS ECONNREFUSED ECONNRESET ECONNABORTED EPIPE EHOSTUNREACH EHOSTDOWN"
    )
    codes += " ENETUNREACH ENETDOWN ETIMEDOUT EINVAL ENOTTY EDQUOT"
    assert [name for name in codes.split() if not is_known(os.strerror(getattr(errno, name)))] == []


@pytest.mark.parametrize(
    ("refusal", "german"),
    [
        (
            UsageError("abort", expected="a setup that is being recorded", found="none"),
            "abbrechen: erwartet war ein Aufbau, der gerade aufgezeichnet wird, gefunden keines",
        ),
        (
            UsageError("serial port /dev/ttyUSB0", expected="a port that opens", found="Permission denied", remedy="try again"),
            (
                "serielle Schnittstelle /dev/ttyUSB0: erwartet war eine Schnittstelle, die sich öffnen lässt, gefunden keine Berechtigung; "
                "noch einmal versuchen"
            ),
        ),
        (
            UsageError(
                "port socket://ts:4001",
                expected="a port that stays",
                found="it is gone (Connection reset by peer)",
                remedy="check the cable; the program reconnects by itself",
            ),
            (
                "Anschluss socket://ts:4001: erwartet war eine Schnittstelle, die da bleibt, gefunden sie ist weg "
                "(Verbindung von der Gegenseite abgebrochen); Kabel prüfen; das Programm verbindet sich von selbst wieder"
            ),
        ),
    ],
)
def test_a_refusal_reads_in_german(refusal: UsageError, german: str) -> None:
    """Whole, with what it quotes."""
    assert translated(str(refusal), "de") == german
    assert translated(str(refusal), "en") == str(refusal)


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_doubt_keeps_its_place_and_its_figures(language: str) -> None:
    """What the solver doubts names the pass, the stop and the size in the reader's language."""
    text = (
        "npp out, stop 7 of 30: count slip of +1.9 um on the way to this stop (against npp back, pass 2; the other steps scatter by 0.2 um)"
    )
    said = sentence("count-slip", text, language)
    wanted = {
        "en": "npp out, stop 7: count slip of +1.9 um on the way to this stop",
        "de": "npp hin, Messpunkt 7: Zählsprung von +1,9 µm auf dem Weg zu diesem Messpunkt",
    }
    assert said.startswith(wanted[language])
