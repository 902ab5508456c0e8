"""What a forger does: a bit, a column of a table, with everything else kept."""

import hashlib
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from stepdiag.base.result.members import Source
from stepdiag.base.result.result import Result
from stepdiag.certificate import custody
from stepdiag.fleet.store import INDEX, Place, Store, manifest_of, sealed, unsealed

SOLVE = custody._solved
SOLVED: dict[str, Result] = {}
PRINTED = cache(custody.printed)


def solve_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a check solve the same readings of the same result, and print the same report, once for
    all tests of this process: most forgeries touch neither. Each chain is read, hashed and compared
    as always, with what was solved and printed when it was made."""

    def solved(
        result: Result, sources: Sequence[Source], files: Mapping[tuple[str, str], Path]
    ) -> Result:
        if all(one.role != "readings" for one in sources):
            return SOLVE(result, sources, files)
        read = {key: path.read_bytes() for key, path in files.items()}
        asked = hashlib.sha256(repr((result.to_json(), sources, read)).encode()).hexdigest()
        if asked not in SOLVED:
            SOLVED[asked] = SOLVE(result, sources, files)
        return SOLVED[asked]

    monkeypatch.setattr(custody, "_solved", solved)
    monkeypatch.setattr(custody, "printed", PRINTED)


@contextmanager
def flipped(path: Path, rng: np.random.Generator) -> Iterator[None]:
    """Flip one bit of a file, and put the file back."""
    whole = path.read_bytes()
    data = bytearray(whole)
    data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
    path.write_bytes(data)
    try:
        yield
    finally:
        path.write_bytes(whole)


def table_of_ours(path: Path) -> pa.Table:
    """Return a table of the store with its words as they are stored."""
    words = [field.name for field in pq.read_schema(path) if pa.types.is_string(field.type)]
    return pq.ParquetFile(path, read_dictionary=words).read()


def edited_table(
    path: Path,
    column: str,
    edit: Callable[[list[Any]], Sequence[Any]] = list,
    *,
    statistics: bool | list[str] = False,
) -> None:
    """Change a column of a Parquet file; its marks stay. ``statistics`` are the columns for which
    the file states least and largest."""
    table, known = table_of_ours(path), pq.read_metadata(path).metadata
    at = table.schema.get_field_index(column)
    table = table.set_column(
        at,
        table.schema.field(at),
        [pa.array(edit(table[column].to_pylist()), table.schema.field(at).type)],
    )
    out = io.BytesIO()
    with pq.ParquetWriter(
        out,
        table.schema,
        compression="zstd",
        compression_level=9,
        write_statistics=statistics or ["time"],
        store_schema=False,
    ) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata(
            {name: value for name, value in known.items() if name != b"ARROW:schema"}
        )
    path.write_bytes(out.getvalue())


def listed_anew(store: Store, place: Place) -> None:
    """Write the hashes of a survey's files and of its table anew into their list: a forger who
    knows the chain."""
    listed = Path(store.path(place.listed))
    files = {
        name: stated if not (listed.parent / name).exists() else _hash(listed.parent / name)
        for name, stated in store.listed(place).files.items()
    }
    listed.write_bytes(manifest_of(place, files, _hash(Path(store.path(place.table)))))


def edited_index(
    store: Store, column: str, edit: Callable[[list[Any]], Sequence[Any]]
) -> None:
    """Change a column of the index, and write its hash anew."""
    path = Path(store.path(INDEX))
    path.write_bytes(unsealed(path.read_bytes(), INDEX))
    edited_table(path, column, edit)
    path.write_bytes(sealed(path.read_bytes()))


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def signing_key(folder: Path) -> tuple[Path, Path]:
    """Make a key and its certificate by hand, as a laboratory's office does with its own."""
    from datetime import UTC, datetime, timedelta

    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    name, now = (
        x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "Lab")]),
        datetime.now(UTC),
    )
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
    )
    made = made.not_valid_before(now - timedelta(days=1)).not_valid_after(
        now + timedelta(days=1)
    )
    pem = serialization.Encoding.PEM
    (folder / "key.pem").write_bytes(
        key.private_bytes(
            pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
    )
    (folder / "cert.pem").write_bytes(made.sign(key, hashes.SHA256()).public_bytes(pem))
    return folder / "key.pem", folder / "cert.pem"


def rehashed(folder: Path, before: bytes, name: str) -> None:
    """Write the new hash of a file wherever the old one stands: a forger who knows the chain."""
    old, new = (
        hashlib.sha256(data).hexdigest() for data in (before, (folder / name).read_bytes())
    )
    for path in (folder / "result.json", folder / "c.xml"):
        path.write_text(
            path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8", newline=""
        )
