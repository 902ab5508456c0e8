"""Single files: what is there is never half written nor written over unasked, and what somebody
else leaves there is refused by name."""

import os
from pathlib import Path

import pytest

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.files import as_text, read_bytes, write_atomically, write_new, write_once


def test_a_write_that_fails_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Either the old or the new bytes stand there, and nothing else beside them."""
    path = tmp_path / "report.html"
    write_atomically(path, b"old")
    monkeypatch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        write_atomically(path, b"new")
    assert [(one.name, one.read_bytes()) for one in tmp_path.iterdir()] == [
        ("report.html", b"old")
    ]


def test_the_same_bytes_may_be_written_again_and_no_others(tmp_path: Path) -> None:
    path = tmp_path / "made" / "result.json"
    write_once(path, "one\n")
    write_once(path, "one\n")
    with pytest.raises(
        UsageError,
        match="expected no file, or a file with the same content, found a file with "
        "different content",
    ):
        write_once(path, "two\n")
    assert path.read_bytes() == b"one\n"


def test_a_folder_in_the_way_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="expected no file"):
        write_once(tmp_path, "one\n")


def test_a_new_file_is_never_an_old_one(tmp_path: Path) -> None:
    write_new(tmp_path / "new.toml", "a\n")
    with pytest.raises(
        UsageError,
        match=r"new\.toml: expected a new file, found a file that already exists; choose "
        r"another file name",
    ):
        write_new(tmp_path / "new.toml", "b\n")
    assert (tmp_path / "new.toml").read_bytes() == b"a\n"
    with pytest.raises(
        UsageError,
        match="expected a file that can be written, found No such file or directory",
    ):
        write_new(tmp_path / "none" / "new.toml", "b\n")


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_bytes(b"12345")
    assert read_bytes(path, largest=5) == b"12345"
    with pytest.raises(
        DataError, match=r"profile: expected table\.csv of at most 4 bytes, found more"
    ):
        read_bytes(path, "profile", largest=4)
    with pytest.raises(UsageError, match="of at most 4 bytes"):
        read_bytes(path, largest=4, blame=UsageError)


def test_a_file_that_cannot_be_read_is_the_users_to_name(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError,
        match=r"none\.csv: expected a readable file, found No such file or directory",
    ):
        read_bytes(tmp_path / "none.csv")


def test_bytes_that_are_no_utf_8_are_told_by_their_place() -> None:
    assert as_text("ä".encode(), "a.csv") == "ä"
    with pytest.raises(
        DataError, match=r"a\.csv: expected text in UTF-8, found byte 2, which is not UTF-8"
    ):
        as_text(b"ab\xff", "a.csv")


def test_what_is_synced_is_the_whole_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sync of a file whose bytes still wait in the process would promise what a power cut takes
    away."""
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda handle: synced.append(os.fstat(handle).st_size))
    write_atomically(tmp_path / "table.ini", b"12345")
    assert synced == [5]
