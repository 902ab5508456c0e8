"""A line's own counts of what it lost, said as they grow."""

from stepdiag.daq.links.ports.port_thread import EVERY_S, Losses

FRAMING, PARITY = "framing was wrong {times}", "parity was wrong {times}"


def test_what_is_new_is_said_once():
    losses = Losses()
    assert losses.news({}, 0.0) == ""
    assert losses.news({FRAMING: 3}, 1.0) == "framing was wrong 3 times"
    assert losses.news({FRAMING: 3}, 1.0 + EVERY_S) == ""
    assert losses.news({FRAMING: 3, PARITY: 2}, 5.0 + EVERY_S) == "parity was wrong 2 times"


def test_steady_errors_are_said_once_a_minute_and_none_of_them_is_left_out():
    losses, said = Losses(), []
    for quarter in range(4 * 600):
        said += filter(None, [losses.news({FRAMING: quarter + 1}, 0.25 * quarter)])
    assert said == ["framing was wrong 1 times", *["framing was wrong 240 times"] * 9]
