"""What every wire format must hold to, whatever it is: inherited by the test class of each decoder."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stepdiag.daq.timing.samples import Decoder
from testkit.streams import assert_same, feed_all, pieces

INHERITED = settings(suppress_health_check=[HealthCheck.differing_executors, HealthCheck.too_slow])
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
        assert_same(whole, feed_all(self.make(), [stream[at : at + 1] for at in range(len(stream))] or [b""]))

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


def assert_sound(samples):
    """Columns of one length, a counter that only grows, remarks at samples that exist, positions that are numbers or flagged."""
    count = len(samples)
    assert all(len(column) == count for column in (samples.position_mm, samples.beam, samples.flags, samples.arrival_ns))
    assert (np.diff(samples.counter) > 0).all()
    assert all(0 <= notice.index <= count for notice in samples.notices)
    assert (np.isfinite(samples.position_mm) | (samples.flags != 0)).all() or samples.channels is not None
