"""The terminal's language: that of the environment, for refusals, findings, tables and the
conclusion."""

import shutil
from pathlib import Path

import pytest

from stepdiag.terminal.viewer import viewers_language
from testkit.cli import stepdiag
from testkit.german import is_english

GOLDEN = Path(__file__).parents[2] / "data" / "golden_stepdiag_rigidbody_FXYZ.csv"


@pytest.mark.parametrize(
    ("given", "language"),
    [
        ({}, "en"),
        ({"LANG": "de_DE.UTF-8"}, "de"),
        ({"LANG": "de_AT", "LC_ALL": "C.UTF-8"}, "en"),
        ({"LANG": "en_GB.UTF-8", "LC_MESSAGES": "de"}, "de"),
        ({"LANG": "fr_FR.UTF-8"}, "en"),
        ({"LANG": "delta"}, "en"),
        ({"LC_ALL": "", "LANG": "de.UTF-8"}, "de"),
    ],
)
def test_the_language_is_the_one_that_posix_names(given, language, monkeypatch):
    for name in ("LC_ALL", "LC_MESSAGES", "LANG"):
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    assert viewers_language() == language


def test_a_result_is_german_where_the_terminal_is(tmp_path, monkeypatch):
    """No English word in any line, figures with a decimal comma; the numbers for programs stay as
    they are."""
    readings = tmp_path / "readings.csv"
    shutil.copy(GOLDEN, readings)
    for name in ("LC_MESSAGES", "LANG"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("LC_ALL", "C")
    english, plain = stepdiag("solve", readings), stepdiag("solve", readings, "--json")
    monkeypatch.setenv("LC_ALL", "de_DE.UTF-8")
    german = stepdiag("solve", readings, "--verbose")
    assert english.code == german.code
    assert is_english(english.out)
    lines = [line for line in german.out.splitlines() if is_english(line)]
    assert lines == []
    assert "Rechtwinkligkeit und Maßstab" in german.out
    assert stepdiag("solve", readings, "--json") == plain
