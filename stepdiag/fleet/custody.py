"""The chain of custody through a store: index -> table -> result -> logs, and from there as in a folder (`certificate.custody`).

index        each point of the survey is the one that its table gives
table        names its result by SHA-256; its numbers are those of the result, its bytes those that were archived
result, logs the files that were archived, by SHA-256
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from stepdiag.base.errors import DataError, StepdiagError
from stepdiag.base.files import LARGEST_BYTES, as_text, read_bytes
from stepdiag.base.messages import message
from stepdiag.base.result.result import parse_result
from stepdiag.certificate.custody import AS_LEFT, LOG, BrokenLinkError, Verified, custody_of, parsed, verify_certificate
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.fleet.archive import manifest_of, name_of_logs
from stepdiag.fleet.rows import about, rows_of
from stepdiag.fleet.store import INDEX, LARGEST_LOG_BYTES, LISTED, Place, Store, sha256
from stepdiag.fleet.tables import PLACE, index_of, read_index, read_table, result_named, table_of, to_parquet, written_by_another


def verify_in_store(certificate: Path, address: str) -> Verified:
    """Return whether a certificate follows from what stands in a store, and the first link that does not hold.

    What no store holds, the laboratory's file, stands beside the certificate. Raises DataError for a file that is no certificate,
    UsageError for an address that is no store.
    """
    root, store = parsed(read_bytes(certificate), certificate.name), Store(address)
    links = custody_of(root)
    logs = [[sha for role, _, sha in links if role == LOG + suffix] for suffix in ("", AS_LEFT)]
    surveys = {name_of_logs(each) for each in logs if each}
    with tempfile.TemporaryDirectory() as scratch:
        try:
            places = [place for place in store.tables() if place.survey in surveys]
            if len({place.survey for place in places}) < max(len(surveys), 1):
                raise BrokenLinkError(message("custody-no-survey", store=address))
            folders = [_fetched(store, place, Path(scratch) / str(number)) for number, place in enumerate(places)]
            _require_index(store, places)
        except BrokenLinkError as broken:
            return verify_certificate(certificate)._replace(broken=broken.link)
        return verify_certificate(certificate, *folders, certificate.parent)


def _fetched(store: Store, place: Place, folder: Path) -> Path:
    """Copy the files of a survey out of the store, each checked. Raises BrokenLinkError for the first link that does not hold."""
    folder.mkdir()
    try:
        data = store.read(place.table)
        result = store.read(f"{place.folder}/{RESULT}")
        listed = {} if place.software else store.json(f"{place.folder}/{LISTED}")
        files = {RESULT: sha256(result)} if place.software else store.files_of(place)
        _require_table(store, place, data, result)
        if not place.software:
            _require_manifest(store, place, listed, files, sha256(data))
        for name, expected in files.items():
            found = store.read(f"{place.folder}/{name}", largest=LARGEST_LOG_BYTES)
            if sha256(found) != expected:
                raise BrokenLinkError(message("custody-stored", name=f"{place.folder}/{name}"))
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(found)
    except StepdiagError as error:
        raise BrokenLinkError(message("custody-refused", what=str(error))) from error
    return folder


def _require_table(store: Store, place: Place, data: bytes, result: bytes) -> None:
    """Raise BrokenLinkError where a survey's table does not follow from its result.

    Its bytes too, where the same library wrote them: statistics and names of columns are no numbers, and readers go by them.
    """
    read = parse_result(as_text(result, RESULT), RESULT)
    expected = table_of(about(read, place.survey), list(rows_of(read)))
    if read_table(store, place).to_pylist() != expected.to_pylist():
        raise BrokenLinkError(message("custody-table", table=place.table))
    if result_named(data) not in (sha256(result), ""):
        raise BrokenLinkError(message("custody-table-result", table=place.table))
    again = to_parquet(expected, result_named(data))
    if again != data and not written_by_another(data):
        raise BrokenLinkError(message("custody-table-bytes", table=place.table))


def _require_manifest(store: Store, place: Place, listed: dict[str, object], files: dict[str, str], table: str) -> None:
    """Raise BrokenLinkError where the list of a survey's files is another one than was written, or names another table."""
    stated = {"table": str(listed["table"])} if "table" in listed else {}
    name = f"{place.folder}/{LISTED}"
    if store.read(name) != manifest_of(place, files, **stated) or stated.get("table", table) != table:
        raise BrokenLinkError(message("custody-stored", name=name))


def _require_index(store: Store, places: Sequence[Place]) -> None:
    """Raise BrokenLinkError where the index has other points of a survey than its table, or other bytes than its points give."""
    if not store.exists(INDEX):
        return
    everything = store.tables()
    try:
        index, data = read_index(store, len(everything)), store.read(INDEX, largest=LARGEST_BYTES)
        if not set(index[PLACE].unique().to_pylist()) <= {place.folder for place in everything}:
            raise BrokenLinkError(message("custody-table", table=INDEX))
        for place in places:
            found = index.filter(pc.equal(index[PLACE].cast(pa.string()), place.folder)).to_pylist()
            if found and str(found) != str(index_of([(read_table(store, place), place.folder)]).to_pylist()):
                raise BrokenLinkError(message("custody-table", table=INDEX))
        if to_parquet(index) != data and index[PLACE].num_chunks == 1 and not written_by_another(data):
            raise BrokenLinkError(message("custody-table-bytes", table=INDEX))
    except DataError as error:
        raise BrokenLinkError(message("custody-refused", what=str(error))) from error
