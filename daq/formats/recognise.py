"""Recognition of the sending instrument by its first bytes: every format that needs no description
in the survey file is tried.

The module also makes the messages about a stream without readings, which `check` and the journal of
the daemon show.
"""

from collections.abc import Iterator

import numpy as np

from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.formats.instruments.fourdof import FourdofDecoder, FourdofSettings
from stepdiag.daq.formats.instruments.ids3010 import Ids3010Decoder, Ids3010Settings
from stepdiag.daq.formats.instruments.lasertex import LasertexDecoder, LasertexSettings
from stepdiag.daq.formats.instruments.nd import NdDecoder, NdSettings
from stepdiag.daq.formats.instruments.qudis import QudisDecoder, QudisSettings
from stepdiag.daq.formats.instruments.umd.decoder import UmdDecoder, UmdSettings
from stepdiag.daq.timing.samples import Decoder

LEAST_SAMPLES = 2
"""Least number of readings that recognises a format: random bytes can give one reading by accident,
but not two.
"""
KEPT = 4096
"""Number of bytes kept from the beginning of a stream: if the stream gives no reading, these bytes
are shown, and their format is searched.
"""
QUOTED = 24
"""Number of bytes shown from a stream without readings."""


def recognise(heard: bytes) -> str:
    """Return the name of the format that gives readings from these bytes, such as ``lasertex``;
    empty without such a format.

    The first bytes may begin in the middle of a line or frame. Formats that a survey file describes
    (``line``, ``frames``) are not tried.
    """
    for name, decoder in _candidates():
        samples = decoder.feed(heard, 1)
        garbage = sum(notice.code == "garbage" for notice in samples.notices)
        known = (
            np.isfinite(samples.position_mm).any()
            or samples.channels is not None
            or name == "umd"
        )
        if len(samples) >= LEAST_SAMPLES and garbage <= 1 and known:
            return name
    return ""


def senseless(name: Words, heard: bytes, count: int, remark: Words) -> Message:
    """Return the message about a stream without readings: the beginning of the stream, its likely
    format and the remedy.

    ``heard`` are the first of ``count`` received bytes; ``remark`` is the last remark of the
    decoder.
    """
    found = remark or message("not-one-reading", count=count)
    looks = recognise(heard)
    remedy = message("looks-like", format=looks) if looks else message("check-line")
    return message(
        "stream-senseless",
        stream=name,
        found=found,
        bytes=heard[:QUOTED].hex(" "),
        remedy=remedy,
    )


def refused(name: Words, remark: Words) -> Message:
    """Return the message about an instrument that answers, but never with a usable reading."""
    return message("stream-refused", stream=name, why=remark or message("reports-error"))


def _candidates() -> Iterator[tuple[str, Decoder]]:
    """Yield the decoders with the strictest checks first: a checksum, then a grammar."""
    yield "lasertex", LasertexDecoder(LasertexSettings())
    yield "fourdof", FourdofDecoder(FourdofSettings())
    yield "fourdof", FourdofDecoder(FourdofSettings(encoding="ascii"))
    yield "qudis", QudisDecoder(QudisSettings())
    yield "ids3010", Ids3010Decoder(Ids3010Settings())
    yield "umd", UmdDecoder(UmdSettings())
    yield "nd", NdDecoder(NdSettings())
