"""Archiving of finished surveys: a survey is packed, copied into the store, read back, and then
listed."""

import hashlib
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pyarrow as pa
import pyarrow.compute as pc

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.result.result import result_in
from stepdiag.daq.passes.survey_time import CODE
from stepdiag.daq.recording.archive import digest, pack
from stepdiag.daq.records.survey_folder import RESULT, logs_in
from stepdiag.fleet.rows import about, rows_of
from stepdiag.fleet.store import INDEX, Place, Store, manifest_of, sealed, sha256
from stepdiag.fleet.tables import (
    PLACE,
    index_of,
    read_index,
    read_table,
    table_of,
    to_parquet,
)

MOST_LOOSE = 50
"""Largest number of surveys outside the index; each takes about a millisecond of a query."""
_ID_DIGITS = 16
"""Number of hexadecimal digits of a survey's name in the store: 64 bits distinguish the logs of any
fleet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Added:
    """The outcome of archiving a survey; ``size_bytes`` is the size of the survey in the store."""

    source: Path
    place: Place
    outcome: Literal["archived", "already there"]
    size_bytes: int


def finished_in(folders: Sequence[Path]) -> list[Path]:
    """Return every folder, at or below the given folders, with logs and a result. Raises UsageError
    if there is no such folder."""
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(
                str(folder),
                expected=message("folder-with", what=message("finished-surveys")),
                found=message("no-such-folder"),
            )
    candidates = {
        path.parent
        for folder in folders
        for path in (folder / RESULT, *folder.rglob(RESULT))
        if path.is_file()
    }
    found = sorted(
        each for each in candidates if any(log.suffix == ".mcap" for log in logs_in(each))
    )
    if not found:
        raise UsageError(
            ", ".join(map(str, folders)),
            expected=message("finished-surveys"),
            found=message("none"),
        )
    return found


def undated(folder: Path) -> str:
    """Return the message that the time of a finished survey is unknown, because the clock of its
    computer was never set; empty for a known time."""
    result = result_in(folder / RESULT, str(folder / RESULT))
    return next(
        (
            str(found.words)
            for found in result.findings
            if (found.code, found.severity) == (CODE, "warning")
        ),
        "",
    )


def add(folder: Path, store: Store) -> Added:
    """Archive a finished survey unless the store contains it.

    Raises DataError for an unreadable log or result, or if the store contains the same logs with
    another result. Raises UsageError for a store that cannot be written. After an interruption the
    survey is not listed, and the next call completes it.
    """
    result = result_in(folder / RESULT, str(folder / RESULT))
    logs = [log for log in logs_in(folder) if log.suffix == ".mcap"]
    name = _name_of(logs)
    facts = about(result, name)
    place = Place(facts.machine, str(facts.time.year), name)
    listed = store.exists(place.table)
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch) / "survey"
        files = _packed_copy(folder, copy, logs, pack_logs=not listed)
        hashes = {path: sha256(data) for path, data in files()}
        if listed:
            _require_same(store, place, hashes)
            return Added(source=folder, place=place, outcome="already there", size_bytes=0)
        size = 0
        for path, data in files():
            there = store.write_checked(
                f"{place.folder}/{path}",
                data,
                _content_of if path.endswith(".mcap") else sha256,
            )
            hashes[path] = sha256(there)
            size += len(there)
    table = to_parquet(table_of(facts, list(rows_of(result))), hashes[RESULT])
    put_table(store, place, hashes, table)
    return Added(source=folder, place=place, outcome="archived", size_bytes=size + len(table))


def put_table(store: Store, place: Place, files: Mapping[str, str], table: bytes) -> None:
    """Write the list of a survey's files, and then the table that makes the survey part of the
    store."""
    store.write_checked(place.listed, manifest_of(place, files, sha256(table)))
    store.write_checked(place.table, table)


def _content_of(log: bytes) -> str:
    """Return the digest of the records in a log: the bytes of a packed log differ between
    computers."""
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "there.mcap"
        file.write_bytes(log)
        return digest(file)


def refresh_index(store: Store, *, most_loose: int = MOST_LOOSE) -> int:
    """Rebuild the index if more than ``most_loose`` surveys are outside it; return the number of
    rows of the new index, 0 without a new index.

    If two writers work at once, the index of the last writer stays. Surveys that this index lacks
    are read from their own tables.
    """
    places = store.tables()
    known, held = _indexed(store, len(places))
    loose = [place for place in places if place.folder not in held]
    gone = held - {place.folder for place in places}
    if len(loose) <= most_loose and not gone:
        return 0
    points = index_of([(read_table(store, place), place.folder) for place in loose])
    kept = (
        []
        if known is None
        else [
            known.filter(
                pc.invert(pc.is_in(known[PLACE], pa.array(sorted(gone), pa.string())))
            )
        ]
    )
    table = pa.concat_tables([*kept, points]).unify_dictionaries()
    store.write(INDEX, sealed(to_parquet(table)))
    return int(table.num_rows)


def _indexed(store: Store, surveys: int) -> tuple[pa.Table | None, set[str]]:
    """Return the index and the folders of the surveys in it; None and an empty set for a missing or
    damaged index, which is then rebuilt.
    """
    if not store.exists(INDEX):
        return None, set()
    try:
        table = read_index(store, surveys)
    except DataError:
        return None, set()
    return table, set(pc.unique(table[PLACE]).to_pylist())


def _name_of(logs: Sequence[Path]) -> str:
    sums = [digest(log) for log in logs]
    for log, each in zip(logs, sums, strict=True):
        if not each:
            raise DataError(
                str(log),
                expected=message("a-whole-log"),
                found=message("damaged-one"),
                remedy=message("command-mends", command=f"stepdiag recover {log}"),
            )
    return name_of_logs(sums)


def name_of_logs(digests: Sequence[str]) -> str:
    return hashlib.sha256("".join(sorted(digests)).encode()).hexdigest()[:_ID_DIGITS]


class _Files:
    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __call__(self) -> Iterator[tuple[str, bytes]]:
        for path in sorted(self._folder.rglob("*")):
            if path.is_file():
                yield path.relative_to(self._folder).as_posix(), path.read_bytes()


def _packed_copy(
    folder: Path, copy: Path, logs: Sequence[Path], *, pack_logs: bool
) -> _Files:
    """Copy the files of a survey: its own files, without links and hidden files, and its undamaged
    logs, packed.
    """
    wanted = [
        path
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.is_symlink() and _belongs(path, folder)
    ]
    for path in wanted:
        is_log = ".mcap" in path.suffixes
        if is_log and (not pack_logs or path not in logs):
            continue
        target = copy / path.relative_to(folder)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
        if is_log:
            pack(target)
    return _Files(copy)


def _belongs(path: Path, folder: Path) -> bool:
    return not any(part.startswith(".") for part in path.relative_to(folder).parts)


def _require_same(store: Store, place: Place, hashes: dict[str, str]) -> None:
    if store.listed(place).files[RESULT] != hashes.get(RESULT):
        raise DataError(
            f"{store.address}: {place.folder}/{RESULT}",
            expected=message("archived-result"),
            found=message("another-one"),
            remedy=message("archived-stays"),
        )
