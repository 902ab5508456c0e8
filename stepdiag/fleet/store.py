"""The store: files below one folder, a network share or a bucket, that are written whole, once, and never changed.

    stepdiag-store.json                            which layout
    machine=<id>/year=<y>/<survey>/...             the files of a survey, and their hashes in archived.json
    machine=<id>/year=<y>/<survey>.parquet         its numbers; written last: without it a survey is not there
    machine=<id>/year=<y>/<survey>@<software>/...  solved anew; with its <survey>@<software>.parquet
    series.parquet                                 every quantity of every survey, in one file, for speed; made again at any time

Two writers at once do not meet: they write under names of their own, and rename. Names of machines are percent-encoded.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator
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
from stepdiag.daq.records.survey_folder import RESULT

FORMAT, VERSION = "stepdiag-store", 1
MARK, INDEX, LISTED = "stepdiag-store.json", "series.parquet", "archived.json"
TABLE_SUFFIX = ".parquet"
LARGEST_JSON_BYTES = 16_000_000
LARGEST_LOG_BYTES = 1_000_000_000
"""A worker that solves anew holds a log of this size in its memory."""
_SHA256 = re.compile("[0-9a-f]{64}")


def sha256(data: bytes) -> str:
    """Return the SHA-256 of a file in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


class Place(NamedTuple):
    """Where a survey stands in the store; ``software`` is the version that solved it anew, empty for what was archived."""

    machine: str
    year: str
    survey: str
    software: str = ""

    @property
    def folder(self) -> str:
        """Return the folder of its files, seen from the store."""
        behind = f"@{quote(self.software, safe='.+')}" if self.software else ""
        return f"machine={quote(self.machine, safe=' ')}/year={self.year}/{self.survey}{behind}"

    @property
    def table(self) -> str:
        """Return the file of its numbers."""
        return self.folder + TABLE_SUFFIX


class Store:
    """One store. Every failure of the place itself is a UsageError with the name of the file."""

    def __init__(self, address: str, *, create: bool = False) -> None:
        """Open a store: a folder, or an address that fsspec knows. Raises UsageError where there is none, or one of a newer version."""
        self.address = address
        with refusing(address):
            self._files, root = fsspec.core.url_to_fs(address)
        self.root = str(root).rstrip("/")
        self.is_local = isinstance(self._files, LocalFileSystem)
        if create and not self.exists(MARK):
            self.write(MARK, json.dumps({"format": FORMAT, "version": VERSION}).encode() + b"\n")
        self._require_known()

    def path(self, name: str) -> str:
        """Return a name within the store as its file system writes it."""
        return f"{self.root}/{name}"

    def exists(self, name: str) -> bool:
        """Tell whether a file is there."""
        with refusing(name):
            return bool(self._files.exists(self.path(name)))

    def read(self, name: str, *, largest: int = LARGEST_BYTES) -> bytes:
        """Return a file. Raises DataError, before it is read, where it holds more than ``largest`` bytes."""
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

    def write(self, name: str, data: bytes, *, anew: bool = True) -> None:
        """Write a file whole or not at all, and on the disk when this returns; not ``anew``, one that came meanwhile stays."""
        target = self.path(name)
        with refusing(name):
            if not self.is_local:
                self._files.pipe_file(target, data)  # an object appears as a whole
                return
            Path(target).parent.mkdir(parents=True, exist_ok=True)
            with part_of(Path(target)) as folder:
                write_through(folder / "written", data)
                _publish(folder / "written", Path(target), anew=anew)
                sync_folder(Path(target).parent)

    def write_checked(self, name: str, data: bytes, meaning: Callable[[bytes], str] = sha256) -> bytes:
        """Write a file, read it back and return what is there; one that is there with this meaning stays, its bytes unless replaced.

        Raises DataError where another is there, or comes back.
        """
        wanted = meaning(data)
        if not self.exists(name):
            self.write(name, data, anew=False)
        there = self.read(name, largest=max(LARGEST_BYTES, 2 * len(data)))
        found = meaning(there)
        if found != wanted:
            remedy = message("never-overwritten")
            raise DataError(f"{self.address}: {name}", expected=f"SHA-256 {wanted}", found=found or message("damaged-file"), remedy=remedy)
        return there

    def state(self) -> tuple[object, ...]:
        """Return something that is another after every change: which surveys are there, and when index and tolerances were written."""
        stamps = []
        for name in (INDEX, "tolerances.toml"):
            with refusing(name):
                stamps.append(self._files.modified(self.path(name)) if self._files.exists(self.path(name)) else None)
        return (tuple(self.tables()), *stamps)

    def tables(self) -> list[Place]:
        """Return every survey that is whole, by machine, year and name; what was solved anew behind what was archived."""
        with refusing(self.address):
            known = _local_tables(Path(self.root)) if self.is_local else self._files.glob(f"{self.root}/machine=*/year=*/*{TABLE_SUFFIX}")
            found = list(known)  # a folder is read here, where its refusal is named
        return sorted(map(_place, map(str, found)))

    def json(self, name: str) -> Any:
        """Return a JSON file of ours. Raises DataError where it is none."""
        data = self.read(name, largest=LARGEST_JSON_BYTES)
        try:
            return json.loads(data)
        except (ValueError, RecursionError) as error:
            raise DataError(f"{self.address}: {name}", expected="JSON", found=str(error)) from error

    def files_of(self, place: Place) -> dict[str, str]:
        """Return the SHA-256 by name of an archived survey's files: its result, its logs and others.

        Raises DataError where the list is not as `stepdiag archive add` writes it.
        """
        name = f"{place.folder}/{LISTED}"
        listed = self.json(name)
        files = listed.get("files") if isinstance(listed, dict) else None
        if (
            isinstance(files, dict)
            and _is_complete(files)
            and all(isinstance(each, str) and _SHA256.fullmatch(each) for each in files.values())
        ):
            return files
        raise DataError(
            f"{self.address}: {name}", expected=message("list-of-survey"),
            found=excerpt(json.dumps(listed)), remedy=message("restore-from-copy"),
        )  # fmt: skip

    @property
    def filesystem(self) -> Any:
        """Return the file system, for readers that take one."""
        return self._files

    def _require_known(self) -> None:
        if not self.exists(MARK):
            raise UsageError(
                self.address,
                expected=message("a-store", name=MARK),
                found=message("none"),
                remedy=message("command-writes", command="stepdiag archive add DIR --to STORE"),
            )
        mark = self.json(MARK)
        version = mark.get("version") if isinstance(mark, dict) else None
        if not isinstance(mark, dict) or mark.get("format") != FORMAT or version != VERSION:
            remedy = message("newer-reads") if isinstance(version, int) and version > VERSION else ""
            raise UsageError(f"{self.address}: {MARK}", expected=f"{FORMAT}, version {VERSION}", found=str(mark), remedy=remedy)


@contextmanager
def refusing(name: str) -> Iterator[None]:
    """Say what the place of the store refuses: full, away, not allowed, or an address that nothing opens."""
    try:
        yield
    except (UsageError, DataError):
        raise
    except (OSError, ValueError, ImportError, RuntimeError) as error:
        why = (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
        raise UsageError(name, expected=message("readable-and-writable"), found=why) from error


def _is_complete(files: dict[str, Any]) -> bool:
    return RESULT in files and any(name.endswith(".mcap") for name in files)


def _local_tables(root: Path) -> Iterator[str]:
    """Yield what the glob would, in a tenth of its time: of a folder only names are read."""
    for machine in _names(root, "machine="):
        for year in _names(root / machine, "year="):
            yield from (f"{machine}/{year}/{name}" for name in _names(root / machine / year) if name.endswith(TABLE_SUFFIX))


def _names(folder: Path, prefix: str = "") -> list[str]:
    return [name for name in os.listdir(folder) if name.startswith(prefix)]  # noqa: PTH208  # names alone


def _place(path: str) -> Place:
    machine, year, file = path.split("/")[-3:]
    survey, _, software = file.removesuffix(TABLE_SUFFIX).partition("@")
    return Place(unquote(machine.removeprefix("machine=")), year.removeprefix("year="), survey, unquote(software))


def _publish(part: Path, target: Path, *, anew: bool) -> None:
    """Give a written file its name; where the share knows links, another's that has it by now is left alone."""
    if not anew:
        try:
            target.hardlink_to(part)
        except FileExistsError:
            return
        except OSError:  # a share without links; what is there now is read back and compared
            pass
        else:
            return
    part.replace(target)
