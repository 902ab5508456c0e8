"""Passes of a setup on one unbroken count of the laser, and their common zero."""

from collections.abc import Sequence
from dataclasses import dataclass

from stepdiag.daq.passes.driven import Pass


@dataclass(frozen=True, slots=True)
class Counted:
    """A pass and what to add to its readings, in mm, so that they count from the first stop of the
    first pass with the same ``zero``."""

    driven: Pass
    zero: int
    offset_mm: float


def on_one_count(passes: Sequence[Pass]) -> list[Counted]:
    """Return the passes in their order; passes of a setup whose counts are joined beyond doubt
    share a ``zero``, numbered from 1 a setup.

    A count joins two passes if a stretch of the count reaches into both. A stretch after an
    unwatched time joins nothing: a step of the count there would be taken for backlash.
    """
    found: dict[int, Counted] = {}
    for setup in dict.fromkeys(each.route.setup for each in passes):
        mine = sorted(
            (each for each in passes if each.route.setup == setup), key=lambda each: each.number
        )
        placed: list[Counted] = []
        for each in mine:
            placed.append(_beside(placed, each))
        found |= {id(one.driven): one for one in placed}
    return [found[id(each)] for each in passes]


def _beside(placed: Sequence[Counted], each: Pass) -> Counted:
    """Return a pass on the count of an earlier pass with a common stretch, else on a count of its
    own.
    """
    own = {stretch: zero for stretch, zero in each.zeros().items() if not zero.doubt}
    for other in reversed(placed):
        for stretch, zero in other.driven.zeros().items():
            if stretch in own and not zero.doubt:
                return Counted(
                    each, other.zero, other.offset_mm + zero.offset_mm - own[stretch].offset_mm
                )
    return Counted(each, max((one.zero for one in placed), default=0) + 1, 0.0)
