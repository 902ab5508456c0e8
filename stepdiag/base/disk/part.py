"""Hidden folders for writing. A file is completed in a hidden folder beside its target and then
renamed to the target.

The hidden folder is locked while its writer runs. If a writer dies, the next writer of the same
target removes the abandoned folder.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from stepdiag.base.disk.system import FOLDERS_OPEN, lock, open_folder

SUFFIX = ".part"


@contextmanager
def part_of(target: Path) -> Iterator[Path]:
    """Yield a new hidden folder beside ``target``; the folder and its contents are removed at the
    end. Raises OSError."""
    for left in _of_target(target):
        _remove_abandoned(left)
    part, handle = _held_folder(target)
    try:
        yield part
    finally:
        shutil.rmtree(part, ignore_errors=True)
        if handle is not None:
            os.close(handle)


@contextmanager
def folder_made(folder: Path) -> Iterator[None]:
    """Make a folder and its parents. If the enclosed work fails, the new folders are removed.
    Raises OSError."""
    with undone_on_failure() as undo:
        for missing in reversed(
            [each for each in (folder, *folder.parents) if not each.exists()]
        ):
            undo.callback(_remove_empty, missing)
        folder.mkdir(parents=True, exist_ok=True)
        yield


@contextmanager
def undone_on_failure() -> Iterator[ExitStack]:
    """Yield a list of undo steps, which are executed if the enclosed work fails."""
    with ExitStack() as undo:
        yield undo
        undo.pop_all()


def write_through(path: Path, data: bytes) -> None:
    """Write a new file, readable by every account, and sync it to the disk. Raises OSError."""
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    with suppress(PermissionError):  # a network share may not support modes
        path.chmod(0o644)


def publish_new(written: Path, target: Path) -> None:
    """Rename a written file to a free name. Raises FileExistsError for an existing file, OSError
    for an error of the disk."""
    try:
        target.hardlink_to(written)
    except FileExistsError:
        raise
    except OSError:  # for a file system without links: the name is reserved first
        target.open("x").close()
        written.replace(target)


def _of_target(target: Path) -> list[Path]:
    name = re.compile(re.escape(f".{target.name}.") + "[a-z0-9_]{8}" + re.escape(SUFFIX))
    with suppress(OSError), os.scandir(target.parent) as entries:
        return [
            Path(entry.path)
            for entry in entries
            if name.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False)
        ]
    return []


def _remove_abandoned(part: Path) -> None:
    with suppress(OSError):
        handle = open_folder(part)
        try:
            lock(handle)
            shutil.rmtree(part, ignore_errors=True)
        finally:
            os.close(handle)


def _held_folder(target: Path) -> tuple[Path, int | None]:
    while True:
        part = Path(
            tempfile.mkdtemp(prefix=f".{target.name}.", suffix=SUFFIX, dir=target.parent)
        )
        if not FOLDERS_OPEN:
            return part, None
        with suppress(FileNotFoundError):
            handle = open_folder(part)
            if _locked(handle) and part.exists():
                return part, handle
            os.close(handle)


def _locked(handle: int) -> bool:
    """Lock a folder; return False if another process has the lock. Return True on a file system
    without locks, because no process removes a hidden folder on this file system."""
    try:
        lock(handle)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()
