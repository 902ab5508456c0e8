"""The terminal's language: that of the environment, for refusals, findings, tables and the
conclusion."""

import io
import shutil
import sys
from pathlib import Path

import pytest
from rich.console import Console

from stepdiag.base.messages import message
from stepdiag.cli.app import main
from stepdiag.demo.reach import FORMS
from stepdiag.terminal.viewer import empty_table, print_words, shown, viewers_language
from stepdiag.texts.texts import LANGUAGES, Language
from testkit.cli import joined, stepdiag
from testkit.german import is_english
from testkit.planned import plan_once

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


def test_lines_are_wrapped_at_words_and_a_command_stays_whole(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A command that is broken cannot be copied. The tests read the lines as they were before."""
    monkeypatch.setenv("COLUMNS", "40")
    command = "`stepdiag accept survey.toml ppp/1/5 --reason dust`"
    line = f"  every pass is in and no result is there yet: {command} makes one"
    print_words(line, "end")
    printed = capsys.readouterr().out
    lines = printed.splitlines()
    assert lines[0] == "  every pass is in and no result is"
    assert [each.strip() for each in lines if command in each] == [command]
    assert all(len(each) <= 40 or command in each for each in lines)
    assert all(each.startswith("    ") for each in lines[1:-1])
    assert joined(printed) == f"{line}\nend\n"


@pytest.mark.parametrize("figure", ["9.8 µm", "95 %", "0.3 °C", "12 min"])
def test_a_figure_keeps_its_unit(
    figure: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """At every width of the terminal."""
    line = f"the result states {figure} and one slip more"
    for columns in range(12, 45):
        monkeypatch.setenv("COLUMNS", str(columns))
        print_words(line)
        printed = capsys.readouterr().out
        assert figure in printed
        assert joined(printed) == f"{line}\n"


def test_an_answer_fits_a_screen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 30 lines of 80 columns, without options."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("testkit.cli.joined", lambda text: text)
    plan_once(monkeypatch)
    readings, result, survey = (
        tmp_path / name for name in ("r.csv", "result.json", "s.toml")
    )
    shutil.copy(GOLDEN, readings)
    assert stepdiag("solve", readings, "--out", result).code == 0
    assert stepdiag("init", survey).code == 0
    for command in (
        ("solve", readings),
        ("plan", survey),
        ("export", result, "--controller", "siemens", "--out", tmp_path / "files"),
        ("verify", result, tmp_path / "files"),
    ):
        lines, whole = (
            stepdiag(*command, *options).out.splitlines() for options in ((), ("--verbose",))
        )
        assert 5 < len(lines) <= 30, command
        assert len(lines) < len(whole), command
        assert max(map(len, lines)) <= 80, command


@pytest.mark.parametrize(("terminal", "columns"), [("", 80), ("60", 60), ("250", 100)])
def test_a_line_is_as_wide_as_the_terminal_and_at_most_100_columns(
    terminal: str,
    columns: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Without a terminal, as in a pipe, it has 80."""
    monkeypatch.setenv("COLUMNS", terminal)
    monkeypatch.setattr(sys, "__stdout__", None)
    print_words("word " * 99)
    assert {len(each) for each in capsys.readouterr().out.splitlines()[:-1]} <= {
        *range(columns - 5, columns + 1)
    }


def test_a_refusal_is_wrapped_like_any_other_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A refusal often holds three sentences, and the path of a file."""
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(sys, "argv", ["stepdiag", "solve", "absent.csv"])
    with pytest.raises(SystemExit) as ended:
        main()
    lines = capsys.readouterr().err.splitlines()
    assert ended.value.code == 2
    assert len(lines) > 1
    assert all(len(line) <= 60 for line in lines)


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_demo_names_each_form_in_a_line(
    language: Language, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a terminal of 80 columns."""
    monkeypatch.setenv("LANG", language)
    monkeypatch.delenv("LC_ALL", raising=False)
    monkeypatch.delenv("LC_MESSAGES", raising=False)
    names = [message("demo-fanuc"), message("demo-siemens"), *(form.name for form in FORMS)]
    table = empty_table(message("table-demo"))
    for name in names:
        table.add_row(shown(name), "10.00", "100.00", "10.00")
    drawn = io.StringIO()
    Console(file=drawn, width=80).print(table)
    rows = [line for line in drawn.getvalue().splitlines() if line.startswith("│")]
    assert len(rows) == len(names)
