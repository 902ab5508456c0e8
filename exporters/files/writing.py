"""Files into a folder: all or none where it can be known beforehand, each one atomically, nothing overwritten with other bytes."""

from collections.abc import Sequence
from pathlib import Path

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.files import holds, write_atomically
from stepdiag.solver.errors import UsageError


def write_all(folder: Path, files: Sequence[ControlFile]) -> None:
    """Write ``files`` into ``folder``, which is made if need be.

    A file that already holds the same bytes stays. Raises ``UsageError`` before anything is written where one holds others, or two
    files have one name.
    """
    names = [file.name.lower() for file in files]
    for file in files:
        target = folder / file.name
        if names.count(file.name.lower()) > 1:
            raise UsageError(str(target), expected="one file of each name", found="two", remedy="rename the files in machine.existing")
        if target.exists() and not holds(target, file.data):
            raise UsageError(str(target), expected="an empty folder, or the same export again", found="another file of this name",
                             remedy="choose another --out folder: nothing is overwritten")  # fmt: skip
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file in files:
            if not (folder / file.name).exists():
                write_atomically(folder / file.name, file.data)
    except OSError as error:
        raise UsageError(str(folder), expected="a folder that can be written", found=error.strerror or str(error)) from error
