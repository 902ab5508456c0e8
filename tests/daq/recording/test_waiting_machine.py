"""A machine that waits at every stop gets its answer, whatever the computer and the program do."""

import pytest

from stepdiag.base.names import SETUP_NUMBERS
from testkit.timeline import STOPPED_ONLY
from testkit.waiting import Disturbed, driven, survey_of

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
