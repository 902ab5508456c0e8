"""A patient machine waits for a recorder that was held up, not for one that is gone, nor for one
that a fault keeps from seeing."""

import numpy as np
import pytest

from stepdiag.virtual.base.faults import Fault, FaultBoard
from stepdiag.virtual.plc.attention import Attention

FROM_S, WANTED_S = 10.0, 0.4


def looking(times, faults=()):
    attention = Attention(FaultBoard(faults))
    for moment in times:
        attention.looked(moment)
    return attention


@pytest.mark.parametrize(
    ("looks", "lacks"),
    [
        (np.arange(9.0, 10.5, 0.01), False),
        (np.arange(9.0, 10.2, 0.01), True),
        ([*np.arange(9.0, 10.2, 0.01), *np.arange(10.31, 10.5, 0.01)], True),
        ([*np.arange(9.0, 10.05, 0.01), 10.48], True),
        (np.arange(9.0, 9.4, 0.01), False),
        ([], False),
    ],
    ids=["through", "not long enough", "with a break", "held up", "gone", "nobody"],
)
def test_what_was_looked_at_without_a_break(looks, lacks):
    assert looking(looks).lacking(FROM_S, 10.5, WANTED_S) == lacks


@pytest.mark.parametrize(
    ("looks", "lacks"),
    [
        ([9.97, 10.05], True),
        ([9.97, 10.05, 10.06], True),
        ([9.97, 10.05, 10.06, 10.09], False),
    ],
)
def test_one_look_long_after_a_move_began_has_not_seen_it(looks, lacks):
    """A recorder held up for 80 ms beside a move of 7 ms: the machine drove away and back between
    two polls, and two dwells were one."""
    assert looking(looks).lacking(FROM_S, 10.1, 0.03) == lacks


@pytest.mark.parametrize(
    ("delay_s", "lacks"),
    [(10.1, False), (9.0, True), (11.0, True)],
    ids=["meanwhile", "before", "later"],
)
def test_what_a_fault_hides_is_not_waited_for(delay_s, lacks):
    silent = Fault(kind="plc-silent", delay_s=delay_s, duration_s=0.2)
    assert (
        looking(np.arange(10.3, 10.5, 0.01), (silent,)).lacking(FROM_S, 10.5, WANTED_S)
        == lacks
    )
