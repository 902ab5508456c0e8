"""What the shell offers: commands, options and the names of the controls, which the help lists
too."""

import os
import subprocess
import sys

import pytest

from stepdiag.cli import completion
from stepdiag.exporters.profiles.registry import CONTROLLERS
from stepdiag.exporters.programs import CONTROLS
from stepdiag.texts import LANGUAGES
from testkit.cli import stepdiag

BEGIN = "import sys; sys.argv[0] = 'stepdiag'; from stepdiag.__main__ import main; main()"


def offered(words):
    """Return what bash would offer for the last of these words."""
    environment = os.environ | {
        "_STEPDIAG_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(words.count(" ")),
    }
    done = subprocess.run(
        [sys.executable, "-c", BEGIN],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=environment,
    )
    return done.stdout.split()


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("stepdiag exp", ["export"]),
        ("stepdiag export result.json --controller fa", ["fanuc", "fagor"]),
        ("stepdiag program survey.toml --controller h", ["heidenhain"]),
    ],
)
def test_tab_offers_what_may_follow(words, wanted):
    assert offered(words) == wanted


def test_the_names_are_those_of_the_programs():
    """They stand apart from the modules so that Tab imports none of them."""
    assert set(completion.TABLES) == set(CONTROLLERS)
    assert set(completion.PROGRAMS) == set(CONTROLS)
    assert set(completion.LANGUAGES) == set(LANGUAGES)


@pytest.mark.parametrize("name", [*completion.TABLES, *completion.FIELDS])
def test_the_help_lists_every_control(name):
    assert name in stepdiag("export", "--help").out
