"""Single files: read up to a limit, written whole or not at all, and what is there kept unless the caller says otherwise.

Text is UTF-8 with LF wherever it is written.
"""

import os
import tempfile
from pathlib import Path

from stepdiag.base.errors import DataError, UsageError

LARGEST_BYTES = 64_000_000
"""The largest file that is read into memory at once: more is none that a survey leaves, and a parser may need twenty times as much."""
LARGEST_SETTINGS_BYTES = 1_000_000
"""The largest file of settings that a person writes: a survey, a profile, a calibration."""
LARGEST_TABLE_BYTES = 4_000_000
"""The largest file of a machine that a profile names, and the largest that goes into a log."""


def read_bytes(
    path: Path,
    where: str = "",
    *,
    largest: int = LARGEST_BYTES,
    expected: str = "a readable file",
    remedy: str = "",
    blame: type[UsageError | DataError] = DataError,
) -> bytes:
    """Return the bytes of a file; ``where`` is the field that names it, if one does: it is then to be a file and no terminal or pipe.

    Raises UsageError where it cannot be read, ``blame`` where it holds more than ``largest`` bytes.
    """
    if where and path.exists() and not path.is_file():
        raise UsageError(where, expected=expected, found=f"{path.name}, which is none", remedy=remedy)
    try:
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except OSError as error:
        raise UsageError(where or str(path), expected=expected, found=error.strerror or str(error), remedy=remedy) from error
    except ValueError as error:  # a NUL in the name
        raise UsageError(where or repr(str(path)), expected=expected, found=str(error), remedy=remedy) from error
    if len(data) > largest:
        raise blame(where or str(path), expected=f"{path.name} of at most {largest} bytes", found="more")
    return data


def as_text(data: bytes, where: str, blame: type[UsageError | DataError] = DataError) -> str:
    """Return bytes as text. Raises ``blame`` where they are not UTF-8."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise blame(where, expected="text in UTF-8", found=f"byte {error.start} is not") from error


def read_text(path: Path) -> str:
    """Return a text file in UTF-8. Raises UsageError where it cannot be read, DataError where it is too large or not UTF-8."""
    # spreadsheets begin a CSV with a byte order mark
    return as_text(read_bytes(path), str(path)).removeprefix("\ufeff")


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file, over an older one if need be, so that a reader sees the old or the whole new one; its folder is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    part = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        part.chmod(0o644)
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def holds(path: Path, data: bytes) -> bool:
    """Tell whether a file with these very bytes stands there."""
    return path.is_file() and path.stat().st_size == len(data) and path.read_bytes() == data


def write_once(path: Path, text: str) -> None:
    """Write a text file atomically; its folder is made. The same bytes may be written again; other bytes are refused (UsageError)."""
    data = text.encode("utf-8")
    if holds(path, data):
        return
    if path.exists():
        remedy = "write into another folder: what is there is never overwritten"
        raise UsageError(str(path), expected="no file, or the same bytes", found="a file with other bytes", remedy=remedy)
    write_atomically(path, data)


def refuse_existing(path: Path) -> None:
    """Raise UsageError where a file is there already, before a command asks anything."""
    if path.exists():
        raise UsageError(str(path), expected="a new file", found="one that exists", remedy="name another one")


def write_new(path: Path, text: str) -> None:
    """Write a text file that must not be there yet, whole or not at all. Raises UsageError where it is, or where it cannot be written."""
    try:
        path.open("x").close()  # claims the name
        try:
            write_atomically(path, text.encode("utf-8"))
        except BaseException:
            path.unlink()
            raise
    except FileExistsError as error:
        raise UsageError(str(path), expected="a new file", found="one that exists", remedy="name another one") from error
    except OSError as error:
        raise UsageError(str(path), expected="a file that can be written", found=error.strerror or str(error)) from error
