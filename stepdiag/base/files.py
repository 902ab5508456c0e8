"""Reading of files up to a size limit, and writing of files or groups of files completely or not at
all.

Existing files are kept unless the caller requests replacement. Text files are UTF-8 with LF.
"""

import hashlib
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path

from stepdiag.base.disk.part import (
    folder_made,
    part_of,
    publish_new,
    undone_on_failure,
    write_through,
)
from stepdiag.base.errors import DataError, UsageError, system_words
from stepdiag.base.messages import Words, message

LARGEST_BYTES = 64_000_000
"""Size in bytes of the largest file that is read at once. Every file of a survey is smaller, and a
parser can need twenty times as much memory."""
LARGEST_SETTINGS_BYTES = 1_000_000
"""Size in bytes of the largest settings file that a person writes, for example a survey file or a
profile."""
LARGEST_TABLE_BYTES = 4_000_000
"""Size in bytes of the largest table of a machine that a profile names, and of the largest file
stored in a log."""
HASH_SUFFIX = ".sha256"
FILE_SUFFIXES = (
    ".csv",
    ".docx",
    ".htm",
    ".html",
    ".ini",
    ".json",
    ".mcap",
    ".mpf",
    ".parquet",
    ".pdf",
    ".png",
    ".rtl",
    ".svg",
    ".toml",
    ".txt",
    ".xlsx",
    ".xml",
    ".zip",
)
"""Endings of file names. A path with one of these endings is not used as a folder."""


def read_bytes(
    path: Path,
    where: str = "",
    *,
    largest: int = LARGEST_BYTES,
    expected: Words = message("readable-file"),  # noqa: B008
    remedy: Words = "",
    blame: type[UsageError | DataError] = DataError,
) -> bytes:
    """Return the bytes of a file. ``where`` is the field of the settings file that names this file.
    In this case a terminal or a pipe is refused.

    Raises UsageError for an unreadable file. Raises an error of the type ``blame`` for a file of
    more than ``largest`` bytes.
    """
    if where and path.exists() and not path.is_file():
        raise UsageError(
            where,
            expected=expected,
            found=message("which-none", name=path.name),
            remedy=remedy,
        )
    try:
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except OSError as error:
        raise UsageError(
            where or str(path), expected=expected, found=system_words(error), remedy=remedy
        ) from error
    except ValueError as error:  # a NUL in the name
        raise UsageError(
            where or repr(str(path)), expected=expected, found=str(error), remedy=remedy
        ) from error
    if len(data) > largest:
        raise blame(
            where or str(path),
            expected=message("file-of-at-most", name=path.name, most=largest),
            found=message("found-more"),
        )
    return data


def as_text(data: bytes, where: str, blame: type[UsageError | DataError] = DataError) -> str:
    """Return bytes as text. Raises the error type ``blame`` for bytes that are not UTF-8."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise blame(
            where,
            expected=message("text-in-utf-8"),
            found=message("byte-is-not", number=error.start),
        ) from error


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file. If a hash file exists beside the file, the bytes are
    compared with the hash: a disk error can change a digit.

    Raises UsageError for an unreadable file. Raises DataError for a file that is too large, not
    UTF-8, or different from its hash.
    """
    data, beside = read_bytes(path), _hash_beside(path)
    if beside.is_file():
        require_hash(
            data, read_bytes(beside, largest=LARGEST_SETTINGS_BYTES), str(path), beside.name
        )
    # spreadsheets begin a CSV with a byte order mark
    return as_text(data, str(path)).removeprefix("\ufeff")


def require_hash(data: bytes, line: bytes, where: str, beside: str) -> None:
    """Raise DataError if the SHA-256 of the bytes differs from the SHA-256 in ``line``, a line of
    sha256sum from the file ``beside``."""
    found = hashlib.sha256(data).hexdigest()
    # the file name after the hash is not compared, because both files may have been renamed
    if line[:66] != f"{found}  ".encode("ascii") or not line.endswith(b"\n"):
        expected = f"SHA-256 {as_text(line[:64], beside)}"
        raise DataError(
            where,
            expected=expected,
            found=found,
            remedy=message("make-it-again", name=beside),
        )


def write_together(files: Mapping[Path, bytes], *, over: bool) -> None:
    """Write all of these files or none of them; missing folders are made.

    With ``over``, older files are replaced, and restored if a new file cannot be written. Otherwise
    an existing file with the same bytes stays, and an existing file with other bytes is refused
    (UsageError) before the first write. Raises OSError for an error of the disk.
    """
    wanted = {
        path: data for path, data in files.items() if over or not _stands_there(path, data)
    }
    with ExitStack() as folders, ExitStack() as parts, undone_on_failure() as undo:
        written = {}
        for path, data in wanted.items():
            folders.enter_context(folder_made(path.parent))
            written[path] = parts.enter_context(part_of(path)) / path.name
            write_through(written[path], data)
        for path, part in written.items():
            _publish(part, path, wanted[path], undo, over=over)


def write_atomically(path: Path, data: bytes) -> None:
    """Write or replace a file; its folder is made. A reader gets either the complete old file or
    the complete new file."""
    write_together({path: data}, over=True)


def holds(path: Path, data: bytes) -> bool:
    return path.is_file() and path.stat().st_size == len(data) and path.read_bytes() == data


def write_once(path: Path, text: str) -> None:
    """Write a text file completely or not at all; its folder is made. Raises UsageError if the file
    exists with other bytes."""
    write_together({path: text.encode("utf-8")}, over=False)


def hashed(files: Mapping[Path, str]) -> dict[Path, bytes]:
    """Return text files, each with its SHA-256 file ``NAME.sha256`` (for ``sha256sum --check``)."""
    found = {}
    for path, text in files.items():
        found[path] = text.encode("utf-8")
        found[_hash_beside(path)] = (
            f"{hashlib.sha256(found[path]).hexdigest()}  {path.name}\n".encode()
        )
    return found


def write_hashed(path: Path, text: str) -> None:
    """Write a text file and its hash file, both or neither. Raises UsageError if one of them exists
    with other bytes."""
    write_together(hashed({path: text}), over=False)


def _hash_beside(path: Path) -> Path:
    return path.with_name(path.name + HASH_SUFFIX)


def refuse_existing(path: Path) -> None:
    """Raise UsageError for an existing file. Commands call this function before they ask
    questions."""
    if path.exists():
        raise UsageError(
            str(path),
            expected=message("new-file"),
            found=message("one-exists"),
            remedy=message("name-another-one"),
        )


def write_new(path: Path, text: str) -> None:
    """Write a new text file completely or not at all. Raises UsageError if the file exists or
    cannot be written."""
    refuse_existing(path)
    try:
        path.parent.stat()  # a missing folder means a wrong name
        write_once(path, text)
    except OSError as error:
        raise UsageError(
            str(path), expected=message("file-can-be-written"), found=system_words(error)
        ) from error


def refuse_file_name(out: Path, expected: str = "a folder") -> None:
    """Raise UsageError if the name for a new folder has the ending of a file, such as
    ``report.pdf``."""
    if out.suffix.lower() in FILE_SUFFIXES and not out.is_dir():
        raise UsageError(
            str(out),
            expected=expected,
            found=message("name-file", suffix=out.suffix),
            remedy=message("name-folder-without-ending"),
        )


def _stands_there(path: Path, data: bytes) -> bool:
    if holds(path, data):
        return True
    if path.exists():
        remedy = message("write-into-another-folder")
        raise UsageError(
            str(path),
            expected=message("no-file-same-bytes"),
            found=message("file-with-other-bytes"),
            remedy=remedy,
        )
    return False


def _publish(part: Path, path: Path, data: bytes, undo: ExitStack, *, over: bool) -> None:
    if not over:
        try:
            publish_new(part, path)
        except FileExistsError:  # another writer was faster
            _stands_there(path, data)
            return
        undo.callback(path.unlink, missing_ok=True)
        return
    before = part.with_name("before")
    if path.is_file():
        with suppress(OSError):  # on a file system without links this step cannot be undone
            before.hardlink_to(path)
    part.replace(path)
    undo.callback(_back, before, path)


def _back(before: Path, path: Path) -> None:
    if before.exists():
        before.replace(path)
    else:
        path.unlink(missing_ok=True)
