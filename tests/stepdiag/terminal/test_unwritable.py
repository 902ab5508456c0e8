"""Every command where nothing can be written: words and exit code 2, and nothing cut is left."""

import os
import resource
import signal
from pathlib import Path

import pytest

from stepdiag.base.errors import UsageError
from stepdiag.terminal.exits import failed_writing_said
from testkit.hostile.door import Door
from testkit.hostile.doors import NEVER_DONE, doors

REFUSED, OTHERWISE = 2, 70
COMMANDS = {
    " ".join(word for word in door.command[:2] if word.isalpha()): door
    for name, door in doors().items()
    if name not in NEVER_DONE and ("--out" in door.command or door.command[0] in {"accept", "service"})
}
"""One door a command that writes."""


@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_ends_in_words(name: str, tmp_path: Path) -> None:
    """No file may grow by a byte, which every write meets in the same way as a full disk."""
    door = COMMANDS[name]
    door.place(tmp_path)
    before = files_below(tmp_path)
    assert ended(door, tmp_path) == REFUSED
    assert files_below(tmp_path) == before


def ended(door: Door, folder: Path) -> int:
    """Run the command in a copy of this process that can write nothing; return `REFUSED` for words, as the entry gives them."""
    child = os.fork()
    if child == 0:
        code = OTHERWISE
        try:
            code = _without_room(door, folder)
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _without_room(door: Door, folder: Path) -> int:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    try:
        with failed_writing_said():
            told = door.go_through_placed(folder)
    except UsageError as refusal:
        return REFUSED if str(refusal) else OTHERWISE
    return REFUSED if told.code == REFUSED and told.refusal else told.code + 100


def files_below(folder: Path) -> dict[str, int]:
    """Return every file with its size; folders without files do not count."""
    return {str(path.relative_to(folder)): path.stat().st_size for path in sorted(folder.rglob("*")) if path.is_file()}
