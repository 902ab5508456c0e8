"""What every wire format must hold to, whatever it is: inherited by the test class of each
decoder."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stepdiag.daq.timing.samples import Decoder
from testkit.streams import assert_same, feed_all, joined, pieces

INHERITED = settings(
    suppress_health_check=[HealthCheck.differing_executors, HealthCheck.too_slow]
)
CUTS = st.lists(st.integers(0, 6000), max_size=12)


class DecoderContract:
    """A subclass says how its decoder is made and what its instrument may send, right and wrong."""

    streams: ClassVar[st.SearchStrategy[bytes]]

    @abstractmethod
    def make(self) -> Decoder:
        """Return a fresh decoder."""

    @INHERITED
    @given(data=st.data(), cuts=CUTS)
    def test_any_split_gives_the_same_samples(self, data, cuts):
        stream = data.draw(self.streams)
        whole = feed_all(self.make(), [stream])
        assert_same(whole, feed_all(self.make(), pieces(stream, cuts)))
        assert_same(
            whole,
            feed_all(
                self.make(), [stream[at : at + 1] for at in range(len(stream))] or [b""]
            ),
        )

    @INHERITED
    @given(stream=st.binary(max_size=3000))
    def test_any_bytes_are_borne(self, stream):
        assert_sound(feed_all(self.make(), [stream]))

    @INHERITED
    @given(data=st.data(), cuts=CUTS)
    def test_an_interruption_anywhere_leaves_sound_samples(self, data, cuts):
        """The port is opened again in the middle of whatever was being sent."""
        decoder, stream = self.make(), data.draw(self.streams)
        for number, piece in enumerate(pieces(stream, cuts)):
            assert_sound(decoder.feed(piece, number))
            decoder.resync()


class SteadyDecoderContract(DecoderContract):
    """A subclass says besides how its instrument sends sample by sample where nothing happens."""

    @abstractmethod
    def plain(self, number: int) -> bytes:
        """Return the bytes of one plain sample; the next number follows it."""

    @INHERITED
    @given(data=st.data(), size=st.integers(1, 80), together=st.integers(1, 8))
    def test_many_chunks_at_once_are_what_each_would_have_given(self, data, size, together):
        """Whatever stands between plain stretches: every column, every arrival, every remark."""
        first, parts = 1, []
        for odd in data.draw(st.lists(self.streams, min_size=1, max_size=4)):
            count = data.draw(st.integers(1, 40))
            parts += [*(self.plain(number) for number in range(first, first + count)), odd]
            first += count
        stream = b"".join(parts)
        chunks = [(stream[at : at + size], 10 * at) for at in range(0, len(stream), size)]
        slow, quick = self.make(), self.make()
        wanted = [slow.feed(*chunk) for chunk in chunks]
        found, _ = fed_together(quick, chunks, together)
        assert_same(joined(wanted), joined(found))
        assert np.array_equal(joined(wanted).arrival_ns, joined(found).arrival_ns)

    def test_plain_samples_are_really_taken_at_once(self):
        """And where one is missing nothing is taken: what comes then is the same as if nobody had
        asked."""
        stream = b"".join(self.plain(number) for number in range(1, 81))
        _, at_once = fed_together(
            self.make(), [(stream[at : at + 17], at) for at in range(0, len(stream), 17)], 5
        )
        assert at_once > 5
        decoder = self.make()
        decoder.feed(b"".join(self.plain(number) for number in range(1, 6)), 0)
        assert decoder.feed_steady([(self.plain(6), 1), (self.plain(8), 2)]) is None
        assert decoder.feed(self.plain(6), 1).counter.tolist() == [
            decoder.feed(self.plain(7), 2).counter[0] - 1
        ]


def fed_together(decoder, chunks, together):
    """Return what a decoder makes of chunks (bytes, arrival in ns), so many at once where it takes
    them so, and how often it did."""
    found, at_once = [], 0
    for first in range(0, len(chunks), together):
        group = chunks[first : first + together]
        steady = decoder.feed_steady(group)
        at_once += steady is not None
        found += [decoder.feed(*chunk) for chunk in group] if steady is None else [steady]
    return found, at_once


def assert_sound(samples):
    """Columns of one length, a counter that only grows, remarks at samples that exist, positions
    that are numbers or flagged."""
    count = len(samples)
    assert all(
        len(column) == count
        for column in (samples.position_mm, samples.beam, samples.flags, samples.arrival_ns)
    )
    assert (np.diff(samples.counter) > 0).all()
    assert all(0 <= notice.index <= count for notice in samples.notices)
    assert (
        np.isfinite(samples.position_mm) | (samples.flags != 0)
    ).all() or samples.channels is not None
