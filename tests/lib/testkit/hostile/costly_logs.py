"""Logs of few bytes that cost as much as they can: right checksums, right messages, and no more of
them than a reader must put up with."""

import json
import struct
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path

import msgspec
import zstandard

from stepdiag.daq.log.codec import MOST_EVENTS, MOST_RANGES
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.log.reader import MOST_UNPACKED_PER_BYTE
from testkit.hostile.foreign_logs import contents, log_of, recorded

_CHUNK_BYTES = 15_000_000
_CHUNK, _MESSAGE, _CHANNEL, _PRIVATE, _SUMMARY = 6, 5, 4, 0x80, (15, 8, 10, 11, 13, 14, 2)
"""Kinds of record (the MCAP specification, "Records"); those behind the data would have to be made
anew, and nobody needs them."""


def widest_polls(size: int) -> bytes:
    """Polls with as many ranges as there may be, that all say the same."""
    asked = "|".join(f"holding {address} 1" for address in range(MOST_RANGES))
    answers = "|".join(["0001"] * MOST_RANGES)
    return _filled(
        size, "/machine/raw", lambda first: _polls(first, 10_000, asked, answers), 10_000
    )


def most_polls(size: int) -> bytes:
    """Polls of one register, as many as there may be in a message."""
    return _filled(
        size,
        "/machine/raw",
        lambda first: _polls(first, MOST_EVENTS, "holding 0 1", "0001"),
        MOST_EVENTS,
    )


def most_events(size: int) -> bytes:
    """Chunks of one byte, as many as there may be in a message."""
    return _filled(
        size, "/laser/raw", lambda first: _chunks(first, MOST_EVENTS, "1"), MOST_EVENTS
    )


def most_samples(size: int) -> bytes:
    """Lines of a laser at rest."""
    return _filled(
        size, "/laser/raw", lambda first: _chunks(first, 100, _line() * 3_000), 100
    )


def most_texts(size: int) -> bytes:
    """Bytes that mean nothing."""
    return _filled(size, "/laser/raw", lambda first: _chunks(first, 10, "x" * 1_400_000), 10)


COSTLY: Mapping[str, Callable[[int], bytes]] = {
    each.__name__: cache(each)
    for each in (widest_polls, most_polls, most_events, most_samples, most_texts)
}


def _line() -> str:
    """Return a line of the laser as the recorded log has it."""
    raw = next(
        line for line in contents(recorded()).split(b"\n") if line.startswith(b"/laser/raw")
    )
    return json.loads(raw.partition(b" ")[2])["data"][0].split("\n")[1] + "\n"


def _polls(first: int, count: int, asked: str, answers: str) -> dict[str, object]:
    after = [20_000 * number for number in range(count)]
    return _batch(first, count) | {
        "recv_us": after,
        "answer_us": [1000] * count,
        "ranges": asked,
        "data": [answers] * count,
    }


def _chunks(first: int, count: int, text: str) -> dict[str, object]:
    return _batch(first, count) | {"after_us": [1000] * count, "data": [text] * count}


def _batch(first: int, count: int) -> dict[str, object]:
    begins = first * 1_000_000
    return {
        "time": {"sec": first, "nsec": 0},
        "t_mono_ns": str(begins),
        "order": first,
        "skip": [0],
        "run": [count],
    }


def _filled(
    size: int, topic: str, message: Callable[[int], dict[str, object]], events: int
) -> bytes:
    """Return the short log with one message after another behind its own, padded so that no chunk
    unpacks to more than its bytes allow."""
    whole = log_of(contents(recorded()))
    records = list(_records(whole))
    channel = next(
        struct.unpack("<H", body[:2])[0]
        for kind, body in _inside(records)
        if kind == _CHANNEL and topic.encode() in body
    )
    first = _events(whole)
    out = [
        whole[:8],
        *(_record(kind, body) for kind, body in records if kind not in _SUMMARY),
    ]
    while sum(map(len, out)) < size:
        messages: list[bytes] = []
        while not messages or sum(map(len, messages)) + len(messages[-1]) < _CHUNK_BYTES:
            messages.append(
                _record(
                    _MESSAGE,
                    struct.pack("<HIQQ", channel, 0, 0, 0)
                    + msgspec.json.encode(message(first)),
                )
            )
            first += events
        data = b"".join(messages)
        packed = _chunk(data)
        out += [
            _record(
                _PRIVATE, bytes(max(0, len(data) // MOST_UNPACKED_PER_BYTE - len(packed)))
            ),
            packed,
        ]
    return b"".join(out)


def _events(log: bytes) -> int:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log"
        path.write_bytes(log)
        return sum(1 for _ in open_log(path).events())


def _inside(records: list[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
    for kind, body in records:
        if kind == _CHUNK:
            at = 32 + struct.unpack("<I", body[28:32])[0] + 8
            yield from _records(b"\0" * 8 + zstandard.decompress(body[at:]))


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 8
    while at + 9 <= len(data):
        kind, length = struct.unpack("<BQ", data[at : at + 9])
        if data[at : at + 8] == b"\x89MCAP0\r\n":
            return
        yield kind, data[at + 9 : at + 9 + length]
        at += 9 + length


def _record(kind: int, body: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(body)) + body


def _chunk(data: bytes) -> bytes:
    packed = zstandard.compress(data, 6)
    return _record(
        _CHUNK,
        struct.pack("<QQQI", 0, 0, len(data), 0)
        + struct.pack("<I", 4)
        + b"zstd"
        + struct.pack("<Q", len(packed))
        + packed,
    )
