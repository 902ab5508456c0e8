"""Messages between the recording process and the page's process: a pipe in each direction, each
message preceded by its length.

The page has only three requests: for a snapshot, for the metrics, and for a command from a list.
Nothing else in the page's process can affect the recording.
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
"""Largest size in bytes of a message from the page to the daemon."""
LONGEST_MESSAGE = 16_000_000
"""Largest size in bytes of a message from the daemon to the page."""


class PageSettings(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The settings of the page, sent as the first message so that no secret is on a command line or
    in an environment."""

    folder: str
    """Folder that the page may read besides the program itself."""
    token: str = ""
    names: tuple[str, ...] = ()
    certificate: str = ""
    key: str = ""
    language: Language = "en"


class Picture(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A snapshot of the survey. ``folder`` contains the files for download; ``result`` is the path
    of the result's file or empty."""

    snapshot: Snapshot
    folder: str
    result: str


class Answer(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The answer to a command: ``refusal`` is the reason of a refusal, empty after execution."""

    number: int
    refusal: Words


class Counted(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The daemon's metrics for Prometheus."""

    number: int
    figures: Figures


class Watch(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A request for a snapshot, and for further snapshots while ``on``."""

    on: bool


class Order(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A request for a command by a user with the token; ``address`` is the address of the
    browser."""

    number: int
    name: CommandName
    arguments: dict[str, str]
    address: str


class Count(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A request for the daemon's metrics for Prometheus."""

    number: int


class Guesses(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A report that a client at an address has sent a number of wrong tokens."""

    address: str
    count: int


class Fault(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A report of a fault of this program in the page's process."""

    text: str


class Ready(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A report that the page is ready; ``open`` contains the rights that the kernel could not
    remove (`stepdiag.walls.confine`)."""

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
    """Return a message with its length, as bytes for the pipe."""
    body = _encoder.encode(message)
    return len(body).to_bytes(LENGTH_BYTES, "big") + body
