"""A machine that waits for ``captured`` is answered, or somebody is told why not; over real sockets
and ptys."""

from contextlib import closing
from http.client import HTTPConnection

import pytest

from stepdiag.virtual.base.reserved import reserved_port
from testkit.running.hall import daemon, hall, until
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

PACED = {
    "handshake": True,
    "dwell": 0.1,
    "n": 1,
    "setups": ("ppp",),
    "laser_bench": "compensated = true\n",
    "laser_survey": "compensated = true\n",
}


@pytest.mark.impatient
def test_a_plc_that_is_silent_at_the_turn_leaves_nobody_waiting(tmp_path):
    """The dwell that the daemon sees next is that of the return pass: another count, though nobody
    saw the machine move."""
    silent = (
        '[[fault]]\nkind = "plc-silent"\nsetup = "ppp"\npass_number = 2\nstop = -1\nphase = '
        '"move"\nduration_s = 2.0\n'
    )
    with (
        hall(tmp_path, back=True, faults=silent, **PACED) as place,
        daemon(place.survey) as process,
    ):
        place.start_setups(stop_after=1)
        said = until(process, "survey-complete")
        book = nothing_silently_wrong(place)
    assert "link-silent" in {each["event"] for each in said}
    assert [len(each.chosen()) for each in book.passes] == [4, 4]


STOPPED = '[plc.signals.stopped]\naddress = 2\ntype = "bit"\nbit = 0\n'


@pytest.mark.impatient
def test_a_dwell_that_is_open_when_a_pass_ends_belongs_to_the_next(tmp_path):
    """Over the end and back within 0.1 s: the out pass ends while the first stop of the return pass
    stands, and nobody counts stops."""
    alone = {
        **PACED,
        "handshake": False,
        "signals": STOPPED,
        "dwell": 6.0,
        "bench": "[machine]\nbacklash_um = [0.0, 0.0, 4.0]\n",
    }
    with hall(tmp_path, back=True, **alone) as place, daemon(place.survey) as process:
        place.start_setups(stop_after=1)
        until(process, "pass-ended", kind="complete")
        said = until(process, "pass-ended")
        book = nothing_silently_wrong(place)
    assert said[-1]["kind"] == "complete"
    out, back = book.passes
    assert back.chosen()[0].window_from_ns > out.chosen()[3].window_to_ns, (
        "it stands twice at the turn, with the backlash in between"
    )
    assert not book.doubts()


def machine_says(process, code):
    """Return the finding with a code, once the daemon has said it."""
    return until(process, "finding", code=code)[-1]


def page_says(port, words):
    """Return the line of the page's stream in which words come first."""
    with closing(HTTPConnection("127.0.0.1", port, timeout=60.0)) as asked:
        asked.request("GET", "/stream")
        lines = iter(asked.getresponse().readline, b"")
        return next(line.decode() for line in lines if words.encode() in line)


@pytest.mark.impatient
def test_a_register_that_the_machine_does_not_take_is_named(tmp_path):
    """The page is in alarm; the journal says it once, with the register."""
    port = reserved_port()
    with hall(tmp_path, page=True, page_port=port, **PACED) as place:
        place.survey.write_text(
            place.survey.read_text().replace(
                "[plc.handshake]\n", "[plc.handshake]\naddress = 101\n"
            )
        )
        with daemon(place.survey) as process:
            place.start_setups(stop_after=1)
            assert "101" in machine_says(process, "handshake-waits")["text"]
            waits = machine_says(process, "handshake-waits")
            assert '"alarm":true' in page_says(port, "alarm_waits")
    assert "stop counter: 1; answer: 1" in waits["text"]


@pytest.mark.impatient
def test_a_plc_that_starts_again_is_told_again(tmp_path):
    """Its register is 0 again, its counter is kept, and it stands at the stop that was captured
    long ago."""
    reboot = (
        '[[fault]]\nkind = "plc-reboot"\nsetup = "ppp"\nstop = 1\ndelay_s = 0.8\nduration_s = '
        "0.2\nvalue = 1\n"
    )
    with (
        hall(tmp_path, faults=reboot, **{**PACED, "dwell": 12.0}) as place,
        daemon(place.survey) as process,
    ):
        place.start_setups(stop_after=1)
        until(process, "survey-complete")
