"""Folders with files and their SHA-256: a set of files is written completely or not at all, and
read completely or refused.

A control with half of an export is worse than a control without an export. So a set is written into
a hidden folder beside the target folder (restore files first), synced to the disk, and renamed
once. ``SHA256SUMS`` lists the members of the set.
"""

import hashlib
import io
import re
import zipfile
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

from stepdiag.base.disk.part import folder_made, part_of, write_through
from stepdiag.base.disk.system import sync_folder
from stepdiag.base.errors import DataError, SafetyError, UsageError, system_words
from stepdiag.base.files import (
    LARGEST_SETTINGS_BYTES,
    as_text,
    holds,
    read_bytes,
    refuse_file_name,
)
from stepdiag.base.messages import Words, message
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import is_restore

SUMS = "SHA256SUMS"
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of every member of a zip. The date is constant, so that equal files give equal bytes."""
_LINE = re.compile(r"(?P<digest>[0-9a-f]{64})  (?P<name>[^/\\\x00-\x1f]{1,200})")


def write_set(folder: Path, files: Sequence[ControlFile]) -> tuple[str, ...]:
    """Write ``files`` and the list of their SHA-256 into a new or empty folder, and return all
    names. If the folder already contains an equal set, nothing is written.

    After a loss of power the folder contains all files or none. Of two simultaneous writers only
    one succeeds. Raises ``UsageError`` if the folder contains other files or cannot be written, or
    if two files have the same name.
    """
    everything = (*files, sums_of(files))
    refuse_file_name(folder)
    _refuse_doubled(folder, everything)
    try:
        target = folder.resolve()
        if not _stands_there(target, everything):
            _rename_into_place(target, everything)
    except OSError as error:
        raise UsageError(
            str(folder), expected=message("folder-writable"), found=system_words(error)
        ) from error
    return tuple(file.name for file in everything)


def sums_of(files: Sequence[ControlFile]) -> ControlFile:
    lines = "".join(
        f"{hashlib.sha256(file.data).hexdigest()}  {file.name}\n" for file in files
    )
    return ControlFile(name=SUMS, data=lines.encode("utf-8"), role="note")


def read_set(folder: Path) -> tuple[ControlFile, ...]:
    """Return the files of a set, ``SHA256SUMS`` last.

    Raises ``SafetyError`` (``set-altered``) unless the folder contains exactly the files of its
    list, with the bytes that were written, and ``DataError`` without a list. Hidden files of an
    interrupted write are ignored.
    """
    wanted = listed(folder)
    present = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    missing = [name for name in wanted if name not in present]
    if missing:
        raise _refusal(
            folder,
            "set-altered.missing",
            message("every-file-sha256sums-names"),
            "no " + ", ".join(missing),
        )
    foreign = [name for name in present if name not in wanted and name != SUMS]
    if foreign:
        raise _refusal(
            folder,
            "set-altered.foreign",
            message("files-sha256sums-names-no"),
            ", ".join(foreign),
        )
    files = tuple(
        ControlFile(name=name, data=read_bytes(folder / name)) for name in [*wanted, SUMS]
    )
    _refuse_altered(folder, wanted, files)
    return files


def read_given(paths: Iterable[Path]) -> tuple[ControlFile, ...]:
    """Return the files at the given paths. The path of a folder, or of its ``SHA256SUMS``, gives
    all files of the set (`read_set`).

    A single file of a set must be unchanged (``SafetyError``, code ``set-altered``).
    """
    read: list[ControlFile] = []
    for path in paths:
        if path.is_dir():
            read += read_set(path)
            continue
        file = ControlFile(name=path.name, data=read_bytes(path))
        if path.name == SUMS:
            read_set(path.parent)
        elif (path.parent / SUMS).is_file():
            _refuse_altered(path.parent, listed(path.parent), (file,))
        read.append(file)
    return tuple(read)


def zip_of(folder: Path, *, restore: bool) -> bytes:
    """Return the files of a set as a zip: with ``restore`` the restore files, otherwise all other
    files. ``SHA256SUMS`` in the zip lists the contents of the zip.

    The packed bytes are the bytes that were compared with the list, so a set that is altered during
    the download is refused with the ``SafetyError`` of `read_set`.
    """
    files = [
        file
        for file in read_set(folder)
        if file.name != SUMS and is_restore(file.name) == restore
    ]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in (*sorted(files, key=lambda file: file.name), sums_of(files)):
            archive.writestr(
                zipfile.ZipInfo(file.name, EPOCH), file.data, zipfile.ZIP_DEFLATED
            )
    return packed.getvalue()


def listed(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each file by name, from the folder's list. Raises DataError without a
    list, SafetyError for a list in another format.
    """
    path = folder / SUMS
    if not path.is_file():
        expected = message("set-folder", name=SUMS)
        raise DataError(
            str(folder),
            expected=expected,
            found=message("no-such-file", name=SUMS),
            remedy=message("one-by-one"),
        )
    lines = as_text(read_bytes(path, largest=LARGEST_SETTINGS_BYTES), str(path)).splitlines()
    matches = [_LINE.fullmatch(line) for line in lines]
    wanted = {match["name"]: match["digest"] for match in matches if match is not None}
    if not wanted or len(wanted) != len(lines):
        raise _refusal(
            folder,
            "set-altered",
            message("export-writes", sums=SUMS),
            message("another-text"),
        )
    return wanted


def whole(folder: Path) -> bool:
    """Return whether a folder contains a complete and unaltered set."""
    try:
        read_set(folder)
    except (SafetyError, DataError, UsageError, OSError):
        return False
    return True


def _refuse_altered(
    folder: Path, wanted: dict[str, str], files: Collection[ControlFile]
) -> None:
    altered = [
        file.name
        for file in files
        if file.name in wanted and hashlib.sha256(file.data).hexdigest() != wanted[file.name]
    ]
    if altered:
        raise _refusal(
            folder,
            "set-altered",
            message("bytes-export-wrote"),
            message("others-in-files", names=list(altered)),
        )


def _refusal(folder: Path, code: str, expected: Words, found: Words) -> SafetyError:
    remedy = message("export-again")
    return SafetyError(str(folder), code=code, expected=expected, found=found, remedy=remedy)


def _refuse_doubled(folder: Path, files: Sequence[ControlFile]) -> None:
    names = [file.name.lower() for file in files]
    doubled = [file.name for file in files if names.count(file.name.lower()) > 1]
    if doubled:
        raise UsageError(
            str(folder / doubled[0]),
            expected=message("each-name"),
            found=message("two-of-them"),
            remedy=message("rename-files"),
        )


def _stands_there(target: Path, files: Sequence[ControlFile]) -> bool:
    if not target.exists() or (target.is_dir() and not any(target.iterdir())):
        return False
    if target.is_dir() and all(holds(target / file.name, file.data) for file in files):
        return True
    raise UsageError(
        str(target),
        expected=message("empty-folder"),
        found=message("other-files") if target.is_dir() else message("a-file"),
        remedy=message("other-out"),
    )


def _rename_into_place(target: Path, files: Sequence[ControlFile]) -> None:
    with folder_made(target.parent), part_of(target) as part:
        for file in _restore_first(files):
            write_through(part / file.name, file.data)
        part.chmod(0o755)
        sync_folder(part)
        try:
            part.rename(target)
        except OSError:
            # The set of a faster export is not replaced; an equal set counts as success.
            if not _stands_there(target, files):
                raise
        sync_folder(target.parent)


def _restore_first(files: Sequence[ControlFile]) -> Iterator[ControlFile]:
    yield from (file for file in files if is_restore(file.name))
    yield from (file for file in files if not is_restore(file.name))
