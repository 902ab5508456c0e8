"""Recognition of an instrument by its first bytes, and messages about a stream without readings."""

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
"""Least number of readings that recognises a format: random bytes can contain one valid reading,
but not two.
"""
KEPT = 4096
"""Number of bytes stored from the beginning of a stream, to recognise the format of a stream
without readings.
"""
QUOTED = 24
"""Number of bytes that a message shows from a stream without readings."""


def recognise(heard: bytes) -> str:
    """Return the name of the format that decodes these bytes to readings, such as ``lasertex``;
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
    """Return the message about a stream without readings: the first bytes, the likely format and
    the remedy.

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
    return message("stream-refused", stream=name, why=remark or message("reports-error"))


def _candidates() -> Iterator[tuple[str, Decoder]]:
    """Yield the decoders with the strictest checks first: formats with a checksum, then formats
    with a grammar.
    """
    yield "lasertex", LasertexDecoder(LasertexSettings())
    yield "fourdof", FourdofDecoder(FourdofSettings())
    yield "fourdof", FourdofDecoder(FourdofSettings(encoding="ascii"))
    yield "qudis", QudisDecoder(QudisSettings())
    yield "ids3010", Ids3010Decoder(Ids3010Settings())
    yield "umd", UmdDecoder(UmdSettings())
    yield "nd", NdDecoder(NdSettings())
