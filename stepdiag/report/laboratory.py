"""The facts outside a result: laboratory, customer, item, persons and equipment, from a settings
file. A missing fact appears as "not stated"."""

import hashlib
from datetime import date
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from stepdiag.base.files import read_bytes, read_text
from stepdiag.base.settings import convert, read_toml

NOT_STATED = "not stated"
UNKNOWN_COUNTRY = "ZZ"
"""Code of an unknown country: the schema of the certificate requires a code, and ISO 3166-1 leaves
this code to its users."""
Country = Annotated[
    str, Meta(pattern=r"^([A-Z]{2})?\Z", description='a country as two letters, such as "DE"')
]


class Place(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A name with its address, of the laboratory or the customer."""

    name: str = ""
    code: str = ""
    email: str = ""
    phone: str = ""
    street: str = ""
    street_no: str = ""
    post_code: str = ""
    city: str = ""
    country: Country = ""


class Item(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    name: str = ""
    manufacturer: str = ""
    model: str = ""
    serial: str = ""
    inventory: str = ""


class Person(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A person responsible for the certificate."""

    name: str = ""
    role: str = ""
    main_signer: bool = False


class Equipment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A laser or a sensor; ``certificate_file`` is its calibration certificate, a file beside the
    settings file."""

    name: str
    manufacturer: str = ""
    model: str = ""
    serial: str = ""
    certificate: str = ""
    certificate_file: str = ""


class Head(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Number and dates of the certificate; ``previous_file`` is the earlier report, ``replaces``
    the number of an amended certificate."""

    number: str = ""
    order: str = ""
    country: Country = ""
    location: Literal[
        "laboratory", "customer", "laboratoryBranch", "customerBranch", "other"
    ] = "customer"
    begun: date | None = None
    ended: date | None = None
    issued: date | None = None
    previous_number: str = ""
    previous_file: str = ""
    replaces: str = ""


class Laboratory(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    certificate: Head = Head()
    laboratory: Place = Place()
    customer: Place = Place()
    item: Item = Item()
    person: tuple[Person, ...] = ()
    equipment: tuple[Equipment, ...] = ()


class Stated(msgspec.Struct, frozen=True, kw_only=True):
    """The settings file of the laboratory, with the hashes of the files named in it, by name.
    ``name`` and ``sha256`` belong to the settings file; both are empty without a file."""

    file: Laboratory
    name: str = ""
    sha256: str = ""
    hashes: dict[str, str] = {}


def read_laboratory(path: Path | None) -> Stated:
    """Return the laboratory's settings file; empty without a file. Raises UsageError for a wrong
    field or a missing file."""
    if path is None:
        return Stated(file=Laboratory())
    found = convert(read_toml(read_text(path), path.name), Laboratory, path.name)
    named = [
        found.certificate.previous_file,
        *(one.certificate_file for one in found.equipment),
    ]
    hashes = {name: sha256_of(path.parent / name) for name in named if name}
    return Stated(file=found, name=path.name, sha256=sha256_of(path), hashes=hashes)


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file. Raises UsageError for an unreadable file."""
    return hashlib.sha256(read_bytes(path)).hexdigest()
