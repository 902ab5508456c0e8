"""Hidden folders beside the targets: a file is completed there before it gets its name, and an
interrupted writer leaves no remains that accumulate.

Every writer that replaces or creates a file goes through `part_of`: its hidden folder stands beside
the target, is locked while its writer lives, and is removed by the next writer of the same target
after its own writer's death.
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
    """Yield a new hidden folder beside ``target`` for writing; at the end it is removed with all
    its contents. Raises OSError.
    """
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
    """Make a folder with its parents for the enclosed work; after a failure, the folders made are
    removed. Raises OSError.
    """
    with undone_on_failure() as undo:
        for missing in reversed(
            [each for each in (folder, *folder.parents) if not each.exists()]
        ):
            undo.callback(_remove_empty, missing)
        folder.mkdir(parents=True, exist_ok=True)
        yield


@contextmanager
def undone_on_failure() -> Iterator[ExitStack]:
    """Yield a list to which the enclosed work adds undo steps; they are executed if the work
    fails.
    """
    with ExitStack() as undo:
        yield undo
        undo.pop_all()


def write_through(path: Path, data: bytes) -> None:
    """Write a new file, readable by everybody, and sync it to the disk. Raises OSError."""
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    with suppress(PermissionError):  # a network share may not support modes
        path.chmod(0o644)


def publish_new(written: Path, target: Path) -> None:
    """Rename a written file to a free name. Raises FileExistsError where the name is taken, OSError
    for an error of the disk.
    """
    try:
        target.hardlink_to(written)
    except FileExistsError:
        raise
    except OSError:  # for a file system without links: the name is reserved first
        target.open("x").close()
        written.replace(target)


def _of_target(target: Path) -> list[Path]:
    """Return the hidden folders beside a target, of all its writers."""
    name = re.compile(re.escape(f".{target.name}.") + "[a-z0-9_]{8}" + re.escape(SUFFIX))
    with suppress(OSError), os.scandir(target.parent) as entries:
        return [
            Path(entry.path)
            for entry in entries
            if name.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False)
        ]
    return []


def _remove_abandoned(part: Path) -> None:
    """Remove a hidden folder that is not locked; without locks in the file system, or if another
    process removes the folder, nothing is done.
    """
    with suppress(OSError):
        handle = open_folder(part)
        try:
            lock(handle)
            shutil.rmtree(part, ignore_errors=True)
        finally:
            os.close(handle)


def _held_folder(target: Path) -> tuple[Path, int | None]:
    """Return a new hidden folder and the handle that keeps it locked; if another writer has
    meanwhile removed the folder as abandoned, the folder is made again.
    """
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
    """Lock a folder; return whether this writer has the lock. On a file system without locks, no
    hidden folder is ever removed.
    """
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
