"""The newcomer's exercise of CONTRIBUTING, done literally in a copy of the checkout: under 60 lines
each, and every contract holds."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
COPIED = (
    "daq",
    "solver",
    "exporters",
    "stepdiag",
    "tests/daq/formats",
    "tests/data",
    "tests/exporters/tables",
    "tests/lib",
    "tools",
    "docs",
)
FILES = ("pyproject.toml", "tests/conftest.py")
MOST_LINES = 60


@pytest.mark.parametrize("exercise", ["controller", "instrument"])
def test_what_is_added_is_short_and_whole(exercise, tmp_path):
    steps = tomllib.loads((HERE / f"{exercise}.toml").read_text(encoding="utf-8"))
    texts = [addition["text"].strip("\n") for addition in steps["additions"]]
    assert sum(text.count("\n") + 1 for text in texts) < MOST_LINES
    copy = copied(tmp_path / "checkout")
    for addition in steps["additions"]:
        added(copy, addition)
    run(copy, "ruff", "check", "--no-cache", "exporters", "tests/daq/formats", "tests/lib")
    run(copy, "lint-imports", "--no-cache")
    run(copy, "pytest", "-q", "-p", "no:cacheprovider", *steps["runs"])


def copied(target):
    for name in COPIED:
        shutil.copytree(
            CHECKOUT / name,
            target / name,
            symlinks=True,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    for name in FILES:
        shutil.copy(CHECKOUT / name, target / name)
    return target


def added(copy, addition):
    """Write a new file, or put the text behind a line that stands there once, or at the end."""
    path, text = copy / addition["file"], addition["text"].strip("\n") + "\n"
    before = path.read_text(encoding="utf-8") if path.exists() else ""
    after = addition["after"] + "\n" if "after" in addition else ""
    assert not after or before.count("\n" + after) == 1, (
        f"{addition['file']}: {after!r} stands there {before.count(after)} times"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    head, found, tail = (
        before.partition("\n" + after) if after else (before, "\n" if before else "", "")
    )
    path.write_text(head + found + text + tail, encoding="utf-8")


def run(copy, tool, *arguments):
    """The copy comes before the installed wheel on the path."""
    environment = {
        **os.environ,
        "PYTHONPATH": f"{copy}:{copy / 'tests/lib'}",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [Path(sys.executable).with_name(tool), *arguments]
    told = subprocess.run(
        command, cwd=copy, env=environment, capture_output=True, text=True, check=False
    )
    assert told.returncode == 0, told.stdout + told.stderr
