"""When an S7 is asked again for what it refused: by a clock that the test holds."""

from itertools import pairwise

import pytest
from snap7.error import S7Error

from stepdiag.daq.links.controls.blocking import Waiter
from stepdiag.daq.links.controls.s7 import AGAIN_FIRST_S, AGAIN_LONGEST_S, S7Link, S7Settings
from stepdiag.daq.records.events import ReadRange

PROGRAM, AXIS = ReadRange("db4900", 0, 6), ReadRange("db3902", 0, 2)
POLL_S = 0.02
REFUSED = "Read operation failed: Object does not exist (0x0a)"


class Control:
    """The library's client with a control behind it; ``refuses`` names data blocks. ``asked`` are
    the times of single questions."""

    def __init__(self, refuses=()):
        self.refuses, self.now_s, self.asked = set(refuses), 0.0, []

    def read_multi_vars(self, items):
        if self.refuses & {item["db_number"] for item in items}:
            raise S7Error(REFUSED)
        return 0, [bytes(item["size"]) for item in items]

    def db_read(self, number, start, size):
        self.asked.append((self.now_s, number))
        if number in self.refuses:
            raise S7Error(REFUSED)
        return bytes(size)


@pytest.fixture
def polled():
    """Return what polls, for some seconds of the clock: the bytes of each poll by range."""
    waiters = []

    def make(control):
        waiters.append(Waiter("test", lambda: None, lambda: None))
        link = S7Link(
            S7Settings(host="nowhere"),
            [PROGRAM, AXIS],
            control,
            waiters[-1],
            clock=lambda: control.now_s,
        )

        def poll(seconds):
            end_s, got = control.now_s + seconds, []
            while control.now_s < end_s:
                link.refusals = {}
                got.append([len(data) for data in link._fetch_all()])
                control.now_s += POLL_S
            return got

        return poll

    yield make
    for each in waiters:
        each.end()


def test_a_passing_refusal_costs_a_second(polled):
    control = Control(refuses=[3902])
    poll = polled(control)
    assert set(map(tuple, poll(0.5))) == {(6, 0)}
    control.refuses.clear()
    got = poll(2.0)
    assert got.index([6, 2]) * POLL_S <= AGAIN_FIRST_S
    assert got[-1] == [6, 2]


def test_a_lasting_refusal_is_asked_about_ever_less_often_and_never_given_up(polled):
    """Each time for all ranges alone: in between everything is of one moment."""
    control = Control(refuses=[3902])
    poll = polled(control)
    poll(200.0)
    times = [at for at, number in control.asked if number == 3902]
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert gaps[:5] == pytest.approx([1.0, 2.0, 4.0, 8.0, 16.0], abs=2 * POLL_S)
    assert gaps[5:] == pytest.approx([AGAIN_LONGEST_S] * len(gaps[5:]), abs=2 * POLL_S)
    control.refuses.clear()
    assert [6, 2] in poll(AGAIN_LONGEST_S + 1.0)


def test_a_refusal_that_comes_again_later_begins_with_a_second_again(polled):
    control = Control(refuses=[3902])
    poll = polled(control)
    poll(20.0)
    control.refuses.clear()
    poll(AGAIN_LONGEST_S)
    control.refuses.add(3902)
    poll(0.1)
    control.refuses.clear()
    assert [6, 2] in poll(AGAIN_FIRST_S + 0.1)
