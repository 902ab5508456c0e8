"""The differences between operating systems, in one place: locks, folders on the disk, a process's
priority.

Recording needs Linux. Commands that only work on files run wherever Python does: the functions of
this module leave out a feature that a system lacks, and each states what this costs.
"""

import errno
import os
import sys
from contextlib import suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

LINUX = sys.platform == "linux"
NEW_FILE = (
    os.O_WRONLY
    | os.O_CREAT
    | os.O_EXCL
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_BINARY", 0)
)
"""Flags for opening a new file whose bytes are written unchanged: without O_BINARY, Windows inserts
a carriage return before each line feed.
"""
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0)
FOLDERS_OPEN = hasattr(os, "O_DIRECTORY")
"""Whether this operating system can open folders: to lock them, and to sync the names in them to
the disk.
"""


def sync_file(descriptor: int) -> None:
    """Sync the bytes of a file to the disk. Raises OSError."""
    getattr(os, "fdatasync", os.fsync)(descriptor)


def sync_folder(folder: Path) -> None:
    """Sync the names in a folder to the disk. Raises OSError. Windows opens no folder: there the
    file system's journal must suffice.
    """
    if FOLDERS_OPEN:
        handle = os.open(folder, _FOLDER)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def lock(descriptor: int, *, shared: bool = False) -> None:
    """Lock an open file or folder for this process.

    Raises BlockingIOError where another process holds the lock, OSError where the file system or
    the operating system has no such locks.
    """
    if fcntl is None:
        raise OSError(errno.ENOTSUP, os.strerror(errno.ENOTSUP))
    fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)


def open_folder(folder: Path) -> int:
    """Return a descriptor of a folder; a link to a folder is refused. Raises OSError; on Windows
    for every folder.
    """
    return os.open(folder, _FOLDER | getattr(os, "O_NOFOLLOW", 0))


def nice(steps: int) -> None:
    """Lower the priority of this process; if a sandbox or the operating system refuses this, the
    priority stays unchanged.
    """
    with suppress(OSError, AttributeError):
        os.nice(steps)
