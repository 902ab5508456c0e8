"""Messages between the recording process and the page's process: a pipe in each direction, each
message preceded by its length.

The page shows the received data and requests very little: a snapshot, the figures, or a command
from the list. No other event of the page's process can reach the recording.
"""

from pathlib import Path
from typing import Any

import msgspec

from stepdiag.base.messages import Words
from stepdiag.daq.records.status import CommandName, Snapshot
from stepdiag.daq.service.metrics import Figures
from stepdiag.texts.texts import Language

LENGTH_BYTES = 4
LONGEST_REQUEST = 16_384
"""Largest message of the page in bytes."""
LONGEST_MESSAGE = 16_000_000
"""Bytes of a message to the page."""


class PageSettings(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Settings of the page; the first message, so that no secret stands on a command line or in an
    environment.
    """

    folder: str
    """Folder that the page may read besides the program itself."""
    token: str = ""
    names: tuple[str, ...] = ()
    certificate: str = ""
    key: str = ""
    language: Language = "en"


class Picture(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The present state; ``folder`` holds the files for download, ``result`` is the result's file
    or empty.
    """

    snapshot: Snapshot
    folder: str
    result: str


class Answer(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """An order was done, or refused with the reason."""

    number: int
    refusal: Words


class Counted(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The daemon's figures."""

    number: int
    figures: Figures


class Watch(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Send a snapshot now, and continue while ``on``."""

    on: bool


class Order(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """An order of a user with the token, and the address of the browser."""

    number: int
    name: CommandName
    arguments: dict[str, str]
    address: str


class Count(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The figures."""

    number: int


class Guesses(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A client at an address has sent a number of wrong tokens."""

    address: str
    count: int


class Fault(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A fault of this program occurred in the page."""

    text: str


class Ready(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The page is ready; ``open`` names the rights that the kernel could not remove
    (`stepdiag.walls.confine`).
    """

    open: tuple[str, ...]


Incoming = Picture | Answer | Counted
Request = Watch | Order | Count | Guesses | Fault | Ready
_encoder = msgspec.msgpack.Encoder(
    enc_hook=lambda value: str(value) if isinstance(value, Path) else value
)
incoming_decoder = msgspec.msgpack.Decoder(Incoming)
request_decoder = msgspec.msgpack.Decoder(Request)
settings_decoder = msgspec.msgpack.Decoder(PageSettings)


def framed(message: Any) -> bytes:
    """Return a message in the form for the pipe."""
    body = _encoder.encode(message)
    return len(body).to_bytes(LENGTH_BYTES, "big") + body
