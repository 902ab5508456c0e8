"""The store: files below a folder, on a network share or in a bucket. Each file is written
completely, once, and never changed.

    stepdiag-store.json                            format and version of the store
    machine=<id>/year=<y>/<survey>/...             the files of a survey; archived.json
    machine=<id>/year=<y>/<survey>.parquet         its values; a survey is complete with this file
    machine=<id>/year=<y>/<survey>@<software>/...  the survey solved again, with its .parquet
    series.index                                   the values of all surveys, for speed

A hash protects every byte behind a value. `archived.json` contains the hashes of the survey's
files and of its table in a canonical form, so every changed byte of this file is detected. The
index begins with the hash of its remaining bytes.

Each writer writes under its own temporary name and then renames the file, so two writers can work
at once. Names of machines are percent-encoded.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote, unquote

import fsspec
from fsspec.implementations.local import LocalFileSystem

from stepdiag.base.disk.part import part_of, write_through
from stepdiag.base.disk.system import sync_folder
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.files import LARGEST_BYTES
from stepdiag.base.messages import excerpt, message
from stepdiag.daq.records.survey_folder import RESULT, machine_folder

FORMAT, VERSION = "stepdiag-store", 1
MARK, INDEX, LISTED = "stepdiag-store.json", "series.index", "archived.json"
LISTED_FORMAT, LISTED_VERSION = "stepdiag-archived", 1
TABLE_SUFFIX = ".parquet"
LARGEST_JSON_BYTES = 4_000_000
"""Largest size in bytes of a JSON file: a list of 20,000 names with their hashes. Parsing needs up
to thirty times as much memory."""
LARGEST_FILE_BYTES = 4_000_000_000
"""Largest size in bytes of a survey's file, which is copied and hashed piece by piece."""
_PIECE_BYTES = 1_000_000
INDEX_REMEDY = message("remove-table")
_SHA256 = re.compile("[0-9a-f]{64}")


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


class Listed(NamedTuple):
    """The SHA-256 of a survey's files by name, and of its table; empty in stores of older versions
    without hashes."""

    files: dict[str, str]
    table: str


class Place(NamedTuple):
    """The place of a survey in the store; ``software`` is the version of the program that solved
    the survey again, empty for the archived result."""

    machine: str
    year: str
    survey: str
    software: str = ""

    @property
    def folder(self) -> str:
        """Return the folder of the survey's files, relative to the store."""
        behind = f"@{quote(self.software, safe='.+')}" if self.software else ""
        return f"{machine_folder(self.machine)}/year={self.year}/{self.survey}{behind}"

    @property
    def table(self) -> str:
        """Return the path of the table with the survey's numbers."""
        return self.folder + TABLE_SUFFIX

    @property
    def listed(self) -> str:
        """Return the path of the list of the survey's files."""
        return f"{self.folder}/{LISTED}"


def manifest_of(place: Place, files: Mapping[str, str], table: str) -> bytes:
    """Return the list of a survey's files with their SHA-256; ``table`` is the hash of the survey's
    table, empty in lists by older versions."""
    stated = {"table": table} if table else {}
    manifest = {
        "format": LISTED_FORMAT,
        "version": LISTED_VERSION,
        "machine": place.machine,
        "survey": place.survey,
        "files": dict(files),
    }
    return json.dumps(manifest | stated, indent=1, sort_keys=True).encode() + b"\n"


def sealed(data: bytes) -> bytes:
    """Return the hash of the data, followed by the data. Hash and data are stored in one file, so
    that the same writer writes both."""
    return sha256(data).encode() + b"\n" + data


def unsealed(data: bytes, name: str) -> bytes:
    """Return the bytes after their hash. Raises DataError if hash and bytes differ."""
    stated, _, rest = data.partition(b"\n")
    if stated != sha256(rest).encode():
        raise DataError(
            name,
            expected=f"SHA-256 {excerpt(stated.decode('ascii', 'replace'))}",
            found=sha256(rest),
            remedy=INDEX_REMEDY,
        )
    return rest


class Store:
    """A store. An error of its folder, share or bucket is raised as a UsageError with the name of
    the file."""

    def __init__(self, address: str, *, create: bool = False) -> None:
        """Open a store: a folder, or an address for fsspec. Raises UsageError if there is no store,
        or for a store of a newer version."""
        self.address = address
        with refusing(address):
            self._files, root = fsspec.core.url_to_fs(address)
        self.root = str(root).rstrip("/")
        self.is_local = isinstance(self._files, LocalFileSystem)
        if create and not self.exists(MARK):
            self.write(
                MARK, json.dumps({"format": FORMAT, "version": VERSION}).encode() + b"\n"
            )
        self._require_known()

    def path(self, name: str) -> str:
        """Return a name within the store as a path of its file system."""
        return f"{self.root}/{name}"

    def exists(self, name: str) -> bool:
        with refusing(name):
            return bool(self._files.exists(self.path(name)))

    def read(self, name: str, *, largest: int = LARGEST_BYTES) -> bytes:
        """Return the bytes of a file. Raises DataError for a file of more than ``largest`` bytes,
        before reading."""
        with refusing(name):
            size = self._files.size(self.path(name))
            if size is not None and size > largest:
                raise DataError(
                    f"{self.address}: {name}",
                    expected=message("file-of-at-most", name=name, most=largest),
                    found=str(size),
                    remedy=message("never-overwritten"),
                )
            return bytes(self._files.cat_file(self.path(name)))

    def copied(self, name: str, target: Path | None = None) -> str:
        """Copy a file piece by piece to ``target``; return its SHA-256. Raises DataError for a file
        that is too large."""
        found, size = hashlib.sha256(), 0
        with (
            refusing(name),
            self._files.open(self.path(name), "rb") as file,
            open(target or os.devnull, "wb") as copy,  # noqa: PTH123
        ):
            while piece := file.read(_PIECE_BYTES):
                found.update(piece)
                size += copy.write(piece)
                if size > LARGEST_FILE_BYTES:
                    raise DataError(
                        f"{self.address}: {name}",
                        expected=message(
                            "file-of-at-most", name=name, most=LARGEST_FILE_BYTES
                        ),
                        found=message("found-more"),
                    )
        return found.hexdigest()

    def write(self, name: str, data: bytes, *, anew: bool = True) -> None:
        """Write a file completely or not at all, synced to the disk on return. Unless ``anew``, a
        file that another writer has written meanwhile stays."""
        target = self.path(name)
        with refusing(name):
            if not self.is_local:
                self._files.pipe_file(
                    target, data
                )  # in a bucket an object appears only when it is complete
                return
            Path(target).parent.mkdir(parents=True, exist_ok=True)
            with part_of(Path(target)) as folder:
                write_through(folder / "written", data)
                _publish(folder / "written", Path(target), anew=anew)
                sync_folder(Path(target).parent)

    def write_checked(
        self, name: str, data: bytes, meaning: Callable[[bytes], str] = sha256
    ) -> bytes:
        """Write a file, read it back and return its bytes. An existing file stays. ``meaning``
        returns the content by which two files are compared, by default the SHA-256.

        Raises DataError if the existing file or the bytes read back have another content.
        """
        wanted = meaning(data)
        if not self.exists(name):
            self.write(name, data, anew=False)
        there = self.read(name, largest=max(LARGEST_BYTES, 2 * len(data)))
        found = meaning(there)
        if found != wanted:
            remedy = message("never-overwritten")
            raise DataError(
                f"{self.address}: {name}",
                expected=f"SHA-256 {wanted}",
                found=found or message("damaged-file"),
                remedy=remedy,
            )
        return there

    def state(self) -> tuple[object, ...]:
        """Return a value that differs after every change of the store, computed from the surveys
        and the times of index and tolerances."""
        stamps = []
        for name in (INDEX, "tolerances.toml"):
            with refusing(name):
                stamps.append(
                    self._files.modified(self.path(name))
                    if self._files.exists(self.path(name))
                    else None
                )
        return (tuple(self.tables()), *stamps)

    def tables(self) -> list[Place]:
        """Return the place of every complete survey by machine, year and name. Results that were
        solved again follow the archived result of their survey."""
        with refusing(self.address):
            known = (
                _local_tables(Path(self.root))
                if self.is_local
                else self._files.glob(f"{self.root}/machine=*/year=*/*{TABLE_SUFFIX}")
            )
            # the folders are read here, so that `refusing` can name the store in an error
            found = list(known)
        return sorted(map(_place_of_path, map(str, found)))

    def json(self, name: str) -> Any:
        """Return the contents of a JSON file of this program. Raises DataError for invalid
        contents."""
        data = self.read(name, largest=LARGEST_JSON_BYTES)
        try:
            return json.loads(data)
        except (ValueError, RecursionError) as error:
            raise DataError(
                f"{self.address}: {name}", expected="JSON", found=str(error)
            ) from error

    def listed(self, place: Place) -> Listed:
        """Return the hashes of a survey's files and table; empty for a survey that an older version
        solved again.

        Raises DataError for a list with other bytes than this program writes.
        """
        if place.software and not self.exists(place.listed):
            return Listed({}, "")
        listed = self.json(place.listed)
        files, table = (
            (listed.get("files"), listed.get("table", ""))
            if isinstance(listed, dict)
            else (None, "")
        )
        if (
            isinstance(files, dict)
            and RESULT in files
            and all(map(_is_hash, (*files.values(), table or "0" * 64)))
        ):
            known = Listed(files, table)
            if self.read(place.listed, largest=LARGEST_JSON_BYTES) == manifest_of(
                place, *known
            ):
                return known
        raise DataError(
            f"{self.address}: {place.listed}",
            expected=message("list-of-survey"),
            found=excerpt(json.dumps(listed)),
            remedy=message("restore-from-copy"),
        )

    def _require_known(self) -> None:
        if not self.exists(MARK):
            raise UsageError(
                self.address,
                expected=message("a-store", name=MARK),
                found=message("none"),
                remedy=message(
                    "command-writes", command="stepdiag archive add DIR --to STORE"
                ),
            )
        mark = self.json(MARK)
        version = mark.get("version") if isinstance(mark, dict) else None
        if not isinstance(mark, dict) or mark.get("format") != FORMAT or version != VERSION:
            remedy = (
                message("newer-reads")
                if isinstance(version, int) and version > VERSION
                else ""
            )
            raise UsageError(
                f"{self.address}: {MARK}",
                expected=f"{FORMAT}, version {VERSION}",
                found=str(mark),
                remedy=remedy,
            )


@contextmanager
def refusing(name: str) -> Iterator[None]:
    """Raise UsageError with the reason why the store cannot be used: full, absent, not permitted,
    or an unknown kind of address."""
    try:
        yield
    except (UsageError, DataError):
        raise
    except (OSError, ValueError, ImportError, RuntimeError) as error:
        why = (
            (error.strerror if isinstance(error, OSError) else None)
            or str(error)
            or type(error).__name__
        )
        raise UsageError(
            name, expected=message("readable-and-writable"), found=why
        ) from error


def _is_hash(text: object) -> bool:
    return isinstance(text, str) and _SHA256.fullmatch(text) is not None


def _local_tables(root: Path) -> Iterator[str]:
    """Yield the paths of all tables in a local store. Only the names in each folder are read, which
    takes a tenth of the time of a glob."""
    for machine in _names(root, "machine="):
        for year in _names(root / machine, "year="):
            yield from (
                f"{machine}/{year}/{name}"
                for name in _names(root / machine / year)
                if name.endswith(TABLE_SUFFIX)
            )


def _names(folder: Path, prefix: str = "") -> list[str]:
    return [name for name in os.listdir(folder) if name.startswith(prefix)]  # noqa: PTH208  # names alone


def _place_of_path(path: str) -> Place:
    machine, year, file = path.split("/")[-3:]
    survey, _, software = file.removesuffix(TABLE_SUFFIX).partition("@")
    return Place(
        unquote(machine.removeprefix("machine=")),
        year.removeprefix("year="),
        survey,
        unquote(software),
    )


def _publish(part: Path, target: Path, *, anew: bool) -> None:
    """Rename a written file to its name. On a share that supports hard links, an existing file of
    another writer stays."""
    if not anew:
        try:
            target.hardlink_to(part)
        except FileExistsError:
            return
        except (
            OSError
        ):  # on a share without links, the present contents are read back and compared
            pass
        else:
            return
    part.replace(target)
