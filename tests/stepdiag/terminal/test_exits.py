"""What the system refuses ends a command in words and with exit code 2, whatever the command."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from testkit.cli import joined

STEPDIAG = (sys.executable, "-m", "stepdiag")


def run(
    *arguments: object, out: object = subprocess.PIPE, **environment: str
) -> subprocess.CompletedProcess[bytes]:
    """Run the program."""
    command = [*STEPDIAG, *map(str, arguments)]
    return subprocess.run(
        command,
        stdout=out,
        stderr=subprocess.PIPE,
        env={**os.environ, **environment},
        timeout=120,
        check=False,
    )  # type: ignore[call-overload,no-any-return]


def assert_refused(done: subprocess.CompletedProcess[bytes], words: str) -> None:
    assert (done.returncode, b"Traceback" in done.stderr) == (2, False), done.stderr
    assert words in joined(done.stderr.decode())


@pytest.mark.parametrize("arguments", [("--help",), ("init", "a.toml"), ("plan", "--help")])
def test_a_full_disk_behind_the_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    with Path("/dev/full").open("wb") as full:
        assert_refused(run(*arguments, out=full), "No space left on device")


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    """/proc takes no files, not even from root."""
    readings = tmp_path / "r.csv"
    readings.write_text(
        "setup,pass,stop,x_mm,y_mm,z_mm,reading_mm\n" + "ppp,1,0,0,0,0,0\n", encoding="utf-8"
    )
    assert_refused(run("init", "/proc/survey.toml"), "/proc/survey.toml")
    assert_refused(run("demo", "--out", "/proc/demo"), "/proc/demo")


def test_who_reads_no_further_is_no_error(tmp_path: Path) -> None:
    """``stepdiag ... | head`` ends quietly."""
    read, write = os.pipe()
    os.close(read)
    done = run("--help", out=write)
    os.close(write)
    assert b"Traceback" not in done.stderr
    assert done.returncode in (0, 1)


def test_nothing_cut_is_left_where_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A survey file is there whole or not at all."""
    from stepdiag.base import files
    from stepdiag.base.disk import part
    from stepdiag.base.errors import UsageError

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(part.os, "fsync", full)
    with pytest.raises(UsageError, match="No space left"):
        files.write_new(tmp_path / "survey.toml", "x" * 100)
    assert list(tmp_path.iterdir()) == []
