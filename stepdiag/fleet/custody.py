"""The chain of custody through a store: index, table, result, logs. `certificate.custody` checks
the links after the logs, as for a survey in a folder.

    index           each row of a survey is equal to the row in the table of the survey
    table           contains the SHA-256 of its result and has the numbers of this result; its
                    bytes are those that were archived (SHA-256)
    result, logs    are the files that were archived (SHA-256); the name of the survey follows
                    from its logs
"""

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from stepdiag.base.errors import DataError, StepdiagError
from stepdiag.base.files import LARGEST_BYTES, read_bytes
from stepdiag.base.messages import Message, message
from stepdiag.certificate.custody import (
    AS_LEFT,
    LOG,
    BrokenLinkError,
    Verified,
    custody_of,
    parsed,
    verify_certificate,
)
from stepdiag.daq.recording.archive import digest
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.fleet.archive import name_of_logs
from stepdiag.fleet.store import INDEX, Place, Store, sha256, unsealed
from stepdiag.fleet.tables import (
    MOST_ROWS,
    PLACE,
    SCHEMA,
    from_parquet,
    index_of,
    read_index,
    result_named,
    rows_from,
    to_parquet,
    written_by_another,
)
from stepdiag.fleet.tolerances import tolerances_in


def check(store: Store) -> Iterator[tuple[str, Message]]:
    """Read every byte of a store; yield (file or folder, its first broken link) for every change
    since it was written."""
    tables: dict[str, pa.Table] = {}
    for place in store.tables():
        with tempfile.TemporaryDirectory() as scratch:
            try:
                tables[place.folder] = _fetched(store, place, Path(scratch) / "survey")
            except BrokenLinkError as broken:
                yield place.folder, broken.link
    try:
        tolerances_in(store)
        _require_index(store, tables)
    except BrokenLinkError as broken:
        yield INDEX, broken.link
    except StepdiagError as error:
        yield store.address, error.message


def verify_in_store(certificate: Path, address: str) -> Verified:
    """Verify a certificate against a store; return the outcome with the first broken link.

    The laboratory's file is read from the folder of the certificate, because a store does not
    contain it. Raises DataError for a file that is not a certificate, UsageError for an address
    that is not a store.
    """
    root, store = parsed(read_bytes(certificate), certificate.name), Store(address)
    links = custody_of(root)
    logs = [
        [sha for role, _, sha in links if role == LOG + suffix] for suffix in ("", AS_LEFT)
    ]
    surveys = {name_of_logs(each) for each in logs if each}
    with tempfile.TemporaryDirectory() as scratch:
        try:
            places = [place for place in store.tables() if place.survey in surveys]
            if len({place.survey for place in places}) < max(len(surveys), 1):
                raise BrokenLinkError(message("custody-no-survey", store=address))
            folders = [Path(scratch) / str(number) for number in range(len(places))]
            _require_index(
                store,
                {
                    place.folder: _fetched(store, place, folder)
                    for place, folder in zip(places, folders, strict=True)
                },
            )
        except BrokenLinkError as broken:
            return verify_certificate(certificate)._replace(broken=broken.link)
        return verify_certificate(certificate, *folders, certificate.parent)


def _fetched(store: Store, place: Place, folder: Path) -> pa.Table:
    folder.mkdir()
    try:
        data = store.read(place.table)
        result = store.read(f"{place.folder}/{RESULT}")
        table = _require_table(place, data, result)
        files, stated = store.listed(place)
        if stated not in (sha256(data), ""):
            raise BrokenLinkError(message("custody-stored", name=place.listed))
        for name, expected in (files or {RESULT: sha256(result)}).items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if store.copied(f"{place.folder}/{name}", folder / name) != expected:
                raise BrokenLinkError(
                    message("custody-stored", name=f"{place.folder}/{name}")
                )
        if (
            not place.software
            and name_of_logs([digest(log) for log in folder.glob("*.mcap")]) != place.survey
        ):
            raise BrokenLinkError(message("custody-stored", name=f"{place.folder}/*.mcap"))
    except StepdiagError as error:
        raise BrokenLinkError(message("custody-refused", what=error.message)) from error
    return table


def _require_table(place: Place, data: bytes, result: bytes) -> pa.Table:
    """Return the table of a survey. Raises BrokenLinkError if the table differs from the table that
    is computed again from the result of the survey.

    If the same library version wrote the table, its bytes are compared too, because readers also
    use the statistics and the names of the columns.
    """
    table, expected = (
        from_parquet(data, place.table, SCHEMA, MOST_ROWS, LARGEST_BYTES),
        rows_from(result, place),
    )
    if table.to_pylist() != expected.to_pylist():
        raise BrokenLinkError(message("custody-table", table=place.table))
    if result_named(data) not in (sha256(result), ""):
        raise BrokenLinkError(message("custody-table-result", table=place.table))
    if to_parquet(expected, result_named(data)) != data and not written_by_another(data):
        raise BrokenLinkError(message("custody-table-bytes", table=place.table))
    return table


def _require_index(store: Store, tables: Mapping[str, pa.Table]) -> None:
    """Raise BrokenLinkError if the rows of a survey in the index differ from its table, or if the
    bytes of the index do not follow from its rows.

    ``tables`` are the tables of the compared surveys, by folder.
    """
    if not store.exists(INDEX):
        return
    everything = store.tables()
    try:
        index, data = (
            read_index(store, len(everything)),
            unsealed(store.read(INDEX, largest=LARGEST_BYTES), INDEX),
        )
        if not set(index[PLACE].unique().to_pylist()) <= {
            place.folder for place in everything
        }:
            raise BrokenLinkError(message("custody-table", table=INDEX))
        for folder, table in tables.items():
            found = index.filter(pc.equal(index[PLACE].cast(pa.string()), folder)).to_pylist()
            if found and str(found) != str(index_of([(table, folder)]).to_pylist()):
                raise BrokenLinkError(message("custody-table", table=INDEX))
        if (
            to_parquet(index) != data
            and index[PLACE].num_chunks == 1
            and not written_by_another(data)
        ):
            raise BrokenLinkError(message("custody-table-bytes", table=INDEX))
    except DataError as error:
        raise BrokenLinkError(message("custody-refused", what=str(error))) from error
