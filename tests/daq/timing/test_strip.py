"""The strip for eyes: nothing that the laser said is left out, nothing is taken twice."""

import numpy as np

from stepdiag.daq.timing.samples import Samples
from stepdiag.daq.timing.strip import BIN_S, KEEP_BINS, Strip

BIN_NS = round(BIN_S * 1e9)


def batch(values: list[float], arrival_ns: int) -> Samples:
    """Return samples that came with one chunk."""
    count = len(values)
    return Samples(
        counter=np.arange(count),
        position_mm=np.array(values),
        beam=np.ones(count),
        flags=np.zeros(count, dtype=np.uint16),
        arrival_ns=np.full(count, arrival_ns),
    )


def test_every_extreme_is_kept() -> None:
    """One sample in a thousand that jumps is seen."""
    strip = Strip()
    for number in range(1, 20):
        values = [0.0] * 100
        values[number] = 5.0 if number == 7 else 0.1
        strip.add(batch(values, number * BIN_NS))
    assert max(high for _, _, high in strip.bins) == 5.0
    assert [number for number, _, _ in strip.bins] == sorted(
        {number for number, _, _ in strip.bins}
    )


def test_a_batch_counts_once_and_old_ones_go() -> None:
    """What a log repeats from before it was opened changes nothing."""
    strip = Strip()
    for number in range(1, 3 * KEEP_BINS):
        strip.add(batch([float(number)], number * BIN_NS))
    before = list(strip.bins)
    strip.add(batch([1e9], 5 * BIN_NS))
    assert list(strip.bins) == before
    assert len(before) == KEEP_BINS


def test_no_light_is_a_gap() -> None:
    """A sample without a position is no position."""
    strip = Strip()
    strip.add(batch([np.nan, np.nan], BIN_NS))
    assert np.isnan(strip.bins[-1][1])


class Followed:
    """A stream of which the batches are known."""

    def __init__(self, batches: list[Samples]) -> None:
        self.batches = batches

    def since(self, arrival_ns: int) -> list[Samples]:
        """Return the batches that arrived after a time."""
        return [each for each in self.batches if each.arrival_ns[-1] > arrival_ns]


def test_a_stream_that_nobody_watched_costs_no_more_than_the_bins(monkeypatch) -> None:
    """A pass without a viewer has hundreds of batches, of which the last second and a half is
    kept."""
    rng = np.random.default_rng(1)
    batches = [
        batch(rng.normal(size=20).tolist(), number * BIN_NS + 7) for number in range(1, 999)
    ]
    watched, unwatched, added = Strip(), Strip(), []
    for each in batches:
        watched.follow(Followed([each]))
    original = Strip.add
    monkeypatch.setattr(
        Strip, "add", lambda strip, each: added.append(each) or original(strip, each)
    )
    unwatched.follow(Followed(batches))
    assert len(added) <= KEEP_BINS + 1
    assert list(unwatched.bins) == list(watched.bins)
