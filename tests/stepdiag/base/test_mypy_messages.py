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


def test_wrong_arguments_are_refused_by_the_type_checker(tmp_path: Path) -> None:
    """A key that does not exist, names, types, and a key that is not written out; what is right passes."""
    file = tmp_path / "calls.py"
    file.write_text(CALLS)
    out, _, _ = api.run(["--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(tmp_path / "cache"), str(file)])
    refused = [int(line.split(":")[1]) for line in out.splitlines() if "error:" in line]
    assert refused == [7, 8, 9, 10, 11], out
