"""Every command where nothing can be written: words and exit code 2, and nothing cut is left."""

import errno
import mmap
import os
import resource
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from stepdiag.base.errors import UsageError
from stepdiag.base.readings.readings import render_readings
from stepdiag.terminal.exits import failed_writing_shown
from testkit.exact.surveys import Bench
from testkit.hostile.door import Door
from testkit.hostile.doors import NEVER_DONE, doors

REFUSED, OTHERWISE = 2, 70
COMMANDS = {
    " ".join(word for word in door.command[:2] if word.isalpha()): door
    for name, door in doors().items()
    if name not in NEVER_DONE
    and ("--out" in door.command or door.command[0] in {"accept", "service"})
}
"""One door a command that writes."""
READINGS = render_readings(Bench(increments=2).survey())
SEVERAL = COMMANDS | {
    "report, a folder": replace(
        COMMANDS["report"], command=("report", "r.json", "--out", "sheets")
    ),
    "rtl, three runs": replace(COMMANDS["rtl"], files={"r.csv": READINGS}),
}
"""Commands that write more than one file, beside the others."""
GOES_ON = {"replay", "service install"}
"""Write file by file, as the daemon does, and go on where they stopped."""


@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_ends_in_words(name: str, tmp_path: Path) -> None:
    """No file may grow by a byte, which every write meets in the same way as a full disk."""
    door = COMMANDS[name]
    door.place(tmp_path)
    before = files_below(tmp_path)
    assert ended(door, tmp_path) == REFUSED
    assert files_below(tmp_path) == before


@pytest.mark.parametrize("name", SEVERAL)
def test_a_disk_that_is_full_at_the_last_file_leaves_all_files_or_none(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last sync of a command fails: what it wrote before is not left alone."""
    door, synced = SEVERAL[name], mmap.mmap(-1, 2)
    usual = os.fsync

    def fsync(handle: int) -> None:
        synced[0] += 1
        if synced[0] == synced[1]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        usual(handle)

    monkeypatch.setattr("os.fsync", fsync)
    found = []
    for folder in ("roomy", "full"):
        door.place(tmp_path / folder)
        before = files_below(tmp_path / folder)
        synced[1], synced[0] = synced[0], 0
        assert ended(door, tmp_path / folder, resource.RLIM_INFINITY) == (
            REFUSED if synced[1] else 100
        )
        found.append(files_below(tmp_path / folder))
    assert len(found[0]) > len(before) or name == "accept"
    if name in GOES_ON:
        ended(door, tmp_path / "full", resource.RLIM_INFINITY)
        found[1] = files_below(tmp_path / "full")
    assert found[1] in ([found[0]] if name in GOES_ON else [before, found[0]])


def ended(door: Door, folder: Path, largest: int = 0) -> int:
    """Run the command in a copy of this process whose files grow no larger; return `REFUSED` for
    words, as the entry gives them."""
    child = os.fork()
    if child == 0:
        code = OTHERWISE
        try:
            code = _without_room(door, folder, largest)
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _without_room(door: Door, folder: Path, largest: int) -> int:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))
    try:
        with failed_writing_shown():
            told = door.go_through_placed(folder)
    except UsageError as refusal:
        return REFUSED if str(refusal) else OTHERWISE
    return REFUSED if told.code == REFUSED and told.refusal else told.code + 100


def files_below(folder: Path) -> dict[str, int]:
    """Return every file with its size; folders without files do not count."""
    return {
        str(path.relative_to(folder)): path.stat().st_size
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
