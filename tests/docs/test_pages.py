"""The documentation as it is read: its Python runs, its links lead somewhere, its tables say what
the program has."""

import ast
import json
import re
import runpy
import shutil
import tomllib
from datetime import date
from itertools import chain
from pathlib import Path

import pytest

from stepdiag.cli.completion import PROGRAMS, TABLES
from stepdiag.daq.passes.survey_time import BUILT
from testkit.cli import stepdiag
from testkit.exact.surveys import DATA

CHECKOUT = Path(__file__).parents[2]
DOCS = CHECKOUT / "docs"
PAGES = [
    *sorted(DOCS.rglob("*.md")),
    *(
        CHECKOUT / name
        for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")
    ),
]
LINK = re.compile(r"\]\(([^)\s]+)\)")
READINGS = DATA / "golden_stepdiag_rigidbody_FXYZ.csv"


def python_in(page: str) -> list[str]:
    return re.findall(
        r"```python\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), flags=re.DOTALL
    )


@pytest.fixture
def beside_readings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copyfile(READINGS, tmp_path / "readings.csv")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_readings_in_and_result_out_in_five_lines(
    beside_readings: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (code,) = python_in("api.md")
    assert len([line for line in code.splitlines() if line]) <= 5
    exec(code, {})
    assert re.fullmatch(r"Y leans -?\d+\.\d µrad to X\n", capsys.readouterr().out)
    assert (beside_readings / "result.json").stat().st_size > 1000


def test_the_example_runs_from_its_first_line_to_its_last(
    beside_readings: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names: dict[str, object] = {}
    for block in python_in("example.md"):
        exec(block, names)
    said = capsys.readouterr().out
    assert len(re.findall(r"^[CBA]0[YZ]: .*\(k = 2\)$", said, flags=re.MULTILINE)) == 3
    assert len(re.findall(r"^E[XYZ]{2}: .* U = ", said, flags=re.MULTILINE)) == 9
    assert "True" in said.splitlines()
    assert re.search(r"^[\d.]+ to [\d.]+$", said, flags=re.MULTILINE)


def test_a_survivor_with_a_reason_is_a_line_of_the_program() -> None:
    told = runpy.run_path(str(CHECKOUT / "tools" / "mutants" / "reasons.py"))["known"]()
    lines = {
        path: {
            line.strip()
            for line in (CHECKOUT / path).read_text(encoding="utf-8").splitlines()
        }
        for path, _, _ in told
    }
    assert len(told) > 20
    assert not [(path, line) for path, _, line in told if line not in lines[path]]


def released(changelog: str) -> list[date]:
    """Return the day of each version, newest first. Raises ValueError for a version without one."""
    sections = re.findall(
        r"^## \[(?!Unreleased\])([^\]]+)\](?: - (\S+))?$", changelog, flags=re.MULTILINE
    )
    return [date.fromisoformat(day) for _, day in sections]


def test_the_site_keeps_tables_and_lists_inside_their_steps() -> None:
    """Python-Markdown ends a list at a table that three spaces indent: steps 6 to 8 of the
    machinist's guide were one paragraph."""
    indented = runpy.run_path(str(CHECKOUT / "tools" / "docs"))["indented"]
    page = "1. a\n   - b\n\n   | c |\n2. d\n\n```\n   e\n```\n"
    assert indented(page) == "1. a\n    - b\n\n    | c |\n\n2. d\n\n```\n   e\n```\n"


def test_no_log_is_older_than_the_first_version() -> None:
    """The day before which a clock was never set stays: a log of the first version is dated in
    every later one."""
    days = released((CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert days == sorted(days, reverse=True)
    assert BUILT.date() == days[-1]


def test_the_version_is_the_newest_section_of_the_change_list() -> None:
    sections = re.findall(
        r"^## \[(?!Unreleased\])([^\]]+)\]",
        (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )
    assert (
        tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["tool"]["stepdiag"][
            "release"
        ]
        == sections[0]
    )


def test_a_version_without_a_day_is_found() -> None:
    assert released("## [Unreleased]\n\n## [1.0.0] - 2027-01-02\n") == [date(2027, 1, 2)]
    with pytest.raises(ValueError, match="isoformat"):
        released("## [1.0.0]\n")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    inside = [
        link
        for link in LINK.findall(text)
        if "://" not in link and not link.startswith("mailto:")
    ]
    for link in inside:
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        if anchor:
            headings = re.findall(
                r"^#+ (.+)$", target.read_text(encoding="utf-8"), flags=re.MULTILINE
            )
            assert anchor in {
                re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
                for heading in headings
            }, link


def test_the_site_shows_every_page() -> None:
    site = (CHECKOUT / "mkdocs.yml").read_text(encoding="utf-8")
    listed = re.findall(
        r": ([\w/-]+\.md)$|- (decisions/[\w-]+\.md)$", site, flags=re.MULTILINE
    )
    assert {str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md")} <= set(chain(*listed))


def test_every_command_of_the_readme_exists() -> None:
    """Commands of the program with their options, and targets of the Makefile: whoever types them
    is understood."""
    readme = (CHECKOUT / "README.md").read_text(encoding="utf-8")
    wanted = set(re.findall(r"(?:^    |`)make ([a-z-]+)", readme, flags=re.MULTILINE))
    made = set(
        re.findall(
            r"^([a-z-]+):.*## ",
            (CHECKOUT / "Makefile").read_text(encoding="utf-8"),
            flags=re.MULTILINE,
        )
    )
    assert {"demo", "test", "deb", "release"} <= wanted <= made
    typed = re.findall(r"(?:\.venv/bin/|`)stepdiag ([a-z]\w*)((?: [^\n`#]+)?)", readme)
    assert {
        "demo",
        "setup",
        "init",
        "plan",
        "program",
        "check",
        "run",
        "solve",
        "export",
        "verify",
        "report",
        "decode",
    } <= dict(typed).keys()
    for command, rest in typed:
        known = stepdiag(command, "--help")
        assert known.code == 0, command
        assert [
            option for option in re.findall(r"--[a-z-]+", rest) if option not in known.out
        ] == [], command


def test_the_readme_names_every_control() -> None:
    readme = (CHECKOUT / "README.md").read_text(encoding="utf-8").lower()
    rows = readme.partition("| control | tables")[2].partition("\n\n")[0].splitlines()
    missing = [
        name for name in TABLES if name != "neutral" and not any(name in row for row in rows)
    ]
    assert missing == []
    assert {
        name for name in TABLES if any(name in row and "| yes" in row for row in rows)
    } == set(PROGRAMS)


def test_the_readme_begins_with_what_was_met_and_says_it_of_every_row() -> None:
    """No real machine, LinuxCNC in simulation, no rotary axes; an instrument without a word
    promises."""
    readme = (CHECKOUT / "README.md").read_text(encoding="utf-8")
    top = " ".join(readme.partition("\n## ")[0].split())
    assert "No real machine and no real laser" in top
    assert "LinuxCNC" in top
    assert "Rotary axes are not measured" in top
    tables = readme.partition("## Instruments and controls")[2].partition("\n## ")[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in tables.splitlines()
        if line.startswith("| ")
    ]
    heads, rest = (
        [row for row in rows if row[-1] == "tested with"],
        [row for row in rows if row[-1] != "tested with"],
    )
    assert len(heads) == 2
    assert [row[0] for row in rest if not row[-1]] == ["any other"]
    assert [row[0] for row in rest if "real" in row[-1] and "LinuxCNC" not in row[0]] == [
        "uMD0, uMD1, uMD2 interferometer boards",
        "the machine's signals",
    ]


def test_no_page_gives_the_quick_look_a_step_of_its_own() -> None:
    """A step that is not of the survey costs up to a micrometre: the commands that people copy
    leave it to the program."""
    pages = [CHECKOUT / "README.md", *DOCS.rglob("*.md")]
    assert [
        page.name
        for page in pages
        if re.search(
            r"^    .*(--step-mm|step_mm=)", page.read_text(encoding="utf-8"), re.MULTILINE
        )
    ] == []


def test_the_notebook_runs_from_its_first_cell_to_its_last(beside_readings: Path) -> None:
    """Cell by cell, as a kernel does: the value of a last expression is what the notebook shows."""
    names: dict[str, object] = {}
    shown = []
    for cell in json.loads((DOCS / "notebook.ipynb").read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "code":
            continue
        assert not cell["outputs"]
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, "notebook", "exec"), names)
        if isinstance(last, ast.Expr):
            shown.append(eval(compile(ast.Expression(last.value), "notebook", "eval"), names))
    shapes = [
        "Series",
        "Result",
        "DataFrame",
        "Figure",
        "DataFrame",
        "tuple",
        "Figure",
        "int",
    ]
    assert [type(each).__name__ for each in shown] == shapes
    assert shown[-1] == 0
