"""A line's own counts of what it lost, reported as they grow."""

from stepdiag.base.messages import message
from stepdiag.daq.links.ports.port_thread import EVERY_S, Losses


def framing(count):
    return (message("lost-framing", count=count),)


def test_what_is_new_is_said_once():
    losses = Losses()
    assert losses.news({}, 0.0) == ()
    assert losses.news({"lost-framing": 3}, 1.0) == framing(3)
    assert losses.news({"lost-framing": 3}, 1.0 + EVERY_S) == ()
    assert losses.news({"lost-framing": 3, "lost-parity": 2}, 5.0 + EVERY_S) == (
        message("lost-parity", count=2),
    )


def test_steady_errors_are_said_once_a_minute_and_none_of_them_is_left_out():
    losses, said = Losses(), []
    for quarter in range(4 * 600):
        said += filter(None, [losses.news({"lost-framing": quarter + 1}, 0.25 * quarter)])
    assert said == [framing(1), *[framing(240)] * 9]
