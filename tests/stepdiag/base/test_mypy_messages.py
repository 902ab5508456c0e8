"""The types of a message's arguments are checked where it is made, before anything runs."""

from pathlib import Path

from mypy import api

ROOT = Path(__file__).parents[3]
CALLS = """
from stepdiag.base.messages import message

def made(words: str, size_um: float, stop: int) -> None:
    message("at-stop-of", setup=words, way=message("way-out"), stop=stop, last=30, what=words)
    message("at-stops", setup=words, way=words, stops=[1, 2], what=words)
    message("no-such-key")
    message("way-out", size_um=size_um)
    message("at-stop-of", setup=words, way=words, stop=size_um, last=30, what=words)
    message("at-stop-of", setup=words, way=words, stop=stop, last=30, what=size_um)
    message(words)
"""

READS = """
from stepdiag.base.findings import Finding, in_words
from stepdiag.daq.records.status import FindingStatus

def shown(found: Finding, status: FindingStatus) -> str:
    if "again" in found.text:
        return status.text
    return in_words(found, "de") + str(found.words) + found.key
"""


def test_a_text_that_decides_or_is_shown_is_refused_by_the_type_checker(
    tmp_path: Path,
) -> None:
    """The text of a finding is for logs, results and programs outside; code, key, arguments and
    `in_words` are for everything else."""
    assert refused_lines(tmp_path, READS) == [6, 7]


def refused_lines(folder: Path, source: str) -> list[int]:
    """Return the lines that the type checker refuses."""
    file = folder / "calls.py"
    file.write_text(source)
    out, _, _ = api.run(
        [
            "--config-file",
            str(ROOT / "pyproject.toml"),
            "--cache-dir",
            str(folder / "cache"),
            str(file),
        ]
    )
    return [int(line.split(":")[1]) for line in out.splitlines() if "error:" in line]


def test_wrong_arguments_are_refused_by_the_type_checker(tmp_path: Path) -> None:
    """A key that does not exist, names, types, and a key that is not written out; what is right
    passes."""
    assert refused_lines(tmp_path, CALLS) == [7, 8, 9, 10, 11]
