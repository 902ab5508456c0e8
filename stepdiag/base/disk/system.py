"""Differences between operating systems: locks, folders on the disk, priority of a process.

Recording requires Linux. Commands that only read and write files run on every system with Python.
Each function of this module describes its behaviour on a system without the feature.
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
"""Flags for opening a new file whose bytes are written unchanged. Without O_BINARY, Windows inserts
a carriage return before each line feed."""
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0)
FOLDERS_OPEN = hasattr(os, "O_DIRECTORY")
"""Whether this operating system can open a folder in order to lock it or to sync its names to the
disk."""


def sync_file(descriptor: int) -> None:
    getattr(os, "fdatasync", os.fsync)(descriptor)


def sync_folder(folder: Path) -> None:
    """Sync the names in a folder to the disk. Raises OSError. The function does nothing on Windows,
    which opens no folders."""
    if FOLDERS_OPEN:
        handle = os.open(folder, _FOLDER)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def lock(descriptor: int, *, shared: bool = False) -> None:
    """Lock an open file or folder for this process. Raises BlockingIOError if another process has
    the lock, OSError if the file system or the operating system has no such locks."""
    if fcntl is None:
        raise OSError(errno.ENOTSUP, os.strerror(errno.ENOTSUP))
    fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)


def open_folder(folder: Path) -> int:
    """Return a descriptor of a folder. Raises OSError for a link to a folder, and on Windows for
    every folder."""
    return os.open(folder, _FOLDER | getattr(os, "O_NOFOLLOW", 0))


def nice(steps: int) -> None:
    """Lower the priority of this process. If a sandbox or the operating system refuses, the
    priority stays unchanged."""
    with suppress(OSError, AttributeError):
        os.nice(steps)
