"""Feeding decoders: whole, byte by byte, split anywhere."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from stepdiag.daq.timing.samples import Decoder, Samples


def pieces(data: bytes, cuts: Iterable[int]) -> list[bytes]:
    """Return ``data`` cut at the given places."""
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(places)]


def feed_all(decoder: Decoder, chunks: Sequence[bytes]) -> Samples:
    """Return everything the decoder makes of the chunks, as one batch; chunk number n arrives at
    n."""
    return joined([decoder.feed(chunk, number) for number, chunk in enumerate(chunks)])


def joined(batches: Sequence[Samples]) -> Samples:
    """Return batches that follow each other as one."""
    notices, count = [], 0
    for batch in batches:
        notices += [replace(notice, index=notice.index + count) for notice in batch.notices]
        count += len(batch)
    channels = [batch.channels for batch in batches if batch.channels is not None]
    return Samples(
        counter=np.concatenate([batch.counter for batch in batches]),
        position_mm=np.concatenate([batch.position_mm for batch in batches]),
        beam=np.concatenate([batch.beam for batch in batches]),
        flags=np.concatenate([batch.flags for batch in batches]),
        arrival_ns=np.concatenate([batch.arrival_ns for batch in batches]),
        channels=np.concatenate(channels) if channels else None,
        notices=tuple(notices),
    )


def assert_same(one: Samples, other: Samples) -> None:
    """Both hold the same samples and the same remarks at the same places; arrival stamps apart."""
    np.testing.assert_array_equal(one.counter, other.counter)
    np.testing.assert_array_equal(one.position_mm, other.position_mm)
    np.testing.assert_array_equal(one.beam, other.beam)
    np.testing.assert_array_equal(one.flags, other.flags)
    assert (one.channels is None) == (other.channels is None)
    if one.channels is not None:
        np.testing.assert_array_equal(one.channels, other.channels)
    assert one.notices == other.notices


def codes(samples: Samples) -> list[str]:
    """Return the codes of the remarks in order."""
    return [notice.code for notice in samples.notices]
