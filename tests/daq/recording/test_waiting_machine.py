"""A machine that waits at every stop gets its answer, whatever the computer and the program do."""

import pytest

from stepdiag.base.names import SETUP_NUMBERS
from testkit.timeline import STOPPED_ONLY
from testkit.waiting import Disturbed, Driven, driven, survey_of

ORDERS = """\
setups = ["ppp", "npp"]
repeats = 3
axis_orders = ["xyz", "yzx", "zxy"]
"""
COUNTED = (
    STOPPED_ONLY
    + '[plc.signals.stop_count]\naddress = 1\ntype = "uint16"\n'
    + '[plc.signals.running]\naddress = 2\ntype = "bit"\nbit = 1\n'
    + '[plc.signals.setup]\naddress = 3\ntype = "uint16"\n'
)
"""A machine without positions."""
COUNTED_ALONE = STOPPED_ONLY + '[plc.signals.stop_count]\naddress = 1\ntype = "uint16"\n'
PLACED = COUNTED_ALONE + "".join(
    f'[plc.signals.{axis}_mm]\naddress = {address}\ntype = "int32"\nscale = 0.0001\n'
    for axis, address in (("x", 4), ("y", 6), ("z", 8))
)
"""Machines that do not signal their program, without and with positions."""
RANGED = """\
setups = ["ppp", "npp", "pnp", "ppn", "linear-x"]
repeats = 3
axis_orders = ["xyz", "yzx", "zxy"]
targets = 8
"""


@pytest.mark.parametrize("signals", ["", COUNTED])
@pytest.mark.parametrize("stop", [3, 17])
def test_a_program_is_driven_anew_for_one_missing_pass(signals: str, stop: int) -> None:
    """The beam is cut in one of three passes, which differ in the order of the axes: the program
    begins anew with its first order, and the missing pass is complete at its end."""
    found = driven(
        survey_of(ORDERS, signals),
        ("ppp", "ppp", "npp"),
        stop,
        Disturbed(cut_at=((0, stop),)),
    )
    assert not found.waits_in_vain
    assert found.session.book.complete()
    orders = {
        each.number: each.route.order
        for each in found.session.book.of("ppp")
        if each.number in found.session.book.wanted()
    }
    assert orders == {1: "xyz", 3: "yzx", 5: "zxy"}
    assert set(found.errors) == {"beam-lost"}


@pytest.mark.parametrize("stop", [4, 11, 18])
def test_an_aborted_program_is_driven_anew_without_a_doubt(stop: int) -> None:
    """In each of the three passes; the laser counts on meanwhile."""
    found = driven(
        survey_of(ORDERS),
        ("ppp", "ppp", "npp"),
        stop,
        Disturbed(aborted_at=((0, stop),)),
    )
    assert not found.waits_in_vain
    assert found.session.book.complete()
    assert found.errors == []


@pytest.mark.parametrize("seed", range(2))
def test_a_stalled_computer_lets_no_machine_wait_in_vain(seed: int) -> None:
    setups = [*SETUP_NUMBERS.values()][seed], "linear-x"
    found = driven(
        survey_of(RANGED),
        (setups[0], *setups),
        seed,
        Disturbed(stalls=0.3, lags=0.1, flickers=0.5),
    )
    assert not found.waits_in_vain
    counts = {stop.stop_count for stop in found.stops if stop.setup == "linear-x"}
    assert len(counts) == 27


@pytest.mark.parametrize("seed", range(2))
def test_nothing_is_wrong_with_a_hasty_machine(seed: int) -> None:
    """A standstill of 0.12 s is a plateau, too: the steps of one axis are all alike, and a delay of
    three stops would explain them."""
    found = driven(survey_of(ORDERS), ("ppp", "npp"), seed)
    assert found.session.book.complete()
    assert found.findings == []
    assert found.longest_s < 1.0


def assert_stops_of_their_passes(found: Driven) -> None:
    """By the counts of the NC program: the first stops of all passes are at the same place."""
    for each in found.session.book.of("ppp"):
        begin = {"xyz": 1, "yzx": 8, "zxy": 15}[each.route.order]
        for stop in each.chosen().values():
            assert stop.stop == 0 or stop.stop_count == begin + stop.stop


EQUAL = {"size": (240.0, 240.0, 240.0)}
"""All steps of a diagonal are alike: the laser shows no order of the axes."""


@pytest.mark.parametrize("signals", [COUNTED, COUNTED_ALONE])
@pytest.mark.parametrize("stop", [4, 12, 20])
def test_the_program_shows_the_order_where_all_steps_are_alike(
    signals: str, stop: int
) -> None:
    """The beam is cut in one of the passes, and the program is driven again: without positions,
    the place in the program and its counter show the order of each pass."""
    found = driven(
        survey_of(ORDERS, signals, **EQUAL),
        ("ppp", "ppp", "npp"),
        stop,
        Disturbed(cut_at=((0, stop),)),
    )
    assert not found.waits_in_vain
    assert found.session.book.complete()
    assert_stops_of_their_passes(found)


def test_the_first_stop_of_the_next_pass_joins_the_parts_of_a_cut_pass() -> None:
    """No pass has to be driven again."""
    found = driven(survey_of(ORDERS), ("ppp", "npp"), 1, Disturbed(cut_at=((0, 4),)))
    assert found.session.book.complete()
    assert [each.number for each in found.session.book.passes] == [1, 3, 5, 1, 3, 5]


@pytest.mark.parametrize("signals", [COUNTED_ALONE, PLACED])
@pytest.mark.parametrize("stop", [2, 10, 13, 19])
def test_a_program_without_its_signal_is_driven_anew(signals: str, stop: int) -> None:
    """The log of the aborted pass is open when the program begins with its first order."""
    found = driven(
        survey_of(ORDERS, signals),
        ("ppp", "ppp", "npp"),
        stop,
        Disturbed(aborted_at=((0, stop),)),
    )
    assert not found.waits_in_vain
    assert found.session.book.complete()
    assert_stops_of_their_passes(found)
    assert found.errors == []
