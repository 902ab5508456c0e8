"""Passes of a setup on one unbroken count of the laser, and their common zero."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from stepdiag.daq.passes.driven import Pass

CLOCK_S = 2.0
"""Uncertainty in s of the time of day after a power cut: without a network a computer's clock
starts in whole seconds.
"""
TIMED_S = 0.005
"""Uncertainty in s of the time between two stops of one stretch, from the sample numbers of the
instrument.
"""
CHANCE = 0.1
"""Largest probability that a sample number fits the time by chance, for a proof. (A laser that was
switched on again counts from zero, too.)
"""


@dataclass(frozen=True, slots=True)
class Counted:
    """A pass, and the offset in mm of its readings to the first stop of the first pass with the
    same ``zero``.
    """

    driven: Pass
    zero: int
    offset_mm: float


@dataclass(slots=True)
class Numbered:
    """The instrument's sample number and the time in s at the first and at the last stop of an
    unbroken stretch; None before the first stop.
    """

    first: tuple[int, float] | None = None
    last: tuple[int, float] | None = None

    def add(self, count: int | None, time_s: float) -> None:
        """Add the next stop; a stop without a sample number is ignored."""
        if count is not None:
            self.last = count, time_s
            self.first = self.first or self.last


def went_on(before: Numbered, after: Numbered, repeats_after: float) -> bool | None:
    """Return whether the sample number of the instrument advanced between two stretches like the
    time of day, which proves that the instrument ran throughout; None without sample numbers.

    The rate of the sample number is taken from the longer stretch.
    """
    if (
        before.first is None
        or before.last is None
        or after.first is None
        or after.last is None
    ):
        return None
    runs = ((each.first, each.last) for each in (before, after) if each.first and each.last)
    (first, begun_s), (last, ended_s) = max(runs, key=lambda run: run[1][1] - run[0][1])
    run_s = ended_s - begun_s
    if run_s <= 0.0:
        return None
    rate_hz, away_s = (last - first) / run_s, after.first[1] - before.last[1]
    unsure = rate_hz * (CLOCK_S + TIMED_S * max(away_s, 0.0) / run_s)
    if away_s <= 0.0 or 2.0 * unsure > CHANCE * repeats_after:
        return None
    off = after.first[0] - before.last[0] - rate_hz * away_s
    if math.isfinite(repeats_after):
        off = (off + repeats_after / 2.0) % repeats_after - repeats_after / 2.0
    return abs(off) <= unsure


def on_one_count(passes: Sequence[Pass]) -> list[Counted]:
    """Return the passes in their order, each with a ``zero``: passes of a setup that certainly
    share one count have the same number, counted from 1 in each setup.

    Two passes share a count if a stretch contains stops of both. A stretch after an unwatched time
    does not connect passes, because a lost count in this time would look like backlash.
    """
    found: dict[int, Counted] = {}
    for setup in dict.fromkeys(each.route.setup for each in passes):
        mine = sorted(
            (each for each in passes if each.route.setup == setup),
            key=lambda each: each.number,
        )
        placed: list[Counted] = []
        for each in mine:
            placed.append(_beside(placed, each))
        found |= {id(one.driven): one for one in placed}
    return [found[id(each)] for each in passes]


def _beside(placed: Sequence[Counted], each: Pass) -> Counted:
    own = {stretch: zero for stretch, zero in each.zeros().items() if not zero.doubt}
    for other in reversed(placed):
        for stretch, zero in other.driven.zeros().items():
            if stretch in own and not zero.doubt:
                return Counted(
                    each,
                    other.zero,
                    other.offset_mm + zero.offset_mm - own[stretch].offset_mm,
                )
    return Counted(each, max((one.zero for one in placed), default=0) + 1, 0.0)
